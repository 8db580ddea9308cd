"""An actuator table from the source's limits, by rules that the recipe states.

Two kinds of row. Joints with the same limits that move about as much share one pair of gains, kp
and kd. Where their inertias make too many classes for that (the joints of a hand share one motor, a
fingertip is a thousandth of a finger), a natural frequency and a damping ratio, which the build
turns into gains joint by joint.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from assetbuild.checks.gains import Gains
from assetbuild.init.anatomy import Leg
from assetbuild.init.draft import patterns_of
from assetbuild.init.strength import GRAVITY, Guess
from assetbuild.init.wheels import VELOCITY_DRIVEN, Turning
from assetbuild.robot.dynamics import Dynamics, dynamics, holding_torques
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.model import Joint, Tree
from assetbuild.robot.pose import Array
from assetbuild.robot.tree import unit_of

FULL_ERROR = {"rad": 0.3, "m": 0.02}
"""Tracking error at which a drive gives all its effort."""
LEAST_ERROR = {"rad": 0.03, "m": 0.002}
"""The error at which a drive that is weak for its load gives all: a stiffer one is a switch."""
FULL_SLIP = 1.0
"""rad/s: error of its speed at which the drive of a wheel gives all its effort."""
SAG = {"rad": 0.05, "m": 0.005}
"""Furthest that gravity may pull a joint from its target at home."""
SLOWEST_HZ = 3.0
FASTEST_HZ = 25.0
"""Natural frequency of a drive with what it moves: no slower, no faster."""
FIRM = 2.0
"""Times the stiffness at which a robot on two legs would just tip over: see `_tipping`."""
TABLE = 3
FASTEST_LEG_HZ = 6.0
"""Highest frequency of a standing leg under its share of the robot: stiffer ones bounce."""
USUAL_HZ = 8.0
"""Where a row states a frequency."""
DAMPING_RATIO = 0.7
MOST_DAMPED = Gains().damping_ratio[1]
"""Damping ratio at most, that of the joint's own damping included: a build warns of more."""
SPAN = 8.0
"""Largest over smallest inertia in a row: the lightest is damped twice as much as it needs."""
TWINS = 1.1
"""Inertias that are closer than this are never parted."""
CLASSES = 2
"""More classes of inertia than this get a frequency instead."""
MOST_DAMPED_LEG = 9.0
"""Highest ratio of a leg in the air: there an ankle moves a foot, on the ground the robot."""
STUCK = 0.3
"""Share of the effort that a joint may lose to dry friction."""
STEP_S = 0.005
"""Usual for training."""
OUTRUN = 1.5
"""kd of a standing leg times the step, over the inertia of its lightest joint: with more, the foot
that meets the floor is thrown back by its own drive, and the robot hops about. Measured on 15
quadrupeds; what cures them is the inertia of their rotors, which no URDF states, or shorter steps.
"""
BRAKE_S = 0.05
"""kd is at least kp times this where no joint creeps: ten steps of 5 ms keep light links calm."""
GAINS = (
    "A first guess: replace it by the motors' data. Effort and velocity limits are the source's.",
    f"kp gives the whole effort at an error of {FULL_ERROR['rad']:g} rad "
    f"({1e3 * FULL_ERROR['m']:g} mm for slides), keeps the natural frequency",
    f"at home between {SLOWEST_HZ:g} and {FASTEST_HZ:g} Hz (legs: {FASTEST_LEG_HZ:g}) and the sag "
    f"below {SAG['rad']:g} rad; kd gives a damping ratio of at",
    f"least {DAMPING_RATIO:g}. Where inertias differ too much for one kp, rows state a frequency.",
)
"""The rules in short, as the recipe states them."""


