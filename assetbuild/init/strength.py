"""How strong the drive of a joint must be, where the source states no effort that can be meant.

Whole families of URDFs state an effort of 0, none, or one placeholder for every joint. The guess is
physics: a drive holds what hangs on it in the worst pose, with a margin, and accelerates it.

    effort = MARGIN * (gravity in the worst pose) + inertia * ACCELERATION

ACCELERATION is what makers state of their arms (Franka Robotics' limits of the Panda are 7.5 to 20
rad/s2 at its joints and 13 m/s2 at its hand, so a longer arm turns slower). A leg holds its share
of the robot on half of the legs with its knee bent square; a finger presses with GRIP_N at its tip;
a wheel pushes until its tyre slips; a rotor turns in the air that carries its share. Within a limb
motors differ less than loads do (a wrist's motor also carries a payload that no URDF states), so no
drive is weaker than LEAST_SHARE of the strongest of its limb: 40 of 320 N m in an iiwa, 12 of 87 in
a Panda, 28 of 150 in a UR5e.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from assetbuild.init.anatomy import Anatomy, Role, length_below, limb_of, roles
from assetbuild.init.wheels import VELOCITY_DRIVEN, bodies_below
from assetbuild.robot.dynamics import dynamics
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.mimic import leading, with_mimics
from assetbuild.robot.model import Joint, Tree
from assetbuild.robot.pose import Array
from assetbuild.robot.tree import chain_to, forward_kinematics, unit_of

GRAVITY = 9.81
SAMPLES = 40
"""Random poses in which the worst load is looked for, besides the pose of zeros."""
SEED = 1
MARGIN = 2.0
"""Times the gravity of the worst pose."""
ACCELERATION = {"rad": 20.0, "m": 10.0}
"""rad/s2 and m/s2."""
TIP_ACCELERATION = 13.0
"""m/s2, of the end of what hangs on a joint, stretched out."""
POSES = 6
"""Random poses in which the largest inertia is looked for."""
LEAST_SHARE = 0.1
"""No drive is guessed weaker than this share of the strongest drive of its limb, without unit."""
GRIP_N = 10.0
"""Force at a fingertip; hands of the field press with 5 to 30 N."""
ADHESION = 0.8
"""Friction of a tyre on a floor."""
WHEEL_M = 0.1
"""Radius of a wheel or a rotor without a shape."""
DRAG = 0.15
"""Torque of a rotor over its thrust times its radius: 0.12 to 0.25 in the models of RotorS (Iris,
Hummingbird, Firefly) and the Crazyflie's."""
WEAKEST = {"rad": 0.01, "m": 0.1}
"""N m and N; no drive of the field is weaker."""
BEYOND_MEANING = 1000.0
"""Times the guess from which a stated effort cannot be meant. Over the 1,070 joints of 66 robots of
example-robot-data that state efforts of their own, the median is 1.4 and none but placeholders is
above 130."""
PLACEHOLDER = 100.0
"""The limit for a number that looks like a placeholder: from ROUND on, or stated by all joints."""
MOTOR = 5.0
"""Times what the most loaded joint needs: a motor of less is its own, and may be all joints'."""
WEAK_POSES = 0.5
"""Share of random poses that a drive may be too weak for: an effort of less is none of its motor's.
"""
ROUND = 900.0
FEW = 3
"""Joints that may share one effort by chance."""
ROTOR = {"rad": 6000.0, "m": 600.0}
"""rad/s2 and m/s2: effort over the inertia that the joint feels of its rotor. A G1 has 5,500 to
8,700, a Go1 5,900, a UR10 3,300, a Panda 870: the guess is the least that such a motor has."""
ROTOR_RULE = f"effort / {ROTOR['rad']:g} rad/s2 (slides: {ROTOR['m']:g} m/s2)"

_IDLE = re.compile(r"(?i).*(passive|caster|castor|spring|rocker|bogie|roller|achilles|plantar).*")


@dataclass(frozen=True)
class Guess:
    """Why the effort of a joint is none of the source's; what the joint is part of."""

    why: str
    role: Role


