"""The robot on a stage: every prim sorted by what it is, and read.

The stage is read as it composes, into instances; what is inactive or abstract does not act.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics

from assetbuild.facts.reference import pose_value
from assetbuild.facts.table import FactCollector, Table, Value
from assetbuild.facts.usd_joints import JointPrim, joint_facts
from assetbuild.facts.usd_prims import Places, Prim, opened, quat_of_gf, units_of
from assetbuild.facts.usd_shapes import ShapePrim, pair_facts, read_shapes
from assetbuild.robot.inertia import rotate_tensor

GROUPS = ("visuals", "collisions")
"""Groups of shapes below a body, which are no frames."""
ROOT = "PhysicsArticulationRootAPI"
LISTS = {
    "robotLinks": ("isaac:nameOverride", {"IsaacLinkAPI", "IsaacSiteAPI"}),
    "robotJoints": ("isaac:NameOverride", {"IsaacJointAPI"}),
}
"""Lists of Isaac Sim's robot schema -> what says a name that is no identifier, and the schemas of
which each member has one."""


@dataclass
class Sorted:
    """The prims of a robot by what they are; bodies by path, the others with that of their body."""

    bodies: dict[str, Prim] = field(default_factory=dict)
    joints: list[Prim] = field(default_factory=list)
    shapes: list[ShapePrim] = field(default_factory=list)
    frames: list[tuple[Prim, str]] = field(default_factory=list)
    cameras: list[tuple[Prim, str]] = field(default_factory=list)
    actuators: list[Prim] = field(default_factory=list)
    roots: list[Prim] = field(default_factory=list)
    filters: list[tuple[str, str]] = field(default_factory=list)
    prims: list[Prim] = field(default_factory=list)


def read_robot(path: Path) -> Table:
    """The facts of the stage as it opens, its default variants selected."""
    with opened(path) as stage:
        collector = FactCollector()
        Prim.asked.clear()
        places, contents = Places(units_of(stage, collector)), _sorted(stage)
        names = {path: prim.named("body", collector) for path, prim in contents.bodies.items()}
        joints = [JointPrim(prim, names, places) for prim in contents.joints]
        joint_facts(joints, collector)
        jointed = {joint.prim.path: joint.prim.name for joint in joints}
        for prim in contents.actuators:
            driven = tuple(jointed.get(path, path) for path in prim.targets("newton:targets"))
            collector.put("actuator", prim.named("actuator", collector), {"usd:drives": driven})
        _bodies(contents.bodies, joints, names, places, collector)
        for prim, body in contents.frames:
            pose, name = (
                _within(places, prim, contents.bodies[body]),
                prim.named("frame", collector),
            )
            collector.put("frame", name, {"body": names[body], "pose": pose})
        for prim, body in contents.cameras:
            _camera(prim, contents.bodies.get(body), names.get(body, ""), places, collector)
        robot = Prim(stage.GetDefaultPrim())
        _root(contents, joints, names, places, collector)
        collector.put("robot", "", {"usd:robot prim pose": pose_value(places.rigid(robot.prim)[0])})
        colliders = read_shapes(contents.shapes, names, places, collector)
        apart = [j.ends for j in joints if len(j.ends) == 2 and not j.touching]
        articulated = [prim.path for prim in contents.roots if prim.path in contents.bodies]
        pair_facts(colliders, names, contents.filters, apart, articulated, collector)
        _named_poses(robot, joints, collector)
        collector.put("robot", "", _listed(robot))
        subjects = {path: subject for subject, path in collector.places.items()}
        for each in contents.prims:
            owners = (
                subjects[path] for path in _upwards(each.prim, itself=True) if path in subjects
            )
            collector.put(*next(owners, ("prim", each.path)), each.words())
        return collector.table()


# --- sorting


def _sorted(stage: Usd.Stage) -> Sorted:
    contents = Sorted()
    for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()):
        one = Prim(prim)
        contents.prims.append(one)
        _sort(one, contents)
        if one.has(ROOT):
            contents.roots.append(one)
        pairs = one.targets("physics:filteredPairs", "PhysicsFilteredPairsAPI")
        contents.filters += [(one.path, target) for target in pairs]
    return contents


def _sort(one: Prim, contents: Sorted) -> None:
    """A body may be its own shape."""
    prim, parent = one.prim, str(one.prim.GetParent().GetPath())
    body = next((path for path in _upwards(prim) if path in contents.bodies), "")
    if one.has("PhysicsRigidBodyAPI"):
        contents.bodies[one.path] = one
        body = one.path
    if prim.IsA(UsdPhysics.Joint):
        contents.joints.append(one)
    elif prim.IsA(UsdGeom.Gprim):
        contents.shapes.append(_shape(one, body))
    elif one.type == "Camera":
        contents.cameras.append((one, body))
    elif one.type == "NewtonActuator":
        contents.actuators.append(one)
    elif one.type == "Xform" and parent == body and prim.GetName() not in GROUPS:
        contents.frames.append((one, body))


def _shape(one: Prim, body: str) -> ShapePrim:
    """Below a group of shapes the prim next to the group has the name."""
    above = [Prim(one.prim.GetStage().GetPrimAtPath(path)) for path in _upwards(one.prim)]
    collider = next((prim for prim in (one, *above) if prim.has("PhysicsCollisionAPI")), None)
    groups = [f"{body}/{name}" for name in GROUPS] if body else []
    holder = next((p for p in above if str(p.prim.GetParent().GetPath()) in groups), None)
    return ShapePrim(one, body, holder, collider)


def _upwards(prim: Usd.Prim, *, itself: bool = False) -> Iterator[str]:
    """Paths of the prims above, the nearest first."""
    path = prim.GetPath() if itself else prim.GetPath().GetParentPath()
    while path and not path.IsAbsoluteRootPath():
        yield str(path)
        path = path.GetParentPath()


# --- bodies


def _bodies(
    bodies: Mapping[str, Prim],
    joints: Sequence[JointPrim],
    names: Mapping[str, str],
    places: Places,
    collector: FactCollector,
) -> None:
    parents = {j.child: j.parent for j in joints if j.parent and j.child and not j.closes_loop}
    for path, prim in bodies.items():
        above = parents.get(path, "")
        facts: dict[str, Value] = {"parent": names.get(above, "")}
        if above in bodies:
            facts["pose"] = _within(places, prim, bodies[above])
        facts |= _mass(prim, places)
        collector.put("body", names[path], facts)


def _within(places: Places, prim: Prim, above: Prim) -> tuple[float, ...]:
    outer, _ = places.rigid(above.prim)
    inner, _ = places.rigid(prim.prim)
    return pose_value(outer.inverse() @ inner)


def _mass(prim: Prim, places: Places) -> dict[str, Value]:
    """Mass properties in the body's frame; a scale moves the centre and leaves the tensor."""
    units, (_, scale) = places.units, places.rigid(prim.prim)
    schema = "PhysicsMassAPI"
    facts: dict[str, Value] = {"mass": prim.number("physics:mass", schema, units.kilogram) or 0.0}
    centre = prim.numbers("physics:centerOfMass", schema, units.metre)
    moments = prim.numbers("physics:diagonalInertia", schema, units.inertia(True))
    if centre is not None:
        facts["centre of mass"] = tuple((np.array(centre) * scale).tolist())
    if moments is not None:
        axes = quat_of_gf(prim.value("physics:principalAxes", schema))
        xx, yy, zz = moments
        facts["inertia"] = tuple(rotate_tensor((xx, yy, zz, 0.0, 0.0, 0.0), axes))
    return facts