@dataclass(frozen=True)
class DriveRow:
    """Joints with the same limits. inertia: largest, kg m2 or kg.

    gains: keys of the recipe's row, kp and kd or frequency (Hz) and damping_ratio; none = passive.
    drops: numbers of the source that cannot be meant: joints would creep for minutes (damping), or
    never move (friction).
    locked: equal limits hold them, so that a drive could move nothing.
    standing: least inertia of those that belong to a standing leg; 0 without one.
    guess: why the effort is a guess, "" for the source's own; role: of such joints, and of those
    that turn without end, whose role names their drive.
    """

    joints: tuple[str, ...]
    effort: float | None
    velocity: float | None
    unit: str
    inertia: float
    gains: Mapping[str, float] = field(default_factory=dict, hash=False)
    drops: tuple[str, ...] = ()
    locked: bool = False
    standing: float = 0.0
    guess: str = ""
    role: str = ""
    armature: float = 0.0

    @property
    def keys(self) -> dict[str, object]:
        """The row of the recipe, but for `joints`."""
        if self.locked or self.effort is None:
            return {"model": "passive"}
        keys: dict[str, object] = {"model": "velocity" if self.role in VELOCITY_DRIVEN else "pd"}
        if self.guess:
            keys["effort"] = self.effort
        keys |= self.gains
        if self.armature:
            keys["armature"] = self.armature
        keys |= dict.fromkeys(self.drops, 0)
        return keys | ({"guessed": True} if self.guess else {})

    def table(self, tree: Tree) -> Iterator[dict[str, object]]:
        """The rows of the recipe, one for each pattern that the names of its joints need."""
        for pattern in patterns_of(self.joints, [joint.name for joint in tree.moving_joints]):
            yield {"joints": pattern, **self.keys}

    def outruns(self, step_s: float) -> bool:
        """Whether a leg's drive acts faster than steps of this length can follow."""
        return self.gains.get("kd", 0.0) * step_s > OUTRUN * self.standing > 0.0


@dataclass(frozen=True)
class _Felt:
    """What one drive feels at home. inertia: 1 / (M^-1)_ii; holding: N m or N; load: kg m2.

    tipping: least stiffness of a leg's joint that holds the robot upright, N m/rad.
    """

    joint: Joint
    inertia: float
    holding: float
    load: float
    tipping: float = 0.0


def drive_rows(
    tree: Tree,
    pose: Mapping[str, float],
    legs: tuple[Leg, ...],
    guesses: Mapping[str, Guess] = MappingProxyType({}),
    armature: Mapping[str, float] = MappingProxyType({}),
    turning: Mapping[str, Turning] = MappingProxyType({}),
    firmness: float = FIRM,
) -> tuple[DriveRow, ...]:
    """Joints grouped by kind, effort and velocity, with gains; mimic joints need no row.

    guesses: of the efforts that the source does not state; the tree has them. Such joints are
    grouped by what they are part of.
    armature: of rotors, by joint, kg m2 or kg. turning: what turns without end, by joint.
    firmness: of two legs, times what keeps the robot from tipping over.
    """
    felt = _felt(tree, pose, legs, armature, firmness)
    groups: dict[DriveRow, list[Joint]] = defaultdict(list)
    for joint in tree.moving_joints:
        if joint.mimic is None:
            kind = _kind(joint, guesses.get(joint.name), turning.get(joint.name))
            groups[replace(kind, armature=armature.get(joint.name, 0.0))].append(joint)
    rows = []
    for kind, joints in groups.items():
        for alike in _classes(kind, [felt[joint.name] for joint in joints]):
            inertia = max(one.inertia for one in alike)
            names = tuple(one.joint.name for one in alike)
            row = replace(kind, joints=names, inertia=inertia)
            rows.append(_driven(row, row.effort, alike) if row.effort is not None else row)
    return tuple(rows)


