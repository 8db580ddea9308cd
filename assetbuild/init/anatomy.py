"""What kind of robot this is: legs, feet, wheels, sensors, and so whether its base is bolted down.

Heuristics, judged at the pose where every joint is 0; each says its reason, which goes into the
recipe for the user to judge.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from assetbuild.init.look import InspectedRobot
from assetbuild.robot.model import MOVING, Base, Joint, Tree
from assetbuild.robot.pose import Pose, vec3
from assetbuild.robot.shapes import Capsule, Cylinder, Sphere
from assetbuild.robot.tree import forward_kinematics

SENSORS: Mapping[str, str] = {
    "IMU": r"(?i)(.*[_-])?(imu|gyro|accelerometer)([_0-9-].*)?",
    "camera": r"(?i).*(camera|optical|realsense|rgbd|d435|depth|zed|stereo).*",
    "lidar": r"(?i).*(lidar|laser|hokuyo|velodyne|mid360|livox).*",
    "tool": r"(?i)(.*[_-])?(tool0?|tcp|ee|flange|end_effector|grasp\w*)([_-](link|frame))?",
}
"""Kind of frame -> names that it usually has."""

_FOOT = re.compile(r"(?i).*(foot|feet|sole|toe|ankle_roll).*")
_ARM = re.compile(r"(?i).*(arm|shoulder|elbow|wrist|hand|grip|finger|thumb|nub).*")
_LEG = re.compile(r"(?i).*(leg|foot|hip|knee|ankle|thigh|calf|shank).*")
_SHANK = re.compile(r"(?i).*(shank|shin|calf|thigh|leg|knee).*")
WHEEL = re.compile(r"(?i).*(wheel|caster).*")
_FLYING = re.compile(r"(?i).*(propeller|flying|drone|copter|quadrotor|hector|iris).*")
_PROP = re.compile(r"(?i)(.*[_/-])?prop_?\d*([_-].*)?")
"""Something that flies has several of these; a gripper may have one `prop`, too."""
_WORLD = ("world", "map", "odom", "universe")

LOW = 0.15
"""A foot is within this share of the robot's height above its lowest tip."""
ANKLE = 5
"""A leg with as many joints can lay its foot flat on the ground."""
REACH = 0.25
"""A leg reaches down by at least this share of the robot's height."""


@dataclass(frozen=True)
class Leg:
    """joints: moving joints from the trunk down. tip: its last body; foot: the source link there.

    X_tip_foot: where it touches the ground, about; X_root_foot: the same at the zero pose.
    soles: links that may touch the floor, the foot among them.
    """

    joints: tuple[Joint, ...]
    tip: str
    foot: str
    X_tip_foot: Pose
    X_root_foot: Pose
    soles: tuple[str, ...]

    @property
    def length(self) -> float:
        """From the first joint to the foot, stretched out, m."""
        ways = [joint.X_parent_joint.xyz for joint in self.joints[1:]]
        return math.fsum(math.hypot(*way) for way in (*ways, self.X_tip_foot.xyz))


@dataclass(frozen=True)
class Anatomy:
    """base_reason: why it is floating or fixed. sensors: kind -> names of source links.

    size_m: largest extent of the links' origins. called_legs: of a robot that stands on none at
    the zero pose, limbs that must be legs by their names.
    """

    base: Base
    base_reason: str
    legs: tuple[Leg, ...]
    sensors: Mapping[str, tuple[str, ...]]
    size_m: float
    called_legs: tuple[Leg, ...] = ()

    @property
    def walks_on(self) -> tuple[Leg, ...]:
        """The limbs that carry the robot, however they point at the zero pose."""
        return self.legs or self.called_legs


