"""Tiny robots as model values: no reader, no mesh tool, every number known by hand.

`tiny_quadruped()` stands on four ball feet with 12 joints, `pendulum()` hangs from the world;
`random_robots` has Hypothesis strategies of random trees; `robot_files` lays robots out for steps.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from assetbuild.robot.model import (
    Actuator,
    ActuatorModel,
    Body,
    Contact,
    Control,
    Frame,
    Inertial,
    Joint,
    JointKind,
    Keyframe,
    Limits,
    Loop,
    LoopEnd,
    Mimic,
    MjcfOnly,
    Simulation,
    Tree,
)
from assetbuild.robot.pose import IDENTITY, Pose, Vec3, normalised_quat, vec3
from assetbuild.robot.shapes import (
    Box,
    Capsule,
    Cylinder,
    Material,
    Mesh,
    MeshAsset,
    Shape,
    Shapes,
    SourceShapes,
    Sphere,
)

SEGMENT_M = 0.2
FOOT_RADIUS_M = 0.02


@dataclass(frozen=True)
class TinyRobot:
    """The four artefacts and the mesh files `{file name: bytes}`."""

    links: Tree
    tree: Tree
    shapes: Shapes | SourceShapes = field(default_factory=Shapes)
    control: Control = field(default_factory=Control)
    meshes: dict[str, bytes] = field(default_factory=dict)


# --- inertias, from textbook formulas -----------------------------------------------------------


def box_inertial(mass: float, size: Vec3, com: Vec3 = (0.0, 0.0, 0.0)) -> Inertial:
    """A solid box. mass: kg; size: edges, m."""
    x, y, z = (mass * edge * edge / 12.0 for edge in size)
    return Inertial(mass, com, (y + z, x + z, x + y, 0.0, 0.0, 0.0))


def ball_inertial(mass: float, radius: float, com: Vec3 = (0.0, 0.0, 0.0)) -> Inertial:
    """A solid ball."""
    moment = 0.4 * mass * radius * radius
    return Inertial(mass, com, (moment, moment, moment, 0.0, 0.0, 0.0))


def with_point_offset(a: Inertial, b: Inertial, offset: Vec3) -> Inertial:
    """Two bodies as one, in the frame of `a`; `b` is moved by `offset`, its axes are parallel.

    About the common centre of mass the pair adds mu (|d|^2 1 - d d^T), mu = reduced mass, d = the
    way between the two centres.
    """
    com_a, com_b = np.array(a.com_m), np.array(b.com_m) + np.array(offset)
    mass = a.mass_kg + b.mass_kg
    d = com_b - com_a
    pair = a.mass_kg * b.mass_kg / mass * (d @ d * np.eye(3) - np.outer(d, d))
    own = np.array(a.inertia_com_kg_m2) + np.array(b.inertia_com_kg_m2)
    xx, yy, zz, xy, xz, yz = (
        float(v)
        for v in own + [pair[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    )
    com = vec3((a.mass_kg * com_a + b.mass_kg * com_b) / mass)
    return Inertial(mass, com, (xx, yy, zz, xy, xz, yz))


# --- meshes -------------------------------------------------------------------------------------


def box_obj(size: Vec3) -> bytes:
    """A closed box as OBJ text, 8 vertices, 12 triangles, outward normals."""
    x, y, z = (edge / 2 for edge in size)
    corners = [(sx * x, sy * y, sz * z) for sx in (-1, 1) for sy in (-1, 1) for sz in (-1, 1)]
    quads = ((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4))
    lines = [f"v {a!r} {b!r} {c!r}" for a, b, c in corners]
    for a, b, c, d in quads:
        lines += [f"f {a} {b} {c}", f"f {a} {c} {d}"]
    return ("\n".join(lines) + "\n").encode()


def stl(corners: np.ndarray, header: bytes = b"", count: int | None = None) -> bytes:
    """A binary STL. corners: (n, 3, 3) m. count: what its header states, n unless given."""
    record = np.zeros(len(corners), dtype=[("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    record["c"] = corners
    stated = len(corners) if count is None else count
    return header.ljust(80, b" ") + struct.pack("<I", stated) + record.tobytes()


def flat_obj() -> bytes:
    """A single open square in the plane z = 0: area but no volume."""
    return b"v 0 0 0\nv 0.1 0 0\nv 0.1 0.1 0\nv 0 0.1 0\nf 1 2 3\nf 1 3 4\n"


# --- robots -------------------------------------------------------------------------------------

LEGS: tuple[tuple[str, float, float], ...] = (
    ("FR", 1.0, -1.0),
    ("FL", 1.0, 1.0),
    ("RR", -1.0, -1.0),
    ("RL", -1.0, 1.0),
)


def standing_height(thigh: float) -> float:
    """Base height with hip 0, thigh q and calf -2 q: both segments lean by q."""
    return 2 * SEGMENT_M * math.cos(thigh) + FOOT_RADIUS_M


def tiny_quadruped() -> TinyRobot:
    """12 joints, 13 bodies; `trunk_box.obj` as visual; feet and `imu` are merged frames."""
    trunk = box_inertial(6.0, (0.4, 0.2, 0.1))
    imu = box_inertial(0.01, (0.01, 0.01, 0.01))
    X_trunk_imu = Pose((0.05, 0.01, 0.02), normalised_quat((1.0, 0.0, 0.0, 1.0)))
    thigh = box_inertial(0.8, (0.03, 0.03, SEGMENT_M), (0.0, 0.0, -SEGMENT_M / 2))
    calf = box_inertial(0.15, (0.02, 0.02, SEGMENT_M), (0.0, 0.0, -SEGMENT_M / 2))
    foot = ball_inertial(0.05, FOOT_RADIUS_M)
    to_foot = (0.0, 0.0, -SEGMENT_M)

    links: list[Body] = [Body("trunk", trunk), Body("imu", imu)]
    bodies: list[Body] = [Body("trunk", with_point_offset(trunk, imu, X_trunk_imu.xyz))]
    fixed: list[Joint] = [Joint("imu_joint", "fixed", "trunk", "imu", X_trunk_imu)]
    moving: list[Joint] = []
    frames: list[Frame] = [Frame("imu", "trunk", X_trunk_imu)]
    for leg, front, left in LEGS:
        hip = box_inertial(0.5, (0.06, 0.06, 0.06), (0.0, left * 0.005, 0.0))
        links += [Body(f"{leg}_hip", hip), Body(f"{leg}_thigh", thigh), Body(f"{leg}_calf", calf)]
        links.append(Body(f"{leg}_foot", foot))
        bodies += [Body(f"{leg}_hip", hip), Body(f"{leg}_thigh", thigh)]
        bodies.append(Body(f"{leg}_calf", with_point_offset(calf, foot, to_foot)))
        moving += _leg_joints(leg, front, left)
        fixed.append(
            Joint(f"{leg}_foot_fixed", "fixed", f"{leg}_calf", f"{leg}_foot", Pose(to_foot))
        )
        frames.append(Frame(f"{leg}_foot", f"{leg}_calf", Pose(to_foot)))
    return TinyRobot(
        links=Tree("tiny_quadruped", "floating", tuple(links), tuple(moving + fixed)),
        tree=Tree("tiny_quadruped", "floating", tuple(bodies), tuple(moving), tuple(frames)),
        shapes=_quadruped_shapes(),
        control=_quadruped_control(tuple(moving)),
        meshes={"trunk_box.obj": box_obj((0.4, 0.2, 0.1))},
    )


def bolted(robot: TinyRobot) -> TinyRobot:
    """The same robot on a fixed base."""
    tree, links = (replace(one, base="fixed") for one in (robot.tree, robot.links))
    keys = tuple(replace(key, base=None) for key in robot.control.keyframes)
    return with_control(replace(robot, tree=tree, links=links), keyframes=keys)


def _leg_joints(leg: str, front: float, left: float) -> list[Joint]:
    hip, thigh, calf = (f"{leg}_{part}" for part in ("hip", "thigh", "calf"))
    x, y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    at_trunk, at_hip = Pose((front * 0.18, left * 0.05, 0.0)), Pose((0.0, left * 0.08, 0.0))
    rows = (
        ("trunk", hip, at_trunk, x, Limits(-0.86, 0.86, 24.0, 30.0)),
        (hip, thigh, at_hip, y, Limits(-0.7, 4.5, 24.0, 30.0)),
        (thigh, calf, Pose((0.0, 0.0, -SEGMENT_M)), y, Limits(-2.8, -0.9, 36.0, 20.0)),
    )
    return [
        Joint(f"{child}_joint", "revolute", parent, child, X_parent_joint, axis, limits)
        for parent, child, X_parent_joint, axis, limits in rows
    ]


def _quadruped_shapes() -> Shapes:
    middle = Pose((0.0, 0.0, -SEGMENT_M / 2))
    shapes = [
        Shape("trunk_visual", "trunk", "visual", Mesh("trunk_box"), material="grey"),
        Shape("imu_visual", "imu", "visual", Box((0.01, 0.01, 0.01)), material="red"),
        Shape("trunk_collision", "trunk", "collision", Box((0.4, 0.2, 0.1))),
    ]
    for leg, _, _ in LEGS:
        shapes += [
            Shape(f"{leg}_hip_collision", f"{leg}_hip", "collision", Cylinder(0.03, 0.04)),
            Shape(
                f"{leg}_thigh_collision", f"{leg}_thigh", "collision", Capsule(0.015, 0.15), middle
            ),
            Shape(f"{leg}_calf_collision", f"{leg}_calf", "collision", Capsule(0.01, 0.12), middle),
            Shape(f"{leg}_foot_collision", f"{leg}_foot", "collision", Sphere(FOOT_RADIUS_M)),
        ]
    return Shapes(
        tuple(shapes),
        (Material("grey", (0.4, 0.4, 0.4, 1.0)), Material("red", (1.0, 0.0, 0.0, 1.0))),
        (MeshAsset("trunk_box", "trunk_box.obj", 8, 12, convex=True),),
    )


def _quadruped_control(joints: tuple[Joint, ...]) -> Control:
    actuators = tuple(
        Actuator(
            joint.name,
            "pd",
            kp=100.0,
            kd=3.0,
            damping=0.1,
            friction=0.2,
            armature=0.01 if joint.limits.effort == 24.0 else 0.02,
            effort=joint.limits.effort,
            velocity=joint.limits.velocity,
            motor="small" if joint.limits.effort == 24.0 else "large",
            source="made up",
        )
        for joint in joints
    )
    pairs = tuple(sorted({(min(j.parent, j.child), max(j.parent, j.child)) for j in joints}))
    return Control(
        actuators,
        (_stance("home", joints, 0.8), _stance("crouch", joints, 1.2)),
        pairs,
        Contact(friction=(0.8, 0.02, 0.01)),
        simulation=Simulation(),
    )


def _stance(name: str, joints: tuple[Joint, ...], thigh: float) -> Keyframe:
    angle = {"hip": 0.0, "thigh": thigh, "calf": -2 * thigh}
    values = tuple((joint.name, angle[joint.name.split("_")[1]]) for joint in joints)
    return Keyframe(name, values, Pose((0.0, 0.0, standing_height(thigh))))


def with_drives(robot: TinyRobot, **changes: object) -> TinyRobot:
    """The same robot; every drive has these values."""
    drives = tuple(replace(drive, **changes) for drive in robot.control.actuators)  # type: ignore[arg-type] # each field's own type
    return replace(robot, control=replace(robot.control, actuators=drives))


def turned(robot: TinyRobot) -> TinyRobot:
    """The same robot; its keyframes turn a floating base about no axis of the world."""
    turn = normalised_quat((0.9, 0.1, 0.2, 0.3))
    keyframes = tuple(
        replace(key, base=key.base and Pose((0.1, 0.2, key.base.xyz[2]), turn))
        for key in robot.control.keyframes
    )
    return replace(robot, control=replace(robot.control, keyframes=keyframes))


def with_base(robot: TinyRobot, lift: float) -> TinyRobot:
    """The same robot; its keyframes hold a floating base higher by `lift`, m."""
    keys = []
    for key in robot.control.keyframes:
        assert key.base
        x, y, z = key.base.xyz
        keys.append(replace(key, base=Pose((x, y, z + lift), key.base.quat)))
    return with_control(robot, keyframes=tuple(keys))


def odd_drives(robot: TinyRobot) -> TinyRobot:
    """The same robot without keyframes; its joints are in turn a motor without a limit, a dc motor
    with a stall torque of 70 N m, a general drive and passive."""
    models: tuple[ActuatorModel, ...] = ("motor", "dc_motor", "general", "passive")
    drives = []
    for index, drive in enumerate(robot.control.actuators):
        drive = replace(drive, model=models[index % 4])
        if drive.model == "motor":
            drive = replace(drive, effort=None)
        if drive.model == "dc_motor":
            drive = replace(drive, stall=70.0)
        drives.append(drive)
    control = replace(robot.control, actuators=tuple(drives), keyframes=())
    return replace(robot, control=control)


def pendulum() -> TinyRobot:
    """A fixed base and one swinging arm of 1 kg, 0.5 m; torque drive, limits +-2 rad, 5 N m."""
    arm = box_inertial(1.0, (0.02, 0.02, 0.5), (0.0, 0.0, -0.25))
    joint = Joint(
        "swing_joint",
        "revolute",
        "base",
        "arm",
        Pose((0.0, 0.0, 1.0)),
        (0.0, 1.0, 0.0),
        Limits(-2.0, 2.0, 5.0, 10.0),
        damping=0.05,
    )
    tree = Tree("pendulum", "fixed", (Body("base"), Body("arm", arm)), (joint,))
    middle = Pose((0.0, 0.0, -0.25))
    shapes = Shapes((Shape("arm_collision", "arm", "collision", Capsule(0.01, 0.4), middle),))
    control = Control(
        (Actuator("swing_joint", "motor", damping=0.05, effort=5.0, velocity=10.0),),
        (Keyframe("home", (("swing_joint", 0.0),)),),
    )
    return TinyRobot(tree, tree, shapes, control)


def sprung(stiffness: str = "6", rest: float = 0.5) -> TinyRobot:
    """The pendulum on a spring instead of a motor. stiffness: N m/rad; rest: rad."""
    robot = pendulum()
    drive = Actuator("swing_joint", "passive", damping=0.5, velocity=10.0)
    words = f'<joint stiffness="{stiffness}" springref="{rest!r}"/>'
    spring = MjcfOnly("joint", words, "swing_joint")
    return replace(robot, control=replace(robot.control, actuators=(drive,), mjcf_only=(spring,)))


CRANK_M, COUPLER_M, ROCKER_M, GROUND_M = 0.1, 0.2, 0.15, 0.2


def four_bar(kind: Literal["connect", "weld"] = "connect") -> TinyRobot:
    """A crank, a coupler and a rocker on a base, about y; the loop closes coupler and rocker.

    Of a `weld` the base is the ground itself, and its one way to close leaves no motion.
    """
    bars = {"crank": CRANK_M, "coupler": COUPLER_M, "rocker": ROCKER_M}
    bodies = [Body("base", box_inertial(1.0, (0.4, 0.02, 0.02)))]
    for name, length in bars.items():
        size = (length, 0.02, 0.02)
        bodies.append(Body(name, box_inertial(0.2, size, (length / 2, 0.0, 0.0))))
    y, limits = (0.0, 1.0, 0.0), Limits(-3.0, 3.0, effort=5.0, velocity=10.0)
    joints = (
        Joint("crank_joint", "revolute", "base", "crank", IDENTITY, y, limits),
        Joint("coupler_joint", "revolute", "crank", "coupler", Pose((CRANK_M, 0, 0)), y, limits),
        Joint("rocker_joint", "revolute", "base", "rocker", Pose((GROUND_M, 0, 0)), y, limits),
    )
    ends = (
        LoopEnd("coupler", Pose((COUPLER_M, 0.0, 0.0))),
        LoopEnd("rocker", Pose((ROCKER_M, 0, 0))),
    )
    control = Control(
        actuators=(
            Actuator("crank_joint", "pd", kp=20.0, kd=0.5, effort=5.0),
            Actuator("coupler_joint", "passive"),
            Actuator("rocker_joint", "passive"),
        ),
        loops=(Loop("coupler_loop", kind, *ends),),
    )
    tree = Tree("four_bar", "fixed", tuple(bodies), joints)
    shapes = Shapes(
        tuple(Shape(f"{n}_bar", n, "visual", Box((x, 0.02, 0.02))) for n, x in bars.items())
    )
    return TinyRobot(tree, tree, shapes, control)


def with_control(robot: TinyRobot, **fields: Any) -> TinyRobot:
    """The same robot, controlled otherwise. fields: of `Control`."""
    return replace(robot, control=replace(robot.control, **fields))


def with_mimic(
    robot: TinyRobot, follower: str, leader: str, multiplier: float, offset: float
) -> TinyRobot:
    """The same robot; `follower` now copies `leader`."""
    joints = tuple(
        replace(j, mimic=Mimic(leader, multiplier, offset)) if j.name == follower else j
        for j in robot.tree.joints
    )
    return replace(robot, tree=replace(robot.tree, joints=joints))


def with_kinds(robot: TinyRobot, **kinds: JointKind) -> TinyRobot:
    """The same robot; these joints are of other kinds, a continuous one without its range."""
    joints = tuple(
        replace(j, kind=kinds[j.name], limits=replace(j.limits, lower=None, upper=None))
        if kinds.get(j.name) == "continuous"
        else replace(j, kind=kinds.get(j.name, j.kind))
        for j in robot.tree.joints
    )
    return replace(robot, tree=replace(robot.tree, joints=joints))
