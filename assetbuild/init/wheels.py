"""What turns without end: wheels, casters, rotors; by their shape, their axis and the ground.

Judged at the pose where every joint is 0, in the frame of the root. A wheel is round about a
horizontal axis and as low as the robot reaches. A caster is a wheel on a swivel that it trails
behind, on a robot that has others to drive by; with no trail or no other wheels, the swivel steers.
Rotors are two or more that are called so. Names decide where there is no shape to look at, and
confirm a wheel that hangs above the ground among others.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from assetbuild.init.look import InspectedRobot, zeroed
from assetbuild.robot.model import Joint, Tree
from assetbuild.robot.pose import Array

TurningRole = Literal["wheel", "caster", "steering", "rotor", "spinner"]

VELOCITY_DRIVEN = ("wheel", "rotor", "spinner")
"""Roles of joints that are asked for a speed, not for a place."""
ENDLESS_RAD = 20.0
"""A range of more than three turns is none; many arms state two."""
LEVEL, SWIVEL = 0.35, 0.9
"""Upward part of an axis: at most, of a wheel; at least, of a swivel."""
ROUND = 0.85
"""Smallest over largest half-width about the axis; a square has 0.71, an octagon 0.92."""
ON_GROUND = 0.25
"""A wheel's lowest point is above the robot's by at most this share of its radius."""
TRAIL = 0.15
"""A caster follows its swivel by at least this share of its radius."""
ALIKE = 0.2
COINCIDENT_M = 1e-3

_WHEEL = re.compile(r"(?i).*(wheel|caster|castor|tyre).*")
_CASTER = re.compile(r"(?i).*(caster|castor|roller).*")
_ROTOR = re.compile(r"(?i).*(rotor|propeller|thruster|(^|[_/-])prop_?\d*([_-]|$)).*")
_SPINNER = re.compile(
    r"(?i).*(rotor|propeller|fan|blade|brush|lidar|laser|velodyne|hokuyo|radar|fly_?wheel|spin).*"
)


@dataclass(frozen=True)
class Turning:
    """What a joint that turns without end carries. radius_m: about its axis, 0 without a shape."""

    role: TurningRole
    radius_m: float = 0.0


@dataclass(frozen=True)
class _Disc:
    """The body on such a joint. Root frame, m; lowest: infinite without a shape.

    roundness: smallest over largest half-width about the axis.
    is_last: nothing hangs on it but what turns without end inside it, as the rollers of a wheel.
    """

    joint: Joint
    axis: Array
    centre: Array
    radius: float
    lowest: float
    roundness: float
    is_last: bool

    @property
    def name(self) -> str:
        """What the words are looked for in."""
        return f"{self.joint.child}/{self.joint.name}"

    @property
    def is_level(self) -> bool:
        return bool(abs(self.axis[2]) < LEVEL)


def what_turns(robot: InspectedRobot) -> dict[str, Turning]:
    """Return the role of each joint that turns without end, in the order of the tree.

    A swivel is among them whatever its range.
    """
    free = [joint for joint in robot.tree.moving_joints if turns_freely(robot, joint)]
    discs = [_disc(robot, joint, free) for joint in free]
    wheels = _wheels(robot, discs)
    turning = {disc.joint.name: Turning("wheel", disc.radius) for disc in wheels}
    turning |= _followers(robot, wheels, discs)
    others = [disc for disc in discs if disc.is_last and disc.joint.name not in turning]
    rotors = [disc for disc in others if _ROTOR.fullmatch(disc.name)]
    if len(rotors) > 1:
        turning |= {disc.joint.name: Turning("rotor", disc.radius) for disc in rotors}
    for disc in others:
        named = _SPINNER.fullmatch(disc.name) or (_WHEEL.fullmatch(disc.name) and disc.is_level)
        if named and disc.joint.name not in turning:
            turning[disc.joint.name] = Turning("spinner", disc.radius)
    return {joint.name: turning[joint.name] for joint in robot.tree.joints if joint.name in turning}


def turns_freely(robot: InspectedRobot, joint: Joint) -> bool:
    """Whether no limit stops the joint: it has none, or none that could be meant."""
    if joint.kind != "revolute":
        return joint.kind == "continuous"
    if joint.name in {*robot.unranged, *zeroed(robot.links)} or joint.range is None:
        return True
    return joint.range[1] - joint.range[0] > ENDLESS_RAD


# --- wheels ---------------------------------------------------------------------------------


def _wheels(robot: InspectedRobot, discs: Sequence[_Disc]) -> list[_Disc]:
    """Discs that roll on the ground; the topmost of each chain, as a wheel may carry rollers."""
    level = [disc for disc in discs if disc.is_level and disc.is_last]
    named = [disc for disc in level if _WHEEL.fullmatch(disc.name)]
    rolling = [d for d in level if d.roundness >= ROUND and _touches(robot, d)]
    wheels = [disc for disc in rolling if disc in named or len(_like(disc, rolling)) > 1]
    wheels += [d for d in named if d not in wheels and (not d.radius or _touches(robot, d))]
    wheels += [d for d in named if d not in wheels and len(_like(d, [*wheels, *named])) > 1]
    above = {disc.joint.child for disc in wheels}
    return [disc for disc in wheels if disc.joint.parent not in above]


def _touches(robot: InspectedRobot, disc: _Disc) -> bool:
    return disc.lowest - robot.lowest_m <= ON_GROUND * disc.radius


def _like(disc: _Disc, others: Sequence[_Disc]) -> list[_Disc]:
    """Those of its size on parallel axes, itself among them."""
    return [
        other
        for other in {other.joint.name: other for other in others}.values()
        if abs(other.radius - disc.radius) <= ALIKE * disc.radius
        and abs(float(other.axis @ disc.axis)) > SWIVEL
    ]


def _followers(
    robot: InspectedRobot, wheels: Sequence[_Disc], discs: Sequence[_Disc]
) -> dict[str, Turning]:
    """Casters with their swivels, what steers, and what turns inside of a wheel."""
    named = [disc for disc in wheels if _CASTER.fullmatch(disc.name)]
    swivels = {disc.joint.name: _swivel(robot, disc, wheels) for disc in wheels}
    steady = [d for d in wheels if d not in named and swivels[d.joint.name] is None]
    followers: dict[str, Turning] = {}
    for disc in wheels:
        swivel = swivels.get(disc.joint.name)
        trails = swivel is not None and _trail(robot, swivel, disc) > TRAIL * disc.radius
        follows = len(steady) > 1 and (trails or disc in named)
        if follows:
            followers[disc.joint.name] = Turning("caster", disc.radius)
        if swivel is not None:
            followers[swivel.name] = Turning("caster" if follows else "steering")
    carried = {body for w in wheels for body in bodies_below(robot.tree, w.joint.child)[1:]}
    for disc in discs:
        if disc.joint.child in carried:
            followers[disc.joint.name] = Turning("caster", disc.radius)
    return followers


def _swivel(robot: InspectedRobot, wheel: _Disc, wheels: Sequence[_Disc]) -> Joint | None:
    """The upright joint of a fork that carries the wheel, and nothing but wheels."""
    tree = robot.tree
    above = tree.joint_above.get(wheel.joint.parent)
    if above is None or above.kind not in ("revolute", "continuous"):
        return None
    rolling = {body for disc in wheels for body in bodies_below(tree, disc.joint.child)}
    is_fork = set(bodies_below(tree, above.child)) <= {above.child, *rolling}
    return above if is_fork and abs(robot.axis_of(above)[2]) > SWIVEL else None


def _trail(robot: InspectedRobot, swivel: Joint, wheel: _Disc) -> float:
    """How far the wheel's axle passes by the axis of its swivel, m."""
    away = wheel.centre - np.asarray(robot.at_zero[swivel.child].xyz)
    forward = np.cross(wheel.axis, (0.0, 0.0, 1.0))
    return abs(float(away @ forward)) / max(float(np.linalg.norm(forward)), 1e-9)


