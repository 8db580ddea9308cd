"""What kind of robot this is: legs, feet, wheels, sensors, and so whether its base is bolted down.

Heuristics, judged at the pose where every joint is 0; each says its reason, which goes into the
recipe for the user to judge.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from assetbuild.init.look import Looked
from assetbuild.robot.model import Base, Joint, Tree
from assetbuild.robot.pose import Pose
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
_WHEEL = re.compile(r"(?i).*(wheel|caster).*")
_FLYING = re.compile(r"(?i).*(propeller|flying|drone|copter|quadrotor|hector|iris).*")
_PROP = re.compile(r"(?i)(.*[_/-])?prop_?\d*([_-].*)?")
"""Of which something that flies has several: a gripper may have one prop, too."""
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

    X_root_foot: at the zero pose. soles: links that may touch the floor, the foot among them.
    """

    joints: tuple[Joint, ...]
    tip: str
    foot: str
    X_root_foot: Pose
    soles: tuple[str, ...]


@dataclass(frozen=True)
class BaseChoice:
    """Floating or fixed, and why."""

    kind: Base
    reason: str


@dataclass(frozen=True)
class Anatomy:
    """sensors: kind -> names of source links. size_m: largest extent of the links' origins."""

    base: BaseChoice
    legs: tuple[Leg, ...]
    sensors: Mapping[str, tuple[str, ...]]
    size_m: float


def study(robot: Looked) -> Anatomy:
    """Look the robot over."""
    tree = robot.tree
    at_zero = forward_kinematics(robot.links, {})
    origins = np.array([pose.xyz for pose in at_zero.values()])
    size = float(np.ptp(origins, axis=0).max())
    legs = _legs(robot, at_zero)
    return Anatomy(
        _base(robot, legs, at_zero), legs, _sensors(robot.links), size if tree.joints else 0.0
    )


def chain_to(tree: Tree, body: str) -> tuple[Joint, ...]:
    """The joints from the root down to a body."""
    chain: list[Joint] = []
    while body in tree.joint_above:
        joint = tree.joint_above[body]
        chain.append(joint)
        body = joint.parent
    return tuple(chain[::-1])


# --- legs -----------------------------------------------------------------------------------


def _legs(robot: Looked, at_zero: Mapping[str, Pose]) -> tuple[Leg, ...]:
    """Limbs of at least two joints that reach down to the lowest level; at least two alike."""
    tree = robot.tree
    limbs = [_limb(robot, at_zero, tip) for tip in _leaves(tree)]
    tips = [pose.xyz[2] for pose in at_zero.values()]
    height = max(tips) - min(tips)
    lowest = min((limb.X_root_foot.xyz[2] for limb in limbs), default=0.0)
    down = []
    for limb in limbs:
        if len(limb.joints) < 2 or _is_wheel(limb) or _is_arm(limb):
            continue
        start, end = at_zero[limb.joints[0].child].xyz[2], limb.X_root_foot.xyz[2]
        if end - lowest <= LOW * height and start - end >= REACH * height:
            down.append(limb)
    alike = Counter(_likeness(limb) for limb in down)
    return tuple(limb for limb in down if alike[_likeness(limb)] >= 2)


def _is_wheel(limb: Leg) -> bool:
    """What turns without end at the tip of a limb, and is not called a part of a leg."""
    last = limb.joints[-1]
    return last.kind == "continuous" and (
        _WHEEL.fullmatch(last.child + last.name) is not None or not _LEG.fullmatch(last.child)
    )


def _is_arm(limb: Leg) -> bool:
    """By its words: hanging arms reach low, and some dogs have shoulders."""
    words = _words(limb)
    return any(map(_ARM.fullmatch, words)) and not any(map(_LEG.fullmatch, words))


def _words(limb: Leg) -> list[str]:
    return [limb.foot, *(joint.child for joint in limb.joints)]


def _called_legs(robot: Looked, at_zero: Mapping[str, Pose]) -> tuple[str, ...]:
    """Tips of four limbs or more that are called legs, wherever they point at the zero pose."""
    limbs = [_limb(robot, at_zero, tip) for tip in _leaves(robot.tree)]
    named = [
        limb
        for limb in limbs
        if len(limb.joints) >= 2 and not _is_wheel(limb) and _LEG.fullmatch(limb.joints[-1].child)
    ]
    alike = Counter(_likeness(limb) for limb in named)
    return tuple(limb.tip for limb in named if alike[_likeness(limb)] >= 4)


def _likeness(limb: Leg) -> tuple[str, ...]:
    return tuple(joint.kind for joint in limb.joints)