def study(robot: InspectedRobot) -> Anatomy:
    """Look the robot over."""
    tree = robot.tree
    at_zero = forward_kinematics(robot.links, {})
    origins = np.array([pose.xyz for pose in at_zero.values()])
    extent = np.ptp(origins, axis=0)
    limbs = [_limb(robot, at_zero, tip) for tip in _leaves(tree)]
    legs = _legs(limbs, at_zero, float(extent[2]))
    size = float(extent.max()) if tree.joints else 0.0
    base, reason = _base(robot, legs, limbs)
    called = () if legs or base == "fixed" else _called_legs(limbs)
    return Anatomy(base, reason, legs, _sensors(robot.links), size, called)


def chain_to(tree: Tree, body: str) -> tuple[Joint, ...]:
    """The joints from the root down to a body."""
    chain: list[Joint] = []
    while body in tree.joint_above:
        joint = tree.joint_above[body]
        chain.append(joint)
        body = joint.parent
    return tuple(chain[::-1])


# --- legs -----------------------------------------------------------------------------------


def _legs(limbs: list[Leg], at_zero: Mapping[str, Pose], height: float) -> tuple[Leg, ...]:
    """Limbs of at least two joints that reach down to the lowest level; at least two alike."""
    lowest = min((limb.X_root_foot.xyz[2] for limb in limbs), default=0.0)
    down = []
    for limb in limbs:
        if _can_walk(limb) and not _is_arm(limb):
            start, end = at_zero[limb.joints[0].child].xyz[2], limb.X_root_foot.xyz[2]
            if end - lowest <= LOW * height and start - end >= REACH * height:
                down.append(limb)
    return _alike(down, 2)


def _called_legs(limbs: list[Leg]) -> tuple[Leg, ...]:
    """Four limbs or more that are called legs, wherever they point at the zero pose."""
    named = [limb for limb in limbs if _can_walk(limb) and _LEG.fullmatch(limb.joints[-1].child)]
    return _alike(named, 4)


def _alike(limbs: list[Leg], least: int) -> tuple[Leg, ...]:
    """Those of which there are at least so many with the same kinds of joints."""
    kinds = [tuple(joint.kind for joint in limb.joints) for limb in limbs]
    return tuple(limb for limb, own in zip(limbs, kinds, strict=True) if kinds.count(own) >= least)


def _can_walk(limb: Leg) -> bool:
    """It bends, and is no wheel: what turns without end at the tip, unless it is called a leg."""
    if len(limb.joints) < 2:
        return False
    last = limb.joints[-1]
    called_leg = _LEG.fullmatch(last.child) and not WHEEL.fullmatch(last.child + last.name)
    return last.kind != "continuous" or bool(called_leg)


def _is_arm(limb: Leg) -> bool:
    """Judge by the names of its links: hanging arms reach low, and some dogs have shoulders."""
    words = [limb.foot, *(joint.child for joint in limb.joints)]
    return any(map(_ARM.fullmatch, words)) and not any(map(_LEG.fullmatch, words))


def _leaves(tree: Tree) -> list[str]:
    parents = {joint.parent for joint in tree.joints}
    return [body.name for body in tree.bodies if body.name not in parents]


def _limb(robot: InspectedRobot, at_zero: Mapping[str, Pose], tip: str) -> Leg:
    """The chain from the last body where the robot branches to `tip`."""
    tree, leaves = robot.tree, _leaves(robot.tree)
    # A last body on a joint that nothing drives, as Cassie's heel, is no limb of its own.
    # Where no joint states an effort, 0 says nothing.
    states = any(j.limits.effort for j in tree.joints)
    idle = [j for j in tree.joints if states and j.limits.effort == 0.0]
    springs = {j.name for j in idle if j.child in leaves}
    branches = Counter(joint.parent for joint in tree.joints if joint.name not in springs)
    joints: list[Joint] = []
    for joint in chain_to(tree, tip)[::-1]:
        if joint.mimic is None and joint.kind in MOVING:
            joints.append(joint)
        if branches[joint.parent] > 1:
            break
    links, solid = robot.links_of(tip), robot.solid_links
    foot = max(
        links,
        key=lambda link: (  # what touches the ground: with collision, called a foot, lowest
            link in solid,
            _FOOT.fullmatch(link) is not None,
            -round(at_zero[link].xyz[2], 6),
            -links.index(link),
        ),
    )
    if len(joints) < ANKLE:
        holders = set(_holders(robot.links, foot, tip))
        links = [link for link in links if link in holders and not _SHANK.fullmatch(link)]
    soles = tuple(link for link in links if link in solid) or (foot,)
    X_tip_foot = tree.placement(foot)[1]
    if foot == tip and len(joints) < ANKLE:
        X_tip_foot = _lowest_end(robot, tip, at_zero[tip])
    return Leg(tuple(joints[::-1]), tip, foot, X_tip_foot, at_zero[tip] @ X_tip_foot, soles)


