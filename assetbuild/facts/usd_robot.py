"""The robot on a stage: every prim sorted by what it is, and read.

The walk follows the stage as it composes, into instances, and past what is inactive, abstract or
never defined, which it reports: nothing there acts, whatever it says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics, UsdShade

from assetbuild.facts.known_files import KnownFiles
from assetbuild.facts.reference import pose_value
from assetbuild.facts.table import Table, Value, Writer
from assetbuild.facts.usd_isaac import read_schema
from assetbuild.facts.usd_isaac_expected import JOINT, LINK, POSE, SITE
from assetbuild.facts.usd_joints import JointPrim, joint_facts, read_actuators
from assetbuild.facts.usd_looks import Looks, take_bindings
from assetbuild.facts.usd_prims import Places, Prim, acts, listed, quat_of_gf
from assetbuild.facts.usd_shapes import ShapePrim, pair_facts, read_shapes
from assetbuild.facts.usd_stage import opened, stage_facts, units_of, variant_facts
from assetbuild.robot.inertia import rotate_tensor
from assetbuild.robot.pose import Pose

GROUPS = ("visuals", "collisions")
"""Groups of shapes below a body, which are no frames."""
CONTAINERS = frozenset({"Xform", "Scope", ""})

RIGID_BODY = {
    "physxRigidBody:linearDamping": "linearDamping",
    "physxRigidBody:angularDamping": "angularDamping",
    "physxRigidBody:maxLinearVelocity": "maxLinearVelocity",
    "physxRigidBody:maxAngularVelocity": "maxAngularVelocity",
    "physxRigidBody:maxDepenetrationVelocity": "maxDepenetrationVelocity",
}
ARTICULATION = (
    "solverPositionIterationCount",
    "solverVelocityIterationCount",
    "sleepThreshold",
    "stabilizationThreshold",
)


@dataclass(frozen=True)
class Above:
    """What a prim stands below. body: path of its body; group: `visuals` or `collisions`.

    holder: the prim that names the shape, where that is not the geometry itself; collider: the
    prim whose CollisionAPI speaks for the geometry below it.
    """

    body: str = ""
    group: str = ""
    holder: Prim | None = None
    collider: Prim | None = None


HINT = 1e-6
"""Metres, and share of a bound, by which `extentsHint` may be off: it is in single precision."""


@dataclass
class Sorted:
    """The prims of a robot by what they are; bodies by path."""

    bodies: dict[str, Prim] = field(default_factory=dict)
    joints: list[Prim] = field(default_factory=list)
    shapes: list[ShapePrim] = field(default_factory=list)
    frames: list[tuple[Prim, str]] = field(default_factory=list)
    cameras: list[tuple[Prim, str]] = field(default_factory=list)
    materials: list[Prim] = field(default_factory=list)
    shaders: list[Prim] = field(default_factory=list)
    actuators: list[Prim] = field(default_factory=list)
    poses: list[Prim] = field(default_factory=list)
    others: list[Prim] = field(default_factory=list)


def read_robot(path: Path, known: KnownFiles) -> Table:
    """The facts of the stage as it opens, its default variants selected."""
    with opened(path) as stage:
        return _read(stage, known)


def _read(stage: Usd.Stage, known: KnownFiles) -> Table:
    book, units = Writer(), units_of(stage)
    stage_facts(stage, units, book)
    top = stage.GetDefaultPrim()
    variant_facts(top, book)
    found = Sorted()
    for child in stage.GetPseudoRoot().GetAllChildren():
        _sort(child, Above(), found, book)
    places = Places(units)
    names = {path: prim.named("body") for path, prim in found.bodies.items()}
    looks = Looks(found.materials, found.shaders, book, known)
    colliders = read_shapes(found.shapes, names, places, looks, book)
    joints = [JointPrim(prim, names, places) for prim in found.joints]
    joint_facts(joints, units, book)
    read_actuators(found.actuators, {j.prim.path: j.prim.name for j in joints}, book)
    _bodies(found.bodies, joints, names, places, book)
    for prim, body in found.frames:
        name = prim.named("frame")
        book.put(
            "frame", name, {"body": names[body], "pose": _within(places, prim, found.bodies[body])}
        )
        prim.placed()
    for prim, body in found.cameras:
        _camera(prim, found.bodies.get(body), names.get(body, ""), places, book)
    _root(top, found, joints, names, places, book)
    filters = [
        (prim.path, target)
        for prim in _all(found)
        for target in prim.targets("physics:filteredPairs", "PhysicsFilteredPairsAPI")
    ]
    apart = [frozenset(j.ends) for j in joints if len(j.ends) == 2 and not j.touching]
    pair_facts(colliders, names, filters, apart, _articulated(found), book)
    parts = {
        LINK: found.bodies,
        SITE: {prim.path: prim for prim, _ in found.frames},
        JOINT: {prim.path: prim for prim in found.joints},
    }
    angular = {joint.prim.path: joint.angular for joint in joints}
    robot = next(prim for prim in _all(found) if prim.prim == top)
    read_schema(robot, parts, angular, found.poses, units, book)
    looks.unbound()
    for prim in _all(found):
        take_bindings(prim)
        prim.close()
    return book.table()


def _all(found: Sorted) -> list[Prim]:
    shapes = [prim for shape in found.shapes for prim in shape.prims]
    frames = [prim for prim, _ in (*found.frames, *found.cameras)]
    rest = [
        *found.joints,
        *found.materials,
        *found.shaders,
        *found.actuators,
        *found.poses,
        *found.others,
    ]
    kept = {prim.path: prim for prim in (*found.bodies.values(), *shapes, *frames, *rest)}
    return list(kept.values())


# --- sorting ---------------------------------------------------------------------------------


def _sort(prim: Usd.Prim, above: Above, found: Sorted, book: Writer) -> None:
    """One prim and all below it."""
    path = str(prim.GetPath())
    book.facts |= dict(listed(prim))
    if not acts(prim):
        return
    one = Prim(prim, book)
    parent = prim.GetParent()
    if one.has("PhysicsRigidBodyAPI"):
        found.bodies[path] = one
        above = Above(body=path)
        if prim.IsA(UsdGeom.Gprim):  # a body that is its own shape
            collider = one if one.has("PhysicsCollisionAPI") else None
            found.shapes.append(ShapePrim(one, path, "", None, collider))
    elif prim.IsA(UsdPhysics.Joint):
        found.joints.append(one)
    elif prim.IsA(UsdShade.Material):
        found.materials.append(one)
    elif prim.IsA(UsdShade.Shader):
        found.shaders.append(one)
    elif prim.IsA(UsdGeom.Gprim):
        collider = one if one.has("PhysicsCollisionAPI") else above.collider
        found.shapes.append(ShapePrim(one, above.body, above.group, above.holder, collider))
    elif one.type == "Camera":
        found.cameras.append((one, above.body))
    elif one.type == "NewtonActuator":
        found.actuators.append(one)
    elif one.type == POSE:
        found.poses.append(one)
    elif one.type in CONTAINERS:
        above = _below(one, above, str(parent.GetPath()), found)
    else:
        found.others.append(one)
    for child in prim.GetFilteredChildren(Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)):
        _sort(child, above, found, book)


def _below(one: Prim, above: Above, parent: str, found: Sorted) -> Above:
    """A prim that only holds others: a group, what names a shape, or a frame without anything."""
    collider = one if one.has("PhysicsCollisionAPI") else above.collider
    below = replace(above, collider=collider)
    name, empty = str(one.prim.GetName()), not one.prim.GetAllChildren()
    own = one.prim.IsInstance() or not empty
    if parent == above.body and above.body and name in GROUPS and one.name == name:
        below = replace(below, group=name)
        found.others.append(one)
    elif above.group and above.holder is None and own:
        below = replace(below, holder=one)
        found.others.append(one)
    elif parent == above.body and above.body and one.type == "Xform":
        found.frames.append((one, above.body))
    else:
        found.others.append(one)
    one.placed()
    return below


# --- bodies ----------------------------------------------------------------------------------


def _bodies(
    bodies: dict[str, Prim],
    joints: list[JointPrim],
    names: dict[str, str],
    places: Places,
    book: Writer,
) -> None:
    tree = [joint for joint in joints if not joint.closes_loop]
    parents = {j.child: j.parent for j in tree if j.parent and j.child}
    for path, prim in bodies.items():
        name, units = names[path], places.units
        above = parents.get(path, "")
        facts: dict[str, Value] = {"parent": names.get(above, ""), "usd:type": prim.type}
        if above in bodies:
            facts["pose"] = _within(places, prim, bodies[above])
        book.put("body", name, facts | _mass(prim, places))
        lengths = {"maxLinearVelocity": units.metre, "maxDepenetrationVelocity": units.metre}
        lengths["maxAngularVelocity"] = units.length(True)
        rows = {a: (f"{a}", lengths.get(word, 1.0)) for a, word in RIGID_BODY.items()}
        prim.words("body", name, rows, "PhysxRigidBodyAPI")
        weightless = "physxRigidBody:disableGravity"
        if prim.prim.HasAttribute(weightless) and prim.flag(weightless, "PhysxRigidBodyAPI"):
            book.put("body", name, {"usd:physxRigidBody:disableGravity": True})
        prim.placed()


def _within(places: Places, prim: Prim, above: Prim) -> tuple[float, ...]:
    outer, _ = places.rigid(above.prim)
    inner, _ = places.rigid(prim.prim)
    return pose_value(outer.inverse() @ inner)


def _camera(prim: Prim, above: Prim | None, body: str, places: Places, book: Writer) -> None:
    """What it sees follows from the ratios of its apertures to its focal length."""
    pose = _within(places, prim, above) if above else pose_value(places.rigid(prim.prim)[0])
    length, tall, wide = (
        prim.number(name) or float(prim.prim.GetAttribute(name).Get()) or math.nan
        for name in ("focalLength", "verticalAperture", "horizontalAperture")
    )  # the schema has defaults of its own
    near: Any = prim.take("clippingRange")  # Any: a Gf vector
    book.put("camera", prim.named("camera"), {
        "body": body,
        "pose": pose,
        "field of view": 2.0 * math.atan(tall / (2.0 * length)),
        "usd:aspect": wide / tall,
        "usd:clippingRange": None if near is None else tuple(float(v) for v in near),
    })  # fmt: skip
    prim.placed()


def _mass(prim: Prim, places: Places) -> dict[str, Value]:
    """Mass properties in the body's frame; a scaled body's tensor is in units of nobody's."""
    units, (_, scale) = places.units, places.rigid(prim.prim)
    schema = "PhysicsMassAPI"
    mass = prim.number("physics:mass", schema, units.kilogram)
    facts: dict[str, Value] = {"mass": mass or 0.0}
    center = prim.take("physics:centerOfMass", schema)
    moments = prim.take("physics:diagonalInertia", schema)
    name = "physics:principalAxes"
    axes = prim.turned(name, prim.take(name, schema))
    if center is not None:
        point = np.array(center, dtype=np.float64) * scale * units.metre
        facts["centre of mass"] = tuple(float(v) for v in point)
    if moments is not None:
        unit = units.inertia(True)
        xx, yy, zz = (float(v) * unit for v in moments)  # type: ignore[attr-defined] # a Gf vector
        diagonal = (xx, yy, zz, 0.0, 0.0, 0.0)
        facts["inertia"] = tuple(rotate_tensor(diagonal, quat_of_gf(axes)))
        if axes is None:  # which runtimes take for no turn, though USD's own is no rotation at all
            facts["usd:principalAxes"] = "not stated"
        if not np.allclose(scale, 1.0):
            prim.book.skip(prim.path, "physics:diagonalInertia", f"of a body scaled by {scale}")
    return facts