# --- shapes ---------------------------------------------------------------------------------


def _disc(robot: InspectedRobot, joint: Joint, free: Sequence[Joint]) -> _Disc:
    """Measure the body on one of the joints that turn without end, which are `free`."""
    X_root_body = robot.at_zero[joint.child]
    axis, origin = robot.axis_of(joint), np.asarray(X_root_body.xyz)
    clouds = [X_root_body.apply(cloud) for cloud in robot.clouds_of(joint.child)]
    middles = [(cloud.min(axis=0) + cloud.max(axis=0)) / 2.0 for cloud in clouds] or [origin]
    widths = [_half_widths(cloud - origin, axis) for cloud in clouds]
    radius = max((float(width.max()) for width in widths), default=0.0)
    # All that hangs on it turns freely and has its place within the radius.
    spins, below = {other.child for other in free}, bodies_below(robot.tree, joint.child)[1:]
    ways = [math.dist(robot.at_zero[body].xyz, X_root_body.xyz) for body in below]
    return _Disc(
        joint,
        axis,
        origin + axis * float((np.mean(middles, axis=0) - origin) @ axis),
        radius,
        min((float(cloud[:, 2].min()) for cloud in clouds), default=math.inf),
        max((float(width.min() / max(width.max(), 1e-9)) for width in widths), default=0.0),
        spins.issuperset(below) and max(ways, default=0.0) <= radius + COINCIDENT_M,
    )


def _half_widths(points: Array, axis: Array) -> Array:
    """(16,) m: how far the points reach in directions around an axis through the origin."""
    one = np.cross(axis, (1.0, 0.0, 0.0) if abs(axis[0]) < 0.7 else (0.0, 1.0, 0.0))
    one = one / np.linalg.norm(one)
    turns = np.arange(16) * (math.pi / 8.0)
    directions = np.outer(np.cos(turns), one) + np.outer(np.sin(turns), np.cross(axis, one))
    widths: Array = (points @ directions.T).max(axis=0)
    return widths


def bodies_below(tree: Tree, body: str) -> list[str]:
    """The body and all that hangs on it, parents before children."""
    bodies = [body]
    for joint in tree.joints:  # parents come first
        if joint.parent in bodies:
            bodies.append(joint.child)
    return bodies