def _classes(kind: DriveRow, felt: Sequence[_Felt]) -> list[list[_Felt]]:
    """Joints of one kind, parted by what they move; those of standing legs all move the robot."""
    legs, others = [one for one in felt if one.load], [one for one in felt if not one.load]
    positions = kind.effort is not None and kind.role not in VELOCITY_DRIVEN
    parted = positions and all(one.inertia > 0.0 for one in others)
    alike: list[list[_Felt]] = []
    for one in sorted(others, key=lambda one: -one.inertia) if parted else ():
        last = alike[-1] if alike else []
        near = last and last[-1].inertia < TWINS * one.inertia
        if near or (last and last[0].inertia <= SPAN * one.inertia):
            last.append(one)
        else:
            alike.append([one])
    if not 0 < len(alike) <= CLASSES:
        alike = [others]
    in_order = [[one for one in others if one in part] for part in alike]
    return [part for part in (legs, *in_order) if part]


def _kind(joint: Joint, guess: Guess | None, part: Turning | None) -> DriveRow:
    """The row of one joint, without what depends on the others."""
    unit, limits, locked = unit_of(joint), joint.limits, joint.is_locked
    effort = None if locked else limits.effort or None
    row = DriveRow((), effort, limits.velocity or None, unit, 0.0, locked=locked)
    if guess is not None:
        return replace(row, guess=guess.why, role=guess.role)
    if part is not None and part.role == "caster":
        return replace(row, effort=None, role=part.role)
    return replace(row, role=part.role) if part and part.role in VELOCITY_DRIVEN else row


def _driven(row: DriveRow, effort: float, felt: Sequence[_Felt]) -> DriveRow:
    if row.role in VELOCITY_DRIVEN:
        return replace(row, gains={"kd": _rounded(effort / FULL_SLIP)})
    row = _with_gains(row, effort, felt)
    cannot_be_meant = {
        "damping": max(_own_ratio(row, one) for one in felt) > MOST_DAMPED,
        "friction": any((one.joint.friction or 0.0) > STUCK * effort for one in felt),
    }
    if "kd" in row.gains and not cannot_be_meant["damping"]:
        damping = min(one.joint.damping or 0.0 for one in felt)
        row = replace(row, gains={**row.gains, "kd": _rounded(max(row.gains["kd"] - damping, 0.0))})
    return replace(row, drops=tuple(word for word, bad in cannot_be_meant.items() if bad))


def _own_ratio(row: DriveRow, one: _Felt) -> float:
    """Damping ratio that the joint's own damping makes with the row's stiffness."""
    if not one.joint.damping or one.inertia <= 0.0:
        return 0.0
    kp = row.gains.get("kp") or one.inertia * _square(row.gains["frequency"])
    return one.joint.damping / (2 * math.sqrt(kp * max(one.inertia, one.load)))


def _with_gains(row: DriveRow, effort: float, felt: Sequence[_Felt]) -> DriveRow:
    """kp and kd that suit every joint of the group, else a frequency and a damping ratio."""
    unit, moved = row.unit, [one.inertia for one in felt if one.inertia > 0.0]
    if len(moved) < len(felt):  # edits give the links their masses; the build knows them
        unheld = [replace(one, holding=0.0) for one in felt if one.inertia > 0.0]
        return _by_frequency(row, unheld)
    stiffest = effort / LEAST_ERROR[unit]
    floors = [
        max(min(one.inertia * _square(SLOWEST_HZ), stiffest), one.holding / SAG[unit], one.tipping)
        for one in felt
    ]
    roofs = [
        max(one.inertia * _square(FASTEST_HZ), one.load * _square(FASTEST_LEG_HZ)) for one in felt
    ]
    standing = any(one.load for one in felt)
    alike = max(moved) <= SPAN * TWINS * min(moved)
    if not standing and (not alike or max(floors) > min(roofs)):
        return _by_frequency(row, felt)
    kp = min(max(effort / FULL_ERROR[unit], max(floors)), max(roofs))
    kd = 2 * DAMPING_RATIO * math.sqrt(kp * max(moved))
    most = 2 * (MOST_DAMPED_LEG if standing else MOST_DAMPED) * math.sqrt(kp * min(moved))
    brake = BRAKE_S * kp
    if standing:  # a light robot on stiff dampers hops
        brake = min(brake, 2 * DAMPING_RATIO * math.sqrt(kp * max(one.load for one in felt)))
    lightest = min((one.inertia for one in felt if one.load and one.inertia > 0.0), default=0.0)
    kd = min(max(kd, brake), most)
    return replace(row, gains={"kp": _rounded(kp), "kd": _rounded(kd)}, standing=lightest)