def strengthened(tree: Tree, anatomy: Anatomy) -> tuple[Tree, dict[str, Guess]]:
    """The tree with a guess for each effort that is unknown, and these guesses by joint."""
    parts, loads = roles(tree, anatomy), _sampled_loads(tree)
    twins = _twins(tree, parts)
    physics = _physical_efforts(tree, anatomy, parts, twins, loads)
    over = _overloaded(tree, twins, loads[1:])
    meaningless = _placeholders(tree, physics, over)
    efforts, guesses = dict[str, float | None](), {}
    for name, need in physics.items():
        joint, effort = tree.by_joint[name], rounded_up(need)
        reason = _unknown(joint, need, over.get(name, 0.0), meaningless)
        if not reason or joint.is_locked:
            continue
        if stays_passive(tree, joint, anatomy):
            efforts[name] = 0.0
        elif effort != joint.limits.effort:
            efforts[name], guesses[name] = effort, Guess(reason, parts[name])
    return with_efforts(tree, efforts), guesses


def with_efforts(tree: Tree, efforts: Mapping[str, float | None]) -> Tree:
    """The tree with other effort limits of some joints, or without."""
    joints = [
        replace(j, limits=replace(j.limits, effort=efforts[j.name])) if j.name in efforts else j
        for j in tree.joints
    ]
    return replace(tree, joints=tuple(joints))


def rounded_up(value: float) -> float:
    """The next of 1, 2, 5, 10, ...: more digits would pretend to know."""
    power = 10.0 ** math.floor(math.log10(value))
    step = next(step for step in (1.0, 2.0, 5.0, 10.0) if value <= step * power * 1.001)
    return float(f"{step * power:.3g}")


def _unknown(joint: Joint, need: float, over: float, meaningless: Collection[float]) -> str:
    """Why the stated effort cannot be meant; "" for one that can.

    over: share of random poses that it cannot hold.
    """
    stated = joint.limits.effort
    if stated is None:
        return "the source states no effort"
    if stated == 0.0:
        return "the source states an effort of 0"
    if over > WEAK_POSES:
        return f"the source's effort of {stated:g} cannot hold {over:.0%} of random poses"
    if stated in meaningless or stated > BEYOND_MEANING * need:
        return f"the source's effort of {stated:g} is a placeholder"
    return ""


def _placeholders(
    tree: Tree, physics: Mapping[str, float], over: Mapping[str, float]
) -> set[float]:
    """Efforts that several joints state and one of them cannot have."""
    stated = {name: e for name in physics if (e := tree.by_joint[name].limits.effort)}
    counts, most = Counter(stated.values()), max(physics.values(), default=0.0)
    efforts = set()
    for name, effort in stated.items():
        for_all = FEW < counts[effort] == len(stated)
        no_motor = effort >= ROUND or (for_all and effort > MOTOR * most)
        too_strong = effort > PLACEHOLDER * physics[name] and no_motor
        if too_strong or (for_all and over[name] > WEAK_POSES):
            efforts.add(effort)
    return efforts


def stays_passive(tree: Tree, joint: Joint, anatomy: Anatomy) -> bool:
    """A caster; a spring, by its name or as the last of a driven leg.

    joint: one that states no effort, 0, or what cannot be meant.

    Cassie's heel springs state an effort of 0 where its motors state theirs.
    """
    part = anatomy.turning.get(joint.name)
    is_caster = part is not None and part.role == "caster"
    if is_caster or _IDLE.fullmatch(joint.name) or _IDLE.fullmatch(joint.child):
        return True
    chain = chain_to(tree, joint.child)
    legs = {other.name for leg in anatomy.walks_on for other in leg.joints}
    legged = any(other.name in legs for other in chain)
    return joint.limits.effort == 0.0 and legged and any(o.limits.effort for o in chain)


# --- the guess ------------------------------------------------------------------------------


