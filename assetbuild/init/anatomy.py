"""What a robot is and what its joints are part of: legs, wheels, rotors, fingers, sensors.

And so whether its base is bolted down. Heuristics, judged at the pose where every joint is 0; each
says its reason, which goes into the recipe for the user to judge.
"""

from __future__ import annotations

import itertools
import math
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from assetbuild.init.look import InspectedRobot
from assetbuild.init.wheels import (
    SWIVEL,
    Turning,
    TurningRole,
    bodies_below,
    turns_freely,
    what_turns,
)
from assetbuild.robot.model import MOVING, Base, Joint, Tree
from assetbuild.robot.pose import Pose, vec3
from assetbuild.robot.shapes import Capsule, Cylinder, Sphere
from assetbuild.robot.tree import chain_to

Role = TurningRole | Literal["leg", "finger", "arm"]

SENSORS: Mapping[str, str] = {
    "IMU": r"(?i)(.*[_-])?(imu|gyro|accelerometer)([_0-9-].*)?",
    "camera": r"(?i).*(camera|optical|realsense|rgbd|d435|depth|zed|stereo).*",
    "lidar": r"(?i).*(lidar|laser|hokuyo|velodyne|mid360|livox).*",
    "tool": r"(?i)(.*[_-])?(tool0?|tcp|ee|flange|end_effector|grasp\w*)([_-](link|frame))?",
}
"""Kind of frame -> names that it usually has."""

_FOOT = re.compile(r"(?i).*(foot|feet|sole|toe|ankle_roll).*")
_ARM = re.compile(r"(?i).*(arm|shoulder|elbow|wrist|hand|grip|finger|thumb|nub).*")
_LEG = re.compile(r"(?i).*(leg|foot|toe|hip|knee|ankle|thigh|calf|shank|coxa|femur|tibia).*")
_WALKER = re.compile(r"(?i).*(hexapod|quadruped|octopod|spider).*")
_SHANK = re.compile(r"(?i).*(shank|shin|calf|thigh|leg|knee|femur|tibia).*")
_FINGER = re.compile(r"(?i).*(finger|thumb|grip|palm|knuckle|digit|pinky|pinkie|phalan|hand).*")
_PRESSES = re.compile(r"(?i).*(finger|thumb|grip|knuckle|digit|pink|phalan|jaw|claw|pinch|clamp).*")
"""A part that holds things against its palm, where it is the only one."""
_NO_HAND = re.compile(rf"{_LEG.pattern}|.*(head|neck|antenna|tail).*")
_FLYING = re.compile(
    r"(?i).*(propeller|flying|aerial|drone|copter|(quad|hexa|octo|multi)rotor|hector|iris).*"
)
_WORLD = ("world", "map", "odom", "universe")

LOW = 0.15
"""A foot is within this share of the robot's height above its lowest tip."""
ANKLE = 5
"""A leg with as many joints can lay its foot flat on the ground."""
TIP_M = 0.01
"""Points of a shank within this distance of its last one are its tip."""
GEAR_SHARE = 0.04
"""A part that weighs less than this share of its heaviest neighbour on a body is a gear or rod."""
REACH = 0.25
"""A leg reaches down by at least this share of the robot's height."""
_LIGHT_KG, _SHORT_M = 0.4, 0.25
"""A limb that is lighter and shorter is a finger, whatever it is called."""


@dataclass(frozen=True)
class Leg:
    """joints: moving joints from the trunk down. tip: its last body; foot: the source link there.

    A wheel at its end is its foot: neither its joint nor its body is of the leg.
    X_tip_foot: where it touches the ground, about; X_root_foot: the same at the zero pose.
    soles: links that may touch the floor, the foot among them.
    """

    joints: tuple[Joint, ...]
    tip: str
    foot: str
    X_tip_foot: Pose
    X_root_foot: Pose
    soles: tuple[str, ...]
    rolls: bool = False

    @property
    def length(self) -> float:
        """Length from the first joint to the foot, stretched out, m."""
        ways = [joint.X_parent_joint.xyz for joint in self.joints[1:]]
        return math.fsum(math.hypot(*way) for way in (*ways, self.X_tip_foot.xyz))


