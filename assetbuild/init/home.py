"""A home pose inside the limits: legs under their hips, everything else at 0 where it may be.

What the drives could not hold there hangs, and nothing lies in anything: see `relief`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from assetbuild.init.anatomy import ANKLE, Leg, chain_to
from assetbuild.init.joint_range import bounds, resting
from assetbuild.init.relief import Depths, nothing_deep, relieved
from assetbuild.robot.model import Joint, Tree
from assetbuild.robot.pose import Array, Pose
from assetbuild.robot.tree import forward_kinematics

CROUCH = 0.75
"""Height of the hips of a walker on four legs or more, as a share of the stretched legs'."""
FOLDED = 0.25
"""Height of a hip at the zero pose, as a share of the leg's length, below which a leg is folded."""
BENT = 0.92
"""The same of two legs that bend their knees to stand."""
SETTLE = 0.97
"""The same on two legs, where a joint of the leg cannot be 0."""
MARGIN_RAD = 0.02
BEHIND_M = 0.02


@dataclass(frozen=True)
class Stance:
    """How legs stand. shift_m: of the feet from below the hips, x and y; bent: legs that could be
    straight."""

    shift_m: tuple[float, float] = (0.0, 0.0)
    bent: bool = False


UPRIGHT = Stance()


def home_pose(
    tree: Tree,
    legs: tuple[Leg, ...],
    stance: Stance = UPRIGHT,
    depths: Depths = nothing_deep,
) -> dict[str, float]:
    """A value for each moving joint that mimics no other, rad or m, 3 decimals.

    depths: of bodies in each other and in the floor, which joints other than the legs' avoid.
    """
    pose = {j.name: resting(j) for j in tree.moving_joints if j.mimic is None}
    bends = len(legs) >= 4 or any(resting(j) != 0.0 for leg in legs for j in leg.joints)
    if legs and (bends or stance != UPRIGHT):
        for leg in legs:
            pose |= _planted(tree, leg, legs, pose, stance, bends or stance.bent)
    pose = relieved(tree, pose, legs, depths)
    return {name: _inside(tree.by_joint[name], value) for name, value in pose.items()}


def _inside(joint: Joint, value: float) -> float:
    """Rounded to 3 decimals and within the limits all the same."""
    lower, upper = bounds(joint)
    rounded = min(max(round(value, 3), lower), upper) + 0.0
    return rounded if math.isfinite(rounded) else 0.0


# --- legs -----------------------------------------------------------------------------------


def _planted(
    tree: Tree,
    leg: Leg,
    legs: tuple[Leg, ...],
    others: Mapping[str, float],
    stance: Stance,
    bends: bool,
) -> dict[str, float]:
    """Joint values that put the foot below its hip, all feet at one height.

    A straight leg's foot stays below where it was drawn.

    Least squares on the foot's position (and, with an ankle to turn it by, its tilt), with a weak
    pull to the bent knee it starts from; SciPy's bounded trust region method.
    """
    from scipy.optimize import least_squares

    at_zero = forward_kinematics(tree, {})
    chain, X_tip_foot = replace(tree, joints=chain_to(tree, leg.tip)), leg.X_tip_foot
    names = [joint.name for joint in leg.joints]

    def foot(q: Array) -> Pose:
        values = {**others, **dict(zip(names, map(float, q), strict=True))}
        return forward_kinematics(chain, values)[leg.tip] @ X_tip_foot

    straight = foot(np.zeros(len(names)))
    swing = next((joint for joint in leg.joints if _pitches(at_zero, joint)), None)
    hip_x = at_zero[(swing or leg.joints[0]).child].xyz[0]
    behind = swing is not None and straight.xyz[0] - hip_x < -BEHIND_M
    lower, upper = np.array([_room(joint) for joint in leg.joints]).T
    bent = _bent(leg, at_zero, behind) if bends else [others[name] for name in names]
    start = np.clip(bent, lower, upper)
    drawn = (at_zero[leg.tip] @ X_tip_foot).xyz
    ahead, aside = stance.shift_m
    target = np.array(
        [hip_x if bends else drawn[0], drawn[1], _floor(legs, at_zero, bends, stance)]
    )
    target += (ahead, aside, 0.0)
    flat = len(leg.joints) >= ANKLE

    def residual(q: Array) -> Array:
        now = foot(q)
        tilt = now.rotation[2] - straight.rotation[2] if flat else np.zeros(3)
        miss = 10.0 * (np.asarray(now.xyz) - target)
        return np.concatenate([miss, 2.0 * tilt, 0.02 * (q - start)])

    solved = least_squares(residual, start, bounds=(lower - 1e-9, upper + 1e-9)).x
    return dict(zip(names, map(float, solved), strict=True))


def _room(joint: Joint) -> tuple[float, float]:
    """The range with a margin at both ends, where it is wide enough for one."""
    lower, upper = bounds(joint)
    margin = MARGIN_RAD if upper - lower > 4 * MARGIN_RAD else 0.0
    return max(lower + margin, -math.pi), min(upper - margin, math.pi)


def _floor(
    legs: tuple[Leg, ...], at_zero: Mapping[str, Pose], bends: bool, stance: Stance
) -> float:
    """Height of the ground that all feet meet, in the root's frame, m."""
    share = CROUCH if len(legs) >= 4 else SETTLE if bends else 1.0
    share = min(share, BENT) if stance.bent else share
    heights = []
    for leg in legs:
        hip = at_zero[leg.joints[0].child].xyz[2]
        reach, length = hip - leg.X_root_foot.xyz[2], leg.length
        heights.append(hip - share * (reach if reach > FOLDED * length else length))
    return float(np.mean(heights))


def _pitches(at_zero: Mapping[str, Pose], joint: Joint) -> float:
    """+1 or -1 for an axis along the root's y or against it, else 0."""
    y = float((at_zero[joint.child].rotation @ np.asarray(joint.axis))[1])
    return math.copysign(1.0, y) if abs(y) > 0.8 and joint.kind != "prismatic" else 0.0


def _bent(leg: Leg, at_zero: Mapping[str, Pose], behind: bool) -> list[float]:
    """A bent knee that points back: thigh forward, calf twice as far back again.

    behind: a leg drawn with its foot behind its hip is the mirror image: its knee points forward.
    """
    swings = iter((-0.7, 1.4, -0.7) if behind else (0.7, -1.4, 0.7))
    signs = [_pitches(at_zero, joint) for joint in leg.joints]
    return [
        sign * next(swings, 0.0) if sign else resting(joint)
        for sign, joint in zip(signs, leg.joints, strict=True)
    ]