# --- the root --------------------------------------------------------------------------------


def _articulated(found: Sorted) -> set[str]:
    """Paths of bodies that carry the articulation."""
    return {p for p, prim in found.bodies.items() if "PhysicsArticulationRootAPI" in prim.applied}


def _root(
    top: Usd.Prim,
    found: Sorted,
    joints: list[JointPrim],
    names: dict[str, str],
    places: Places,
    book: Writer,
) -> None:
    """Whether the base is held, where, and what carries the articulation."""
    carriers = [prim for prim in _all(found) if prim.has("PhysicsArticulationRootAPI")]
    for prim in carriers:
        _articulation(prim, book)
    world = {joint.prim.path for joint in joints if not joint.parent}
    roots = [
        "the joint with the world" if prim.path in world
        else f"body {names[prim.path]}" if prim.path in names
        else prim.path
        for prim in carriers
    ]  # fmt: skip
    held_bodies = [j for j in joints if j.holds_base]
    facts: dict[str, Value] = {
        "base": "fixed" if held_bodies else "floating",
        "articulation root": ", ".join(roots),
    }
    children = {j.child for j in joints if j.parent and not j.closes_loop}
    first = next((prim for path, prim in found.bodies.items() if path not in children), None)
    if first is not None:
        facts["base pose"] = pose_value(places.rigid(first.prim)[0])
    robot, scale = places.rigid(top)
    book.put("robot", "", facts | {"usd:robot prim pose": pose_value(robot)})
    if not np.allclose(scale, 1.0):
        book.put("robot", "", {"usd:scale of the robot prim": tuple(map(float, scale))})
    for joint in held_bodies:
        pose: Pose = joint.X_parent_child
        book.put("robot", "", {
            "usd:world joint holds": names.get(joint.child, ""),
            "usd:world joint pose": pose_value(pose),
        })  # fmt: skip
    kind = str(Usd.ModelAPI(top).GetKind())
    book.put("stage", "", {"usd:kind": kind, "usd:type": str(top.GetTypeName())})
    for prim in found.others:
        if prim.prim == top:
            prim.metadata.pop("kind", None)
            shown = prim.metadata.pop("displayName", None)
            book.put("stage", "", {
                "usd:displayName": None if shown is None else str(shown),
                "usd:extentsHint": _hint(prim),
            })  # fmt: skip


