"""The same robot with other collision geometry: one recipe per level, down to its MJCF."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from assetbuild.collision import CollisionMethod
from assetbuild.engine.graph import Node, Ref
from assetbuild.engine.planner import Planner
from assetbuild.kinds import Target
from assetbuild.lock import Lock
from assetbuild.pipeline.recipes import collision_rule
from assetbuild.plan import plan
from assetbuild.plugins import load_plugin
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.robot.shapes import Mesh, Shapes

LEVELS: Mapping[str, Mapping[str, Any]] = {  # Any: values of a recipe
    "mesh": {"method": "keep"},
    "hull": {"method": "hull", "max_vertices": 256},
    "hull 64": {"method": "hull", "max_vertices": 64},
    "vhacd 8": {"method": "vhacd", "max_hulls": 8},
    "vhacd 32": {"method": "vhacd", "max_hulls": 32},
    "coacd 8": {"method": "coacd", "max_hulls": 8},
    "coacd 16": {"method": "coacd", "max_hulls": 16},
    "auto": {"method": "auto"},
    "primitives": {"method": "primitive", "max_hulls": 3},
}
"""Name -> rule of the links that have meshes. `recipe` is the recipe as it is."""
Source = Literal["auto", "collision", "visual"]


@dataclass
class LevelOutline:
    """What a level leaves in the graph. fits: nodes that made collision geometry."""

    mjcf: Node | None = None
    shapes: Ref | None = None
    fits: tuple[Node, ...] = ()


def plan_level(loaded: LoadedRecipe, lock: Lock | None, p: Planner) -> LevelOutline:
    """Add the graph of a recipe down to its MJCF, as far as the answers reach; no checks."""
    bare = replace(loaded, recipe=loaded.recipe.model_copy(update={"targets": ()}))
    outline = plan(bare, lock, p)
    if not outline.robot:
        return LevelOutline()
    target = load_plugin(Target, "mjcf")
    ports = {port: outline.robot[port] for port in target.reads}
    node = p.add("mjcf", target.configure(bare.recipe), ports)
    nodes = p.graph().nodes.values()
    fits = tuple(each for each in nodes if isinstance(each.step, CollisionMethod))
    return LevelOutline(node, outline.robot["shapes.json"], fits)


def with_level(loaded: LoadedRecipe, shapes: Shapes, level: str, source: Source) -> LoadedRecipe:
    """The recipe whose links with meshes follow one level.

    shapes: of the built recipe. source: the meshes to work on. Links that hit nothing in the
    recipe hit nothing here; links without such a mesh keep their rule.
    """
    solid = {shape.link for shape in shapes.of("collision")}
    meshed = {
        shape.link
        for shape in shapes.shapes
        if isinstance(shape.geometry, Mesh) and source in ("auto", shape.role)
    }
    rule = collision_rule(**{**LEVELS[level], "from": source})
    collision = loaded.recipe.collision
    rules = {re.escape(link): rule for link in sorted(solid & meshed)}
    changed = collision.model_copy(update={"links": rules | collision.links})
    return replace(loaded, recipe=loaded.recipe.model_copy(update={"collision": changed}))
