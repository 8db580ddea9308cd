"""The robot on a stage: every prim sorted by what it is, and read.

The stage is read as it composes, into instances; what is inactive or abstract does not act.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics

from assetbuild.facts.reference import pose_value
from assetbuild.facts.table import Table, Value
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
class StageRobot:
    """A robot on a stage: its prims by what they are, and what they say.

    bodies: by path; shapes, frames and cameras: with the path of their body. names: of bodies by
    path.
    """

    stage: Usd.Stage
    places: Places
    table: Table
    bodies: dict[str, Prim] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)
    joints: list[JointPrim] = field(default_factory=list)
    shapes: list[ShapePrim] = field(default_factory=list)
    frames: list[tuple[Prim, str]] = field(default_factory=list)
    cameras: list[tuple[Prim, str]] = field(default_factory=list)
    actuators: list[Prim] = field(default_factory=list)
    roots: list[Prim] = field(default_factory=list)
    filters: list[tuple[str, str]] = field(default_factory=list)

    @property
    def prim(self) -> Prim:
        """The default prim, which is the robot."""
        return Prim(self.stage.GetDefaultPrim())

    def pose(self, prim: Prim, body: str = "") -> tuple[float, ...]:
        """Where a prim is in a body, by its path; without one in the world."""
        X_world_prim, _ = self.places.rigid(prim.prim)
        if body not in self.bodies:
            return pose_value(X_world_prim)
        X_world_body, _ = self.places.rigid(self.bodies[body].prim)
        return pose_value(X_world_body.inverse() @ X_world_prim)


def read_robot(path: Path) -> Table:
    """The facts of the stage as it opens, its default variants selected."""
    with opened(path) as stage:
        table = Table()
        Prim.asked.clear()
        robot = StageRobot(stage, Places(units_of(stage, table)), table)
        prims = list(map(Prim, Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())))
        _sort(prims, robot)
        joint_facts(robot.joints, table)
        jointed = {joint.prim.path: joint.prim.name for joint in robot.joints}
        for prim in robot.actuators:
            driven = tuple(jointed.get(path, path) for path in prim.targets("newton:targets"))
            table.put("actuator", prim.named("actuator", table), {"usd:drives": driven})
        _bodies(robot)
        for prim, body in robot.frames:
            facts: dict[str, Value] = {"body": robot.names[body], "pose": robot.pose(prim, body)}
            table.put("frame", prim.named("frame", table), facts)
        for prim, body in robot.cameras:
            _camera(prim, body, robot)
        _root(robot)
        colliders = read_shapes(robot.shapes, robot.names, robot.places, table)
        apart = [j.ends for j in robot.joints if len(j.ends) == 2 and not j.touching]
        articulated = [prim.path for prim in robot.roots if prim.path in robot.bodies]
        pair_facts(colliders, robot.names, robot.filters, apart, articulated, table)
        _named_poses(robot)
        table.put("robot", "", _listed(robot))
        subjects = {path: subject for subject, path in table.places.items()}
        for each in prims:
            above = _upwards(each.prim, itself=True)
            owners = (subjects[path] for path in above if path in subjects)
            table.put(*next(owners, ("prim", each.path)), each.words())
        return table


# --- sorting


def _sort(prims: Sequence[Prim], robot: StageRobot) -> None:
    """Each prim by what it is; a body may be its own shape."""
    joints = []
    for one in prims:
        prim, parent = one.prim, str(one.prim.GetParent().GetPath())
        body = next((path for path in _upwards(prim) if path in robot.bodies), "")
        if one.has("PhysicsRigidBodyAPI"):
            robot.bodies[one.path] = one
            body = one.path
        if prim.IsA(UsdPhysics.Joint):
            joints.append(one)
        elif prim.IsA(UsdGeom.Gprim):
            robot.shapes.append(_shape(one, body))
        elif one.type == "Camera":
            robot.cameras.append((one, body))
        elif one.type == "NewtonActuator":
            robot.actuators.append(one)
        elif one.type == "Xform" and parent == body and prim.GetName() not in GROUPS:
            robot.frames.append((one, body))
        if one.has(ROOT):
            robot.roots.append(one)
        pairs = one.targets("physics:filteredPairs", "PhysicsFilteredPairsAPI")
        robot.filters += [(one.path, target) for target in pairs]
    robot.names |= {path: prim.named("body", robot.table) for path, prim in robot.bodies.items()}
    robot.joints += [JointPrim(prim, robot.names, robot.places) for prim in joints]


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


def _bodies(robot: StageRobot) -> None:
    parents = {
        j.child: j.parent for j in robot.joints if j.parent and j.child and not j.closes_loop
    }
    for path, prim in robot.bodies.items():
        above = parents.get(path, "")
        facts: dict[str, Value] = {"parent": robot.names.get(above, "")}
        if above in robot.bodies:
            facts["pose"] = robot.pose(prim, above)
        robot.table.put("body", robot.names[path], facts | _mass(prim, robot.places))


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


def _camera(prim: Prim, body: str, robot: StageRobot) -> None:
    """What it sees follows from the ratios of its apertures to its focal length."""
    length, tall, wide = (
        float(prim.prim.GetAttribute(name).Get()) or math.nan
        for name in ("focalLength", "verticalAperture", "horizontalAperture")
    )  # the schema has defaults of its own
    robot.table.put("camera", prim.named("camera", robot.table), {
        "body": robot.names.get(body, ""),
        "pose": robot.pose(prim, body),
        "field of view": 2.0 * math.atan(tall / (2.0 * length)),
        "usd:aspect": wide / tall,
        "usd:depths": prim.numbers("clippingRange", unit=robot.places.units.metre),
    })  # fmt: skip


# --- the root


def _root(robot: StageRobot) -> None:
    """Whether the base is held, where, and what carries the articulation."""
    world = {joint.prim.path for joint in robot.joints if not joint.parent}
    roots = [
        "the joint with the world" if prim.path in world
        else f"body {robot.names[prim.path]}" if prim.path in robot.names
        else prim.path
        for prim in robot.roots
    ]  # fmt: skip
    held_bodies = [joint for joint in robot.joints if joint.holds_base]
    facts: dict[str, Value] = {
        "base": "fixed" if held_bodies else "floating",
        "articulation root": ", ".join(roots),
        "usd:robot prim pose": robot.pose(robot.prim),
    }
    children = {j.child for j in robot.joints if j.parent and not j.closes_loop}
    for prim in [prim for path, prim in robot.bodies.items() if path not in children][:1]:
        facts["base pose"] = robot.pose(prim)
    for joint in held_bodies:
        robot.table.place("robot", "", joint.prim.path)
        facts["usd:world joint holds"] = robot.names.get(joint.child, "")
        facts["usd:world joint pose"] = pose_value(joint.X_parent_child)
    for prim in robot.roots:
        touching = prim.flag("physxArticulation:enabledSelfCollisions", "PhysxArticulationAPI")
        facts["self-collision"] = touching is not False  # PhysX's own default
    robot.table.put("robot", "", facts)


def _named_poses(robot: StageRobot) -> None:
    """Keyframes in rad and m, which Isaac Sim's robot schema has."""
    by_path = {joint.prim.path: joint for joint in robot.joints}
    for path in robot.prim.targets("isaac:robot:namedPoses", "IsaacRobotAPI"):
        pose = Prim(robot.stage.GetPrimAtPath(path))
        posed = [by_path.get(each) for each in pose.targets("isaac:robot:pose:joints")]
        values = pose.numbers("isaac:robot:pose:jointValues") or ()
        for joint, value in zip(posed, values, strict=True):
            if joint is not None:
                position = value * joint.units.length(joint.angular)
                subject = f"{pose.name}/{joint.prim.name}"
                robot.table.put("keyframe", subject, {"position": position})


def _listed(robot: StageRobot) -> dict[str, Value]:
    """Names of links, sites and joints in the order in which Isaac Sim's tools show them, what kind
    of robot it is, and what it is to libraries of assets."""
    metadata = robot.stage.GetRootLayer().customLayerData.get("SimReady_Metadata", {})
    lists: dict[str, Value] = {
        "usd:isaac:robotType": robot.prim.text("isaac:robotType", "IsaacRobotAPI"),
        "usd:kind": Usd.ModelAPI(robot.prim.prim).GetKind(),
        **{f"usd:{word}": metadata.get(word) for word in ("mass", "rigid_body_count")},
    }
    for word, (override, schemas) in LISTS.items():
        paths = robot.prim.targets(f"isaac:physics:{word}", "IsaacRobotAPI")
        there = [Prim(prim) for path in paths if (prim := robot.stage.GetPrimAtPath(path))]
        prims = [prim for prim in there if prim.applied & schemas]
        if prims:
            lists[f"usd:isaac:{word}"] = tuple(
                prim.name if prim.has("IsaacSiteAPI")
                else prim.text(override) or str(prim.prim.GetName())
                for prim in prims
            )  # fmt: skip
    return lists