def _by_frequency(row: DriveRow, felt: Sequence[_Felt]) -> DriveRow:
    """Fast enough that no joint sags, and damped no less than the joints themselves are.

    Unless these are damped beyond use; the row then drops it.
    """
    moved = [one for one in felt if one.inertia > 0.0]
    wanted = max((one.holding / SAG[row.unit] / one.inertia for one in moved), default=0.0)
    frequency = math.sqrt(wanted) / (2 * math.pi)
    frequency = _rounded(min(max(frequency, USUAL_HZ), FASTEST_HZ))
    ratios = [(one.joint.damping or 0.0) / (4 * math.pi * one.inertia * frequency) for one in moved]
    most = max(ratios, default=0.0)
    ratio = 1.1 * most if most <= MOST_DAMPED else 1.0
    gains = {"frequency": frequency, "damping_ratio": _rounded(max(1.0, ratio))}
    return replace(row, gains=gains)


def _square(frequency: float) -> float:
    return (2 * math.pi * frequency) ** 2


def _rounded(value: float) -> float:
    """Two digits: more would pretend to know."""
    return float(f"{value:.2g}")


def _felt(
    tree: Tree,
    pose: Mapping[str, float],
    legs: tuple[Leg, ...],
    armature: Mapping[str, float],
    firmness: float,
) -> dict[str, _Felt]:
    """What each joint moves, by the mass matrix at home; feet carry the robot, where it has any.

    A leg's joint moves the leg's share of the robot at the leg's length.
    """
    robot = dynamics(tree, pose, armature)
    feet: list[tuple[str, Array]] = []
    loads: dict[str, float] = {}
    for leg in legs:
        foot = np.asarray((robot.bodies[leg.tip].pose @ leg.X_tip_foot).xyz)
        hip = np.asarray(robot.bodies[leg.joints[0].child].pose.xyz)
        load = total_mass(tree) / len(legs) * float(np.linalg.norm(hip - foot)) ** 2
        loads |= {joint.name: load for joint in leg.joints}
        feet.append((leg.tip, foot))
    torque, left_over = holding_torques(robot, feet)
    if legs and tree.base == "floating" and left_over > 0.05:
        torque = {}  # it would tip over, so nothing is held; without legs the ground bears it
    felt, inertias, tipping = {}, robot.effective_inertia(), _tipping(tree, robot, legs)
    for joint in tree.moving_joints:
        name, moved = joint.name, inertias.get(joint.name, 0.0)
        inertia = moved if math.isfinite(moved) else 0.0
        held, firm = abs(torque.get(name, 0.0)), firmness * tipping.get(name, 0.0)
        felt[name] = _Felt(joint, inertia, held, loads.get(name, 0.0), firm)
    return felt


def _tipping(tree: Tree, robot: Dynamics, legs: tuple[Leg, ...]) -> dict[str, float]:
    """Return, for each joint of two legs, weight times height of the centre of mass above it.

    N m/rad, the leg's share: a pendulum on its head stands on ankles that are stiffer. On more legs
    a robot stands as a table does.
    """
    mass = total_mass(tree)
    placed = [(b.inertial, robot.bodies[b.name].pose) for b in tree.bodies if b.inertial]
    moment = math.fsum(i.mass_kg * float(pose.apply(i.com_m)[2]) for i, pose in placed)
    weight, height = mass * GRAVITY, moment / mass
    stiffness = {}
    for leg in legs:
        for joint in leg.joints if len(legs) < TABLE else ():
            over = height - robot.bodies[joint.child].pose.xyz[2]
            stiffness[joint.name] = weight * max(over, 0.0) / len(legs)
    return stiffness