def _leaves(tree: Tree) -> list[str]:
    parents = {joint.parent for joint in tree.joints}
    return [body.name for body in tree.bodies if body.name not in parents]


def _is_spring(tree: Tree, joint: Joint) -> bool:
    """A last body on a joint that nothing drives, as Cassie's heel: no limb of its own."""
    return joint.limits.effort == 0.0 and joint.child in _leaves(tree)


def _limb(robot: Looked, at_zero: Mapping[str, Pose], tip: str) -> Leg:
    """The chain from the last body where the robot branches to `tip`."""
    tree = robot.tree
    branches: dict[str, int] = defaultdict(int)
    for joint in tree.joints:
        branches[joint.parent] += not _is_spring(tree, joint)
    joints: list[Joint] = []
    for joint in chain_to(tree, tip)[::-1]:
        if joint.mimic is None and joint.kind in ("revolute", "continuous", "prismatic"):
            joints.append(joint)
        if branches[joint.parent] > 1:
            break
    foot = _foot(robot, at_zero, tip)
    return Leg(
        tuple(joints[::-1]),
        tip,
        foot,
        at_zero[foot],
        _soles(robot, tip, foot, len(joints)),
    )


def _soles(robot: Looked, tip: str, foot: str, joints: int) -> tuple[str, ...]:
    """With an ankle the whole last body; else the foot and what holds it to the shank."""
    solid = {shape.link for shape in robot.shapes.of("collision")} or {
        shape.link for shape in robot.shapes.of("visual")
    }
    links = [b.name for b in robot.links.bodies if robot.tree.placement(b.name)[0] == tip]
    if joints < ANKLE:
        above = set(_holders(robot.links, foot, tip))
        links = [link for link in links if link in above and not _SHANK.fullmatch(link)]
    return tuple(link for link in links if link in solid) or (foot,)


def _holders(links: Tree, foot: str, tip: str) -> Iterator[str]:
    """The foot and the links between it and the tip, which is the shank."""
    link = foot
    while True:
        yield link
        joint = links.joint_above.get(link)
        if link == tip or joint is None or joint.kind != "fixed" or joint.parent == tip:
            return
        link = joint.parent


def _foot(robot: Looked, at_zero: Mapping[str, Pose], tip: str) -> str:
    """The link of the tip that touches the ground: with collision, called a foot, lowest."""
    links = [b.name for b in robot.links.bodies if robot.tree.placement(b.name)[0] == tip]
    solid = {shape.link for shape in robot.shapes.of("collision")} or {
        shape.link for shape in robot.shapes.of("visual")
    }
    return max(
        links,
        key=lambda link: (
            link in solid,
            _FOOT.fullmatch(link) is not None,
            -round(at_zero[link].xyz[2], 6),
            -links.index(link),
        ),
    )


# --- base and sensors -----------------------------------------------------------------------


def _base(robot: Looked, legs: tuple[Leg, ...], at_zero: Mapping[str, Pose]) -> BaseChoice:
    links, tree = robot.links, robot.tree
    if links.root.lower() in _WORLD:
        return BaseChoice("fixed", f"the root link is called `{links.root}`")
    if legs:
        feet = ", ".join(leg.foot for leg in legs)
        return BaseChoice("floating", f"{len(legs)} legs of like joints reach the ground: {feet}")
    rolling = [
        joint.child
        for joint in tree.joints
        if joint.kind == "continuous" and _WHEEL.fullmatch(joint.child + joint.name)
    ]
    if len(rolling) >= 2:
        return BaseChoice("floating", f"it rolls on {len(rolling)} wheels: {', '.join(rolling)}")
    names = [links.name, *(body.name for body in links.bodies)]
    props = [name for name in names[1:] if _PROP.fullmatch(name)]
    flying = [name for name in names if _FLYING.fullmatch(name)] + props[: len(props) // 2]
    if flying:
        return BaseChoice("floating", f"it flies, by the name of `{flying[0]}`")
    if walking := _called_legs(robot, at_zero):
        reason = f"{', '.join(walking[:4])}: legs by their names, but at 0 they do not reach down"
        return BaseChoice("floating", reason)
    if not tree.moving_joints:
        return BaseChoice("floating", "nothing moves in it: a loose object")
    return BaseChoice("fixed", f"no legs and no wheels: an arm or a hand, bolted at `{tree.root}`")


def _sensors(links: Tree) -> dict[str, tuple[str, ...]]:
    """Frames that people look for, by kind."""
    found: dict[str, tuple[str, ...]] = {}
    for kind, pattern in SENSORS.items():
        names = tuple(body.name for body in links.bodies if re.fullmatch(pattern, body.name))
        if names:
            found[kind] = names
    return found
