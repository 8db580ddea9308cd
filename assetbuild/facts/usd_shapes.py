"""Shapes: their geometry in the body's frame, colour, surface, and what they may touch."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdShade

from assetbuild.facts.reference import pose_value
from assetbuild.facts.surface import Surface, measure, pixel_digest
from assetbuild.facts.table import Table, Value, pair_name
from assetbuild.facts.usd_prims import AXES, Places, Prim, Units, rigid
from assetbuild.grouping import grouped
from assetbuild.robot.pose import Array, Pose, quat_between

CONTACT: Mapping[str, tuple[float, ...]] = {
    "condim": (3.0,),
    "priority": (0.0,),
    "solref": (0.02, 1.0),
    "solimp": (0.9, 0.95, 0.001, 0.5, 2.0),
    "margin": (0.0,),
    "gap": (0.0,),
}
"""Attributes of MuJoCo's `MjcCollisionAPI` with what they are where they are not stated."""


@dataclass(frozen=True)
class ShapePrim:
    """A piece of geometry. body: path of its body; holder: the prim around it that has the shape's
    name; collider: the prim whose CollisionAPI speaks for it.
    """

    geometry: Prim
    body: str
    holder: Prim | None
    collider: Prim | None


@dataclass(frozen=True)
class Collider:
    """A collision shape. path: of its geometry; body: path of its body; touches: at all."""

    name: str
    path: str
    body: str
    touches: bool


def read_shapes(
    shapes: Sequence[ShapePrim], names: Mapping[str, str], places: Places, table: Table
) -> list[Collider]:
    """Facts of all shapes; the colliders among them."""
    measured = functools.cache(functools.partial(_measure, units=places.units))
    look, colliders = functools.cache(_look), []
    alone = [s.holder.path for s in shapes if s.holder]
    for shape in shapes:
        prim, holder = shape.geometry, shape.holder
        name = (holder or prim).named("shape", table)
        if holder and alone.count(holder.path) > 1:
            name = f"{name}/{prim.name}"
        role = "collision" if shape.collider else "visual"
        facts: dict[str, Value] = {"role": role, "body": names.get(shape.body, "")}
        facts |= _geometry(shape, places, measured) | _drawn(prim)
        if shape.collider:
            solid = shape.collider.flag("physics:collisionEnabled") is not False
            facts |= {"collides": solid} | surface_of(prim.prim) | _contact(shape.collider)
            colliders.append(Collider(name, prim.path, shape.body, solid))
        else:
            material, _ = UsdShade.MaterialBindingAPI(prim.prim).ComputeBoundMaterial()
            facts |= look(material.GetPrim()) if material else {}
        table.put("shape", name, facts)
    return colliders


def _drawn(prim: Prim) -> dict[str, Value]:
    """Who sees it, and of a mesh how it is drawn."""
    facts: dict[str, Value] = {"usd:purpose": UsdGeom.Imageable(prim.prim).ComputePurpose()}
    if prim.type == "Mesh":
        facts["usd:instanced"] = prim.prim.IsInstanceProxy()
        facts["usd:doubleSided"] = prim.flag("doubleSided")
        facts["usd:subdivisionScheme"] = prim.text("subdivisionScheme")
        facts["usd:normals"] = _fitting_normals(UsdGeom.Mesh(prim.prim))
    return facts


def _fitting_normals(mesh: UsdGeom.Mesh) -> bool:
    """Whether there is one for each face, corner or point, as their interpolation says."""
    counts = {
        UsdGeom.Tokens.uniform: len(mesh.GetFaceVertexCountsAttr().Get() or ()),
        UsdGeom.Tokens.faceVarying: len(mesh.GetFaceVertexIndicesAttr().Get() or ()),
        UsdGeom.Tokens.vertex: len(mesh.GetPointsAttr().Get() or ()),
    }
    return len(mesh.GetNormalsAttr().Get() or ()) == counts.get(mesh.GetNormalsInterpolation())


def _contact(prim: Prim) -> dict[str, Value]:
    """What contacts have beyond friction in MuJoCo, where its schema is applied."""
    schema, facts = "MjcCollisionAPI", dict[str, Value]()
    for name, usual in CONTACT.items() if prim.has(schema) else ():
        values = prim.numbers(f"mjc:{name}") or usual
        facts[name] = values if len(usual) > 1 else values[0]
    return facts