def _lowest_end(robot: InspectedRobot, shank: str, X_root_shank: Pose) -> Pose:
    """Where a shank without a foot of its own ends: its lowest ball or end of a capsule.

    Its own frame, which is the knee, where it has no such shape.
    """
    ends = []
    for shape in robot.shapes.of("collision"):
        if shape.link == shank and isinstance(shape.geometry, Sphere | Capsule | Cylinder):
            half = 0.0 if isinstance(shape.geometry, Sphere) else shape.geometry.length / 2.0
            ends += [shape.X_link_shape.apply((0.0, 0.0, side * half)) for side in (-1.0, 1.0)]
    lowest = min(ends, key=lambda end: float(X_root_shank.apply(end)[2]), default=(0.0, 0.0, 0.0))
    return Pose(vec3(lowest))


def _holders(links: Tree, foot: str, tip: str) -> Iterator[str]:
    """The foot and the links between it and the tip, which is the shank."""
    link = foot
    while True:
        yield link
        joint = links.joint_above.get(link)
        if link == tip or joint is None or joint.kind != "fixed" or joint.parent == tip:
            return
        link = joint.parent


# --- base and sensors -----------------------------------------------------------------------


def _base(robot: InspectedRobot, legs: tuple[Leg, ...], limbs: list[Leg]) -> tuple[Base, str]:
    links, tree = robot.links, robot.tree
    if robot.floats:
        return "floating", "a floating joint holds it to an empty root link"
    if links.root.lower() in _WORLD:
        return "fixed", f"the root link is called `{links.root}`"
    first = links.by_joint.get(f"{robot.planar[0]}_x") if robot.planar else None
    if first and first.parent == links.root and links.by_body[links.root].is_massless:
        return "fixed", f"the planar joint `{robot.planar[0]}` moves it over the plane of its root"
    if legs:
        feet = ", ".join(leg.foot for leg in legs)
        return "floating", f"{len(legs)} legs of like joints reach the ground: {feet}"
    rolling = [
        joint.child
        for joint in tree.joints
        if joint.kind == "continuous" and WHEEL.fullmatch(joint.child + joint.name)
    ]
    if len(rolling) >= 2:
        return "floating", f"it rolls on {len(rolling)} wheels: {', '.join(rolling)}"
    names = [links.name, *links.by_body]
    props = [name for name in names[1:] if _PROP.fullmatch(name)]
    flying = [name for name in names if _FLYING.fullmatch(name)] + props[: len(props) // 2]
    if flying:
        return "floating", f"it flies, by the name of `{flying[0]}`"
    if walking := _called_legs(limbs):
        named = ", ".join(leg.tip for leg in walking[:4])
        return "floating", f"{named}: legs by their names, but at 0 they do not reach down"
    if not tree.moving_joints:
        return "floating", "nothing moves in it: a loose object"
    return "fixed", f"no legs and no wheels: an arm or a hand, bolted at `{tree.root}`"


def _sensors(links: Tree) -> dict[str, tuple[str, ...]]:
    """Frames that people look for, by kind."""
    found = {
        kind: tuple(name for name in links.by_body if re.fullmatch(pattern, name))
        for kind, pattern in SENSORS.items()
    }
    return {kind: names for kind, names in found.items() if names}