@dataclass(frozen=True)
class Anatomy:
    """base_reason: why it is floating or fixed. sensors: kind -> names of source links.

    size_m: largest extent of the links' origins. called_legs: of a robot that stands on none at
    the zero pose, limbs that must be legs by their names. turning: by joint, what turns without
    end. doubt: what of the robot matches nothing known and what to decide, else "".
    """

    base: Base
    base_reason: str
    legs: tuple[Leg, ...]
    sensors: Mapping[str, tuple[str, ...]]
    size_m: float
    called_legs: tuple[Leg, ...] = ()
    turning: Mapping[str, Turning] = field(default_factory=dict, hash=False)
    doubt: str = ""

    @property
    def walks_on(self) -> tuple[Leg, ...]:
        """The limbs that carry the robot, however they point at the zero pose."""
        return self.legs or self.called_legs


def study(robot: InspectedRobot) -> Anatomy:
    """Look the robot over."""
    tree = robot.tree
    extent = np.ptp([pose.xyz for pose in robot.at_zero.values()], axis=0)
    turning = what_turns(robot)
    wheels = frozenset(name for name, part in turning.items() if part.role == "wheel")
    gears = _gear_joints(tree)
    limbs = [
        _limb(robot, tip, wheels, gears)
        for tip in _leaves(tree)
        if gears.isdisjoint(joint.name for joint in chain_to(tree, tip))
    ]
    legs = _legs(robot, limbs, float(extent[2]))
    size = float(extent.max()) if tree.joints else 0.0
    base, reason = _moves(robot, legs, turning, limbs) or _stays(robot)
    doubt = DOUBT.format(root=tree.root) if reason == UNKNOWN else ""
    doubt = MILLIMETRES.format(size=size) if size > FARTHEST_M else doubt
    legs = () if base == "fixed" else legs  # what is bolted stands on nothing
    called = () if legs or base == "fixed" else _called_legs(limbs, robot.links.name)
    links = robot.links.by_body
    named = {kind: tuple(filter(re.compile(SENSORS[kind]).fullmatch, links)) for kind in SENSORS}
    sensors = {kind: names for kind, names in named.items() if names}
    return Anatomy(base, reason, legs, sensors, size, called, turning, doubt)


def roles(tree: Tree, anatomy: Anatomy) -> dict[str, Role]:
    """What each moving joint is part of, by the robot's anatomy, its names and its size."""
    legs = {joint.name for leg in anatomy.walks_on for joint in leg.joints}
    carries = {j.name for w in anatomy.turning for j in chain_to(tree, tree.by_joint[w].child)}
    role_of: dict[str, Role] = {joint.name: "arm" for joint in tree.moving_joints}
    for joint in tree.moving_joints:
        called = _FINGER.fullmatch(f"{joint.name} {joint.child}")
        if joint.name in legs:
            role_of[joint.name] = "leg"
        elif joint.name in anatomy.turning:
            role_of[joint.name] = anatomy.turning[joint.name].role
        elif _is_small(tree, joint.child if called else limb_of(tree, joint)):
            # No finger: what a leg or a head carries, an arm or rod of a walker, a wheel's strut.
            above = chain_to(tree, joint.child)
            arm = _ARM.fullmatch(joint.child) and not _PRESSES.fullmatch(joint.child)
            on_trunk = tree.joint_above[limb_of(tree, joint)].parent == tree.root
            limb = legs and (arm or on_trunk)
            other = any(p.name in legs or _NO_HAND.fullmatch(p.child) for p in above)
            if joint.name not in carries and (called or not (other or limb)):
                role_of[joint.name] = "finger"
    return role_of | dict.fromkeys(_alone(tree, role_of), "arm")