def _physical_efforts(
    tree: Tree,
    anatomy: Anatomy,
    parts: Mapping[str, Role],
    twins: Mapping[str, Sequence[str]],
    loads: Sequence[Mapping[str, float]],
) -> dict[str, float]:
    """What each joint needs, by the formula of this module, and its twins alike; N m or N.

    loads: see `_sampled_loads`.
    """
    inertia = largest_inertias(tree)
    weight, needs = total_mass(tree) * GRAVITY, {}
    turned = _turned(anatomy, weight)
    share = weight / max(1, len(anatomy.walks_on) // 2)
    # A leg that carries its share on half of the legs, half its length off its foot.
    legs = {j.name: share * leg.length / 2.0 for leg in anatomy.walks_on for j in leg.joints}
    for joint in tree.moving_joints:
        if joint.mimic is not None:
            continue
        name, unit = joint.name, unit_of(joint)
        reach = length_below(tree, joint.child) if unit == "rad" else 1.0
        tip = TIP_ACCELERATION / max(reach, 1e-3) if unit == "rad" else math.inf
        moving = min(ACCELERATION[unit], tip) * inertia.get(name, 0.0)
        need = MARGIN * max(load[name] for load in loads) + moving
        grip = GRIP_N * reach if parts[name] == "finger" else 0.0
        others = (turned.get(name, 0.0), legs.get(name, 0.0), grip, WEAKEST[unit])
        needs[name] = max(need, *others)
    alike = {name: max(needs[twin] for twin in twins[name]) for name in needs}
    return _within_limbs(tree, alike, parts)


def _twins(tree: Tree, parts: Mapping[str, Role]) -> dict[str, list[str]]:
    """List for each driven joint those of the same mass at the same place of a limb, and itself."""
    alike: dict[tuple[object, ...], list[str]] = {}
    for joint in tree.moving_joints:
        if joint.mimic is None:
            bodies = bodies_below(tree, joint.child)
            masses = [i.mass_kg for body in bodies if (i := tree.by_body[body].inertial)]
            depth, mass = len(chain_to(tree, joint.child)), f"{math.fsum(masses):.3g}"
            place = (parts[joint.name], unit_of(joint), depth, mass)
            alike.setdefault(place, []).append(joint.name)
    return {name: names for names in alike.values() for name in names}


def _turned(anatomy: Anatomy, weight: float) -> dict[str, float]:
    """N m that a wheel needs to slip, and a rotor to carry MARGIN times its share."""
    alike = Counter(part.role for part in anatomy.turning.values())
    per_metre = {"wheel": ADHESION * weight, "rotor": MARGIN * DRAG * weight}
    return {
        name: per_metre[part.role] / alike[part.role] * (part.radius_m or WHEEL_M)
        for name, part in anatomy.turning.items()
        if part.role in per_metre
    }


def _within_limbs(
    tree: Tree, needs: Mapping[str, float], parts: Mapping[str, Role]
) -> dict[str, float]:
    """None but what turns without end is weaker than a share of the strongest of its limb."""
    limbs = {n: (limb_of(tree, tree.by_joint[n]), unit_of(tree.by_joint[n])) for n in needs}
    strongest = {n: max(needs[other] for other in needs if limbs[other] == limbs[n]) for n in needs}
    least = {n: 0.0 if parts[n] in VELOCITY_DRIVEN else LEAST_SHARE * strongest[n] for n in needs}
    return {name: max(need, least[name]) for name, need in needs.items()}


def rotor_inertias(tree: Tree, stated: Mapping[str, float]) -> dict[str, float]:
    """What rotors add to their joints, kg m2 or kg: as stated, else the least (2 digits) that a
    motor of the joint's effort has.
    """
    alone = [joint for joint in tree.moving_joints if joint.mimic is None]
    least = {j.name: float(f"{(j.limits.effort or 0.0) / ROTOR[unit_of(j)]:.2g}") for j in alone}
    return least | {name: inertia for name, inertia in stated.items() if inertia}


def largest_inertias(tree: Tree) -> dict[str, float]:
    """Return the largest inertia that each joint moves in any of POSES poses, by joint.

    kg m2 where it turns, kg where it slides; the other joints are held.
    """
    largest: dict[str, float] = {}
    for pose in sample_poses(tree.moving_joints, POSES):
        robot = dynamics(tree, pose, {})
        for name in robot.joints:
            column = robot.column(name)
            largest[name] = max(largest.get(name, 0.0), float(robot.mass[column, column]))
    return largest


# --- where joints may stand, and what weight does to them ------------------------------------


def bounds(joint: Joint) -> tuple[float, float]:
    """The limits; half a turn to both sides where the source states none that hold."""
    lower, upper = joint.limits.lower, joint.limits.upper
    if joint.kind == "continuous" or lower is None or upper is None or lower > upper:
        return -math.pi, math.pi
    return lower, upper


def resting(joint: Joint) -> float:
    """0 where the limits allow it, else the middle of the range."""
    lower, upper = bounds(joint)
    return 0.0 if lower <= 0.0 <= upper else (lower + upper) / 2


def gravity_loads(
    tree: Tree, pose: Mapping[str, float], joints: Iterable[Joint]
) -> dict[str, float]:
    """What each joint must push to hold all that hangs on it, N m or N; the root stands upright."""
    X_root = forward_kinematics(tree, with_mimics(tree, pose))
    mass: dict[str, float] = {}
    moment: dict[str, Array] = {}
    for body in tree.bodies:
        inertial = body.inertial
        mass[body.name] = inertial.mass_kg if inertial else 0.0
        com = X_root[body.name].apply(inertial.com_m if inertial else (0.0, 0.0, 0.0))
        moment[body.name] = mass[body.name] * np.asarray(com)
    for joint in reversed(tree.joints):  # children come after their parents
        mass[joint.parent] += mass[joint.child]
        moment[joint.parent] = moment[joint.parent] + moment[joint.child]
    loads = {}
    for joint in joints:
        X = X_root[joint.child]
        axis = X.rotation @ np.asarray(joint.axis)
        if joint.kind == "prismatic":
            loads[joint.name] = abs(mass[joint.child] * GRAVITY * float(axis[2]))
        else:
            arm = moment[joint.child] - mass[joint.child] * np.asarray(X.xyz)
            loads[joint.name] = abs(GRAVITY * float(axis[0] * arm[1] - axis[1] * arm[0]))
    return loads


def _overloaded(
    tree: Tree, twins: Mapping[str, Sequence[str]], loads: Sequence[Mapping[str, float]]
) -> dict[str, float]:
    """Share of the random poses that need more than the stated effort, by joint that states one.

    The poses of a joint's twins count as its own, so that no chance parts left from right.
    """
    shares = {}
    for name, alike in twins.items():
        if most := tree.by_joint[name].limits.effort:
            over = [load[twin] > most for load in loads for twin in alike]
            shares[name] = sum(over) / len(over)
    return shares


def _sampled_loads(tree: Tree) -> list[dict[str, float]]:
    """`gravity_loads` in the pose of zeros and random ones; what mimics a joint loads it too."""
    joints = tree.moving_joints
    samples = []
    for pose in sample_poses(joints, SAMPLES):
        loads = gravity_loads(tree, pose, joints)
        for joint in joints:
            leader, factor, _ = leading(tree, joint)
            if leader is not joint:
                loads[leader.name] += abs(factor) * loads[joint.name]
        samples.append(loads)
    return samples


def sample_poses(joints: Sequence[Joint], count: int) -> list[dict[str, float]]:
    """The pose of zeros and random ones over the joints' ranges, the same every time."""
    random = np.random.default_rng(SEED)
    free = [joint for joint in joints if joint.mimic is None]
    ends = [bounds(joint) for joint in free]
    low = np.array([max(lower, -math.pi) for lower, _ in ends])
    high = np.array([min(upper, math.pi) for _, upper in ends])
    drawn = low + (high - low) * random.random((count, len(free)))
    names = [joint.name for joint in free]
    zero = np.clip(np.zeros(len(free)), low, high)
    return [dict(zip(names, map(float, row), strict=True)) for row in (zero, *drawn)]