def _camera(
    prim: Prim, above: Prim | None, body: str, places: Places, collector: FactCollector
) -> None:
    """What it sees follows from the ratios of its apertures to its focal length."""
    pose = _within(places, prim, above) if above else pose_value(places.rigid(prim.prim)[0])
    length, tall, wide = (
        float(prim.prim.GetAttribute(name).Get()) or math.nan
        for name in ("focalLength", "verticalAperture", "horizontalAperture")
    )  # the schema has defaults of its own
    collector.put("camera", prim.named("camera", collector), {
        "body": body,
        "pose": pose,
        "field of view": 2.0 * math.atan(tall / (2.0 * length)),
        "usd:aspect": wide / tall,
        "usd:depths": prim.numbers("clippingRange", unit=places.units.metre),
    })  # fmt: skip


# --- the root


def _root(
    contents: Sorted,
    joints: Sequence[JointPrim],
    names: Mapping[str, str],
    places: Places,
    collector: FactCollector,
) -> None:
    """Whether the base is held, where, and what carries the articulation."""
    world = {joint.prim.path for joint in joints if not joint.parent}
    roots = [
        "the joint with the world" if prim.path in world
        else f"body {names[prim.path]}" if prim.path in names
        else prim.path
        for prim in contents.roots
    ]  # fmt: skip
    held_bodies = [joint for joint in joints if joint.holds_base]
    facts: dict[str, Value] = {
        "base": "fixed" if held_bodies else "floating",
        "articulation root": ", ".join(roots),
    }
    children = {j.child for j in joints if j.parent and not j.closes_loop}
    first = next((prim for path, prim in contents.bodies.items() if path not in children), None)
    if first is not None:
        facts["base pose"] = pose_value(places.rigid(first.prim)[0])
    for joint in held_bodies:
        collector.place("robot", "", joint.prim.path)
        facts["usd:world joint holds"] = names.get(joint.child, "")
        facts["usd:world joint pose"] = pose_value(joint.X_parent_child)
    for prim in contents.roots:
        touching = prim.flag("physxArticulation:enabledSelfCollisions", "PhysxArticulationAPI")
        facts["self-collision"] = touching is not False  # PhysX's own default
    collector.put("robot", "", facts)