def _alone(tree: Tree, role_of: Mapping[str, Role]) -> Iterator[str]:
    """Joints of what looks like a finger but has no other to press against, nor a finger's name."""
    at_palm, palm_of = dict[str, list[Joint]](), dict[str, str]()
    for joint in tree.moving_joints:  # parents first
        if role_of[joint.name] == "finger":
            palm = palm_of[joint.child] = palm_of.get(joint.parent, joint.parent)
            at_palm.setdefault(palm, []).append(joint)
    for joints in at_palm.values():
        held = {joint.parent for joint in joints}
        ends = [joint for joint in joints if joint.child not in held]
        if len(ends) < 2 and not any(_PRESSES.fullmatch(f"{j.name} {j.child}") for j in joints):
            yield from (joint.name for joint in joints)


def limb_of(tree: Tree, joint: Joint) -> str:
    """The body after the last branch above a joint: fingers are limbs of their own."""
    children = Counter(other.parent for other in tree.moving_joints)
    chain = chain_to(tree, joint.child)
    branching = (j for j in chain[::-1] if children[j.parent] > 1 or j.parent == tree.root)
    return next(branching).child


def _is_small(tree: Tree, body: str) -> bool:
    """Whether what hangs on a body is as light and short as a finger."""
    below = bodies_below(tree, body)
    masses = [i.mass_kg for name in below if (i := tree.by_body[name].inertial)]
    return math.fsum(masses) < _LIGHT_KG and length_below(tree, body) < _SHORT_M


def length_below(tree: Tree, body: str) -> float:
    """Length from a body's origin to the furthest end of what hangs on it, stretched out; m."""
    longest, at = _own_length(tree, body), {body: 0.0}
    for joint in tree.joints:
        if joint.parent in at:
            at[joint.child] = at[joint.parent] + math.hypot(*joint.X_parent_joint.xyz)
            longest = max(longest, at[joint.child] + _own_length(tree, joint.child))
    return longest


def _own_length(tree: Tree, body: str) -> float:
    """About how far a body reaches beyond its origin: twice the way to its centre of mass."""
    inertial = tree.by_body[body].inertial
    return 2.0 * float(np.linalg.norm(inertial.com_m)) if inertial else 0.0


# --- legs -----------------------------------------------------------------------------------


def _legs(robot: InspectedRobot, limbs: list[Leg], height: float) -> tuple[Leg, ...]:
    """Limbs of two joints or more that reach the lowest level: two alike, or four called arms."""
    lowest = min((limb.X_root_foot.xyz[2] for limb in limbs), default=0.0)
    down = []
    for limb in filter(lambda limb: _can_walk(limb, robot), limbs):
        start, end = robot.at_zero[limb.joints[0].child].xyz[2], limb.X_root_foot.xyz[2]
        if end - lowest <= LOW * height and start - end >= REACH * height > 0.0:
            down.append(limb)
    named = [limb for limb in down if not _PRESSES.fullmatch(limb.tip)]
    return _alike([limb for limb in down if not _is_arm(limb)], 2) or _alike(named, 4)


def _called_legs(limbs: list[Leg], robot: str) -> tuple[Leg, ...]:
    """Limbs called legs, or a hexapod's, wherever they point: four, or a humanoid's two."""
    walks, able = _WALKER.fullmatch(robot), [limb for limb in limbs if _can_walk(limb)]
    called = (any(map(_LEG.fullmatch, (leg.foot, leg.joints[-1].child))) for leg in able)
    named = [leg for leg, called_so in zip(able, called, strict=True) if walks or called_so]
    return _alike(named, 4) or _alike([leg for leg in named if len(leg.joints) >= ANKLE], 2)


def _alike(limbs: list[Leg], least: int) -> tuple[Leg, ...]:
    """Those of which there are at least so many with the same kinds of joints."""
    kinds = [tuple(joint.kind for joint in limb.joints) for limb in limbs]
    return tuple(itertools.compress(limbs, (kinds.count(kind) >= least for kind in kinds)))