# --- geometry --------------------------------------------------------------------------------


def _geometry(
    shape: ShapePrim, places: Places, measured: Callable[[Usd.Prim], Measured]
) -> dict[str, Value]:
    prim = shape.geometry
    stage = prim.prim.GetStage()
    X_world_body = np.eye(4)
    if shape.body:
        pose, _ = places.rigid(stage.GetPrimAtPath(shape.body))
        X_world_body = pose.matrix()
    within = np.linalg.inv(X_world_body) @ places.world(prim.prim)
    pose, scale = rigid(within)
    if prim.type == "Mesh":
        is_shared = prim.prim.IsInstanceProxy()  # instances share a prototype
        source = prim.prim.GetPrimInPrototype() if is_shared else prim.prim
        corners, uv, surface = measured(source)
        if np.all(scale == 1.0):
            return {"geometry": "mesh"} | surface.moved(pose).facts()
        placed = corners @ within[:3, :3].T + within[:3, 3]
        return {"geometry": "mesh"} | measure(placed, uv).facts()
    token = prim.text("axis") or "Z"
    if token in ("X", "Y"):
        pose = pose @ Pose(quat=quat_between(AXES["Z"], AXES[token]))
    kind = {"Cube": "box"}.get(prim.type, prim.type.lower())
    size = _size(prim, np.abs(scale) * places.units.metre, "XYZ".find(token))
    return {"geometry": kind, "pose": pose_value(pose), "size": tuple(map(float, size))}


def _size(prim: Prim, scale: Array, axis: int) -> list[float]:
    """m; a round shape that is scaled unevenly is as wide as its widest radius."""
    schema = prim.prim.GetPrimDefinition()

    def length(name: str) -> float:
        value = prim.number(name)
        return float(schema.GetAttributeFallbackValue(name)) if value is None else value

    match prim.type:
        case "Cube":
            return list(length("size") * scale)
        case "Sphere":
            return [length("radius") * float(scale.max())]
        case "Cylinder" | "Capsule" | "Cone":
            across = max(float(s) for i, s in enumerate(scale) if i != axis)
            return [length("radius") * across, length("height") * float(scale[axis])]
    return []


# --- materials -------------------------------------------------------------------------------


def _look(prim: Usd.Prim) -> dict[str, Value]:
    """Colour and texture of a material.

    Nothing of one whose output leads to no shader: a viewer draws it grey.
    """
    if not UsdShade.Material(prim).ComputeSurfaceSource()[0]:
        return {}
    facts: dict[str, Value] = {"material": Prim(prim).name}
    for shader in (Prim(below) for below in Usd.PrimRange(prim) if below.IsA(UsdShade.Shader)):
        kind = shader.text("info:id")
        if kind == "UsdPreviewSurface":
            colour = shader.numbers("inputs:diffuseColor") or ()
            facts["rgba"] = (*colour, *(shader.numbers("inputs:opacity") or (1.0,)))
        file = shader.value("inputs:file")
        if kind == "UsdUVTexture" and isinstance(file, Sdf.AssetPath):
            digest = pixel_digest(Path(file.resolvedPath)) if file.resolvedPath else ""
            facts["texture"] = digest or f"unreadable {file.path}"
    return facts


def surface_of(shape: Usd.Prim) -> dict[str, Value]:
    """Friction and restitution of a collision shape, of the physics material bound to it.

    friction has three numbers where Newton's are stated, else the sliding one alone.
    """
    material, _ = UsdShade.MaterialBindingAPI(shape).ComputeBoundMaterial("physics")
    if not material:
        return {}
    prim = Prim(material.GetPrim())
    if not prim.has("PhysicsMaterialAPI"):
        return {}
    beyond = [prim.number(f"newton:{name}Friction", "NewtonMaterialAPI")
              for name in ("torsional", "rolling")]  # fmt: skip
    sliding = prim.number("physics:staticFriction") or 0.0
    facts: dict[str, Value] = {
        "friction": (sliding, *(value for value in beyond if value is not None)),
        "restitution": prim.number("physics:restitution") or 0.0,
        "usd:dynamicFriction": prim.number("physics:dynamicFriction") or 0.0,
    }
    mode = prim.text("physxMaterial:frictionCombineMode", "PhysxMaterialAPI")
    return facts | {"usd:frictionCombineMode": mode or "average"}