def _hint(robot: Prim) -> str | None:
    """Whether the hint is the bounds by purpose, in words."""
    stated = robot.take("extentsHint", "GeomModelAPI")
    if stated is None:
        return None
    purposes = UsdGeom.Imageable.GetOrderedPurposeTokens()
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), purposes)
    bounds = np.array(UsdGeom.ModelAPI(robot.prim).ComputeExtentsHint(cache))
    found = np.array(stated, dtype=np.float64).reshape(-1, 3)
    if found.shape == bounds.shape and np.allclose(found, bounds, rtol=HINT, atol=HINT):
        return "its bounds"
    told = [" ".join(f"{value:.6g}" for value in box.flat) for box in (found, bounds)]
    return f"({told[0]}) for bounds of ({told[1]})"


def _articulation(prim: Prim, book: Writer) -> None:
    schema = "PhysxArticulationAPI"
    flag = prim.flag("physxArticulation:enabledSelfCollisions", schema)
    newton = prim.flag("newton:selfCollisionEnabled", "NewtonArticulationRootAPI")
    touching = newton if flag is None else flag
    if touching is not None:
        book.put("robot", "", {"self-collision": touching})
    book.put("robot", "", {"usd:newton:selfCollisionEnabled": newton})
    rows = {
        f"physxArticulation:{word}": (f"physxArticulation:{word}", 1.0) for word in ARTICULATION
    }
    prim.words("robot", "", rows, schema)