def _can_walk(limb: Leg, robot: InspectedRobot | None = None) -> bool:
    """It bends, and its last joint has an end, unless it is called a leg.

    robot: of a limb with a wheel or without any stop: two joints must swing it, as no steering.
    """
    if len(limb.joints) < 2:
        return False
    last, kinds = limb.joints[-1], {joint.kind for joint in limb.joints}
    if robot is not None and (limb.rolls or kinds == {"continuous"}):
        return sum(abs(float(robot.axis_of(joint)[2])) < SWIVEL for joint in limb.joints) >= 2
    return last.kind != "continuous" or bool(_LEG.fullmatch(last.child))


def _is_arm(limb: Leg) -> bool:
    """Judge by the names of its links: hanging arms reach low, and some dogs have shoulders."""
    words = [limb.foot, *(joint.child for joint in limb.joints)]
    return any(map(_ARM.fullmatch, words)) and not any(map(_LEG.fullmatch, words))


def _leaves(tree: Tree) -> list[str]:
    parents = {joint.parent for joint in tree.joints}
    return [body.name for body in tree.bodies if body.name not in parents]


def _gear_joints(tree: Tree) -> frozenset[str]:
    """Return the joints that carry gears, rods and bearings, which are light beside a limb."""
    below_kg = {b.name: b.inertial.mass_kg if b.inertial else 0.0 for b in tree.bodies}
    heaviest_kg = dict.fromkeys(below_kg, 0.0)
    for joint in reversed(tree.joints):  # children first
        below_kg[joint.parent] += below_kg[joint.child]
        heaviest_kg[joint.parent] = max(below_kg[joint.child], heaviest_kg[joint.parent])
    light = (j for j in tree.joints if below_kg[j.child] < GEAR_SHARE * heaviest_kg[j.parent])
    return frozenset(joint.name for joint in light)


def _limb(robot: InspectedRobot, tip: str, wheels: Collection[str], gears: Collection[str]) -> Leg:
    """The chain from the last body where the robot branches to `tip`.

    wheels, gears: names of joints; a gear makes no branch.
    """
    tree, at_zero, leaves = robot.tree, robot.at_zero, _leaves(robot.tree)
    # A last body on a joint that nothing drives, as Cassie's heel, is no limb of its own.
    # Where no joint states an effort, 0 says nothing.
    states = any(j.limits.effort for j in tree.joints)
    springs = [j for j in tree.joints if states and j.limits.effort == 0.0 and j.child in leaves]
    branches = Counter(
        joint.parent for joint in tree.joints if joint not in springs and joint.name not in gears
    )
    joints: list[Joint] = []
    for joint in chain_to(tree, tip)[::-1]:
        if joint.mimic is None and joint.kind in MOVING:
            joints.append(joint)
        if branches[joint.parent] > 1:
            break
    links, solid = robot.links_of(tip), robot.solid_links
    above = tree.joint_above.get(tip)
    if above is not None and above.name in wheels:
        soles = tuple(link for link in links if link in solid) or (tip,)
        swung, X_tip = tuple(j for j in joints[::-1] if j is not above), above.X_parent_joint
        return Leg(swung, above.parent, tip, X_tip, at_zero[tip], soles, rolls=True)
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
        holders = {foot}  # and the links between it and the tip, which is the shank
        for joint in reversed(chain_to(robot.links, foot)):
            if joint.kind != "fixed" or tip in (joint.child, joint.parent):
                break
            holders.add(joint.parent)
        links = [link for link in links if link in holders and not _SHANK.fullmatch(link)]
    soles = tuple(link for link in links if link in solid) or (foot,)
    X_tip_foot = tree.placement(foot)[1]
    if foot == tip and len(joints) < ANKLE:
        X_tip_foot = _lowest_end(robot, tip)
    return Leg(tuple(joints[::-1]), tip, foot, X_tip_foot, at_zero[tip] @ X_tip_foot, soles)