def _named_poses(robot: Prim, joints: Sequence[JointPrim], collector: FactCollector) -> None:
    """Keyframes in rad and m, which Isaac Sim's robot schema has."""
    by_path = {joint.prim.path: joint for joint in joints}
    for path in robot.targets("isaac:robot:namedPoses", "IsaacRobotAPI"):
        pose = Prim(robot.prim.GetStage().GetPrimAtPath(path))
        posed = [by_path.get(each) for each in pose.targets("isaac:robot:pose:joints")]
        values = pose.numbers("isaac:robot:pose:jointValues") or ()
        for joint, value in zip(posed, values, strict=True):
            if joint is not None:
                position = value * joint.units.length(joint.angular)
                collector.put("keyframe", f"{pose.name}/{joint.prim.name}", {"position": position})


def _listed(robot: Prim) -> dict[str, Value]:
    """Names of links, sites and joints in the order in which Isaac Sim's tools show them, what kind
    of robot it is, and what it is to libraries of assets."""
    stage, lists = robot.prim.GetStage(), dict[str, Value]()
    metadata = stage.GetRootLayer().customLayerData.get("SimReady_Metadata", {})
    lists["usd:isaac:robotType"] = robot.text("isaac:robotType", "IsaacRobotAPI")
    lists["usd:kind"] = Usd.ModelAPI(robot.prim).GetKind()
    for word in ("mass", "rigid_body_count"):
        lists[f"usd:{word}"] = metadata.get(word)
    for word, (override, schemas) in LISTS.items():
        paths = robot.targets(f"isaac:physics:{word}", "IsaacRobotAPI")
        there = [Prim(prim) for path in paths if (prim := stage.GetPrimAtPath(path))]
        prims = [prim for prim in there if prim.applied & schemas]
        if prims:
            lists[f"usd:isaac:{word}"] = tuple(
                prim.name if prim.has("IsaacSiteAPI")
                else prim.text(override) or str(prim.prim.GetName())
                for prim in prims
            )  # fmt: skip
    return lists
