"""Each engine's own words in a layer of their own, so that a variant can leave the others' out.

What `physics.usda` keeps is USD's own physics, which all engines read. A schema or attribute that
NVIDIA's, Newton's or MuJoCo's schemas add goes to the layer of its engine. The variant `physics`
has them all; they do not contradict each other.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from pxr import Sdf, Usd

from assetbuild.targets.usd.layers import new_layer, save
from assetbuild.targets.usd.names import PrimPaths

WORDS = {"physx": ("Physx", "physx"), "newton": ("Newton", "newton:"), "mujoco": ("Mjc", "mjc:")}
"""By engine and layer: how its schemas and its properties start."""


def save_by_engine(stage: Usd.Stage, folder: Path, names: PrimPaths) -> None:
    """Save `physics.usda` with USD's own words, and the layer of each engine beside it."""
    physics = stage.GetRootLayer()
    prims = list(_prims(physics.pseudoRoot))
    for engine, (schemas, properties) in WORDS.items():
        own = new_layer(folder / f"{engine}.usda", names)
        for prim in prims:
            if not prim.expired:
                _move(prim, own.GetRootLayer(), schemas, properties)
        save(own)
    save(stage)


def _prims(parent: Sdf.PrimSpec) -> Iterator[Sdf.PrimSpec]:
    for prim in parent.nameChildren:
        yield prim
        yield from _prims(prim)


def _move(prim: Sdf.PrimSpec, own: Sdf.Layer, schemas: str, properties: str) -> None:
    """The whole prim where its type is the engine's, else its schemas and properties."""
    if prim.typeName.startswith(schemas):
        Sdf.CreatePrimInLayer(own, prim.path.GetParentPath())
        Sdf.CopySpec(prim.layer, prim.path, own, prim.path)
        del prim.nameParent.nameChildren[prim.name]
        return
    moved = [each for each in prim.properties if each.name.startswith(properties)]
    applied = prim.GetInfo("apiSchemas").prependedItems
    foreign = [name for name in applied if name.startswith(schemas)]
    if not (moved or foreign):
        return
    there = Sdf.CreatePrimInLayer(own, prim.path)
    for each in moved:
        Sdf.CopySpec(prim.layer, each.path, own, each.path)
        prim.RemoveProperty(each)
    if foreign:
        there.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=foreign))
        rest = [name for name in applied if name not in foreign]
        if rest:
            prim.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=rest))
        else:
            prim.ClearInfo("apiSchemas")