def _lowest_end(robot: InspectedRobot, shank: str) -> Pose:
    """Where a shank without a foot ends: its lowest ball or end of a capsule, else the middle of
    its lowest points, or of its farthest, if it is drawn level; without shapes the knee, its frame.
    """
    ends = []
    for shape in robot.shapes.of("collision"):
        if shape.link == shank and isinstance(shape.geometry, Sphere | Capsule | Cylinder):
            half = 0.0 if isinstance(shape.geometry, Sphere) else shape.geometry.length / 2.0
            ends += [shape.X_link_shape.apply((0.0, 0.0, side * half)) for side in (-1.0, 1.0)]
    points = np.array(ends) if ends else next(robot.clouds_of(shank), np.zeros((1, 3)))
    low, far = -(points @ robot.at_zero[shank].rotation[2]), np.linalg.norm(points, axis=1)
    out = low if low.max() > far.max() / 2.0 else far
    return Pose(vec3(points[out >= out.max() - TIP_M].mean(axis=0)))


# --- base -----------------------------------------------------------------------


UNKNOWN = "taken as bolted: nothing recognised that stands, rolls, flies or reaches; see above"
FARTHEST_M = 20.0
MILLIMETRES = "its links lie {size:.4g} m apart: in millimetres? Divide its lengths by 1000"
DOUBT = (
    "nothing tells what this robot is: no legs, no two wheels on the ground, no rotors, no "
    "chain of joints as an arm has. It is taken as bolted at `{root}`. Decide `base` "
    "(`floating` if loose) and each drive's `model` (`velocity` for what turns without end)"
)


def _moves(
    robot: InspectedRobot, legs: tuple[Leg, ...], turning: Mapping[str, Turning], limbs: list[Leg]
) -> tuple[Base, str] | None:
    """The base where the source states it, or the robot has what carries it about."""
    links, tree = robot.links, robot.tree
    if robot.floats:
        return "floating", "a floating joint holds it to an empty root link"
    walking = legs or _called_legs(limbs, links.name)
    if links.root.lower() in _WORLD:
        freed = f"; to let it walk on its {len(walking)} legs, write `floating`" if walking else ""
        return "fixed", f"the root link is called `{links.root}`{freed}"
    first = [joint for joint in tree.joints if joint.parent == tree.root]
    if tree.by_body[tree.root].is_massless and [joint.kind for joint in first] == ["prismatic"]:
        return "fixed", f"the slide `{first[0].name}` moves all of it along its massless root"
    if legs:
        feet = ", ".join(leg.foot for leg in legs)
        return "floating", f"{len(legs)} legs of like joints reach the ground: {feet}"
    for role, least, does in (("wheel", 2, "rolls"), ("rotor", 1, "flies or dives")):
        on = [tree.by_joint[name].child for name, part in turning.items() if part.role == role]
        if len(on) >= least:
            return "floating", f"it {does} on {len(on)} {role}s: {', '.join(on)}"
    if flying := next(filter(_FLYING.fullmatch, [links.name, *links.by_body]), ""):
        return "floating", f"it flies, by the name of `{flying}`"
    if walking:
        named = ", ".join(leg.tip for leg in walking[:4])
        return "floating", f"{named}: legs by name, but at 0 they do not reach down"
    if not tree.moving_joints:
        return "floating", "nothing moves in it: a loose object"
    return None


def _stays(robot: InspectedRobot) -> tuple[Base, str]:
    """Bolted: an arm or a hand, or what nothing tells of.

    An arm is a chain of two joints or more; what turns without end at its tip bends nothing. A hand
    has two limbs or more that are small, or slide.
    """
    tree = robot.tree
    ends = [tree.joint_above[tip] for tip in _leaves(tree) if tip in tree.joint_above]
    held = [joint for joint in ends if not turns_freely(robot, joint)]
    loose = {joint.name for joint in ends} - {joint.name for joint in held}
    chains = [[j for j in chain_to(tree, end.child) if j.kind in MOVING] for end in ends]
    longest = max(len([j for j in chain if j.name not in loose]) for chain in chains)
    if longest >= 2:
        return "fixed", f"no legs and no wheels: an arm or a hand, bolted at `{tree.root}`"
    fingers = [j for j in held if j.kind == "prismatic" or _is_small(tree, j.child)]
    if len(fingers) >= 2:
        return "fixed", f"{len(fingers)} fingers and no arm: a hand, bolted at `{tree.root}`"
    return "fixed", UNKNOWN