# --- pairs -----------------------------------------------------------------------------------


def pair_facts(
    colliders: Sequence[Collider],
    names: Mapping[str, str],
    filters: Iterable[tuple[str, str]],
    apart: Iterable[tuple[str, ...]],
    articulated: Collection[str],
    table: Table,
) -> None:
    """Pairs of bodies, and of single shapes, that never touch.

    filters: pairs of paths, of bodies or shapes; one of a body that carries the articulation speaks
    for the whole robot. apart: bodies that a joint keeps apart.
    """
    of_body = grouped(colliders, lambda one: one.body)
    by_path = {one.path: [one] for one in colliders} | of_body
    by_path |= {path: [*colliders] for path in articulated}
    sides = [[by_path.get(path, ()) for path in pair] for pair in filters]
    sides += [[of_body.get(body, ()) for body in pair] for pair in apart]
    never = {frozenset((a.path, b.path)) for two in sides for a, b in itertools.product(*two)}
    bodies_in_order = sorted(of_body, key=lambda path: names.get(path, path))
    for left, right in itertools.combinations(bodies_in_order, 2):
        solid = ([one for one in of_body[body] if one.touches] for body in (left, right))
        pairs = list(itertools.product(*solid))
        kept = [pair for pair in pairs if frozenset(one.path for one in pair) in never]
        if len(kept) == len(pairs):
            named = pair_name(names.get(left, left), names.get(right, right))
            table.put("pair", named, {"filtered": True})
            continue
        for a, b in kept:
            table.put("shape pair", pair_name(a.name, b.name), {"usd:filtered": True})


# --- meshes --------------------------------------------------------------------------------------


Whole = NDArray[np.int64]


Measured = tuple[Array, Array | None, Surface]
"""A mesh in its own frame: (n, 3, 3) corners, m, none where its faces do not fit its points; their
texture coordinates; its surface."""


def _measure(prim: Usd.Prim, units: Units) -> Measured:
    mesh = UsdGeom.Mesh(prim)
    points = np.array(mesh.GetPointsAttr().Get() or (), dtype=np.float64).reshape(-1, 3)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get() or (), dtype=np.int64)
    indices = np.array(mesh.GetFaceVertexIndicesAttr().Get() or (), dtype=np.int64)
    where = _triangles(counts, flip=mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded)
    sound = len(indices) == counts.sum() and not (indices.size and not
        0 <= indices.min() <= indices.max() < len(points))  # fmt: skip
    if not sound:
        where = where[:0]
    corners = points[indices[where]] * units.metre
    uv = _texture_corners(prim, indices, where) if sound else None
    return corners, uv, measure(corners, uv)


def _triangles(counts: Whole, *, flip: bool) -> Whole:
    """(n, 3) places in the list of face corners: each polygon cut into a fan."""
    starts = np.concatenate(([0], np.cumsum(counts)[:-1])) if len(counts) else counts
    if np.all(counts == 3):
        fans = starts[:, None] + np.array((0, 1, 2))
    else:
        fans = np.array(
            [(s, s + i, s + i + 1) for s, n in zip(starts, counts, strict=True)
             for i in range(1, n - 1)], dtype=np.int64,
        ).reshape(-1, 3)  # fmt: skip
    triangles: Whole = fans[:, ::-1] if flip else fans
    return triangles


def _texture_corners(prim: Usd.Prim, indices: Whole, where: Whole) -> Array | None:
    """(n, 3, 2) of the primvar `st`, None where it has none or does not fit the mesh."""
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("st")
    if not primvar or not primvar.HasAuthoredValue():
        return None
    flat = np.array(primvar.ComputeFlattened() or (), dtype=np.float64).reshape(-1, 2)
    kind = primvar.GetInterpolation()
    if kind in (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying):
        flat = flat[indices] if indices.size and indices.max() < len(flat) else flat[:0]
    elif kind != UsdGeom.Tokens.faceVarying:
        flat = flat[:0]
    if where.size and where.max() >= len(flat):
        return np.zeros((0, 3, 2))
    corners: Array = flat[where]
    return corners
