"""A home pose inside the limits: legs under their hips, everything else at 0 where it may be.

What the drives could not hold there hangs: see `relief`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from assetbuild.init.anatomy import ANKLE, Leg, chain_to
from assetbuild.init.relief import relieved
from assetbuild.robot.model import Joint, Tree
from assetbuild.robot.pose import IDENTITY, Array, Pose
from assetbuild.robot.tree import forward_kinematics, joint_motion

CROUCH = 0.75
"""Height of the hips of a walker on four legs or more, as a share of the stretched legs'."""
SETTLE = 0.97
"""The same on two legs, where a joint of the leg cannot be 0."""
MARGIN_RAD = 0.02
BEHIND_M = 0.02


def home_pose(tree: Tree, legs: tuple[Leg, ...]) -> dict[str, float]:
    """A value for each moving joint that mimics no other, rad or m, 3 decimals."""
    pose = {j.name: resting(j) for j in tree.moving_joints if j.mimic is None}
    bent = len(legs) >= 4 or any(resting(j) != 0.0 for leg in legs for j in leg.joints)
    if legs and bent:
        for leg in legs:
            pose |= _planted(tree, leg, legs, pose)
    pose = relieved(tree, pose, legs)
    return {name: _inside(tree.by_joint[name], value) for name, value in pose.items()}


def resting(joint: Joint) -> float:
    """0 where the limits allow it, else the middle of the range."""
    lower, upper = joint.limits.lower, joint.limits.upper
    if joint.kind == "continuous" or lower is None or upper is None or lower <= 0.0 <= upper:
        return 0.0
    return (lower + upper) / 2 if lower <= upper else 0.0


def _inside(joint: Joint, value: float) -> float:
    """Rounded to 3 decimals and within the limits all the same."""
    lower, upper = _bounds(joint)
    rounded = min(max(round(value, 3), lower), upper) + 0.0
    return rounded if math.isfinite(rounded) else 0.0


def _bounds(joint: Joint) -> tuple[float, float]:
    lower, upper = joint.limits.lower, joint.limits.upper
    if joint.kind == "continuous" or lower is None or upper is None or lower > upper:
        return -math.pi, math.pi
    return lower, upper


# --- legs -----------------------------------------------------------------------------------


def _planted(
    tree: Tree, leg: Leg, legs: tuple[Leg, ...], others: Mapping[str, float]
) -> dict[str, float]:
    """Joint values that put the foot below its hip, all feet at one height.

    Least squares on the foot's position (and, with an ankle to turn it by, its tilt), with a weak
    pull to the bent knee it starts from; SciPy's bounded trust region method.
    """
    from scipy.optimize import least_squares

    chain = _Chain(tree, leg, others)
    start = chain.start()
    lower, upper = np.array([_room(joint) for joint in leg.joints]).T
    start = np.clip(start, lower, upper)
    target = _target(tree, leg, legs)
    flat = len(leg.joints) >= ANKLE
    upright = chain.foot(np.zeros(len(start))).rotation[2]

    def residual(q: Array) -> Array:
        foot = chain.foot(q)
        tilt = foot.rotation[2] - upright if flat else np.zeros(3)
        miss = 10.0 * (np.asarray(foot.xyz) - target)
        return np.concatenate([miss, 2.0 * tilt, 0.02 * (q - start)])

    solved = least_squares(residual, start, bounds=(lower - 1e-9, upper + 1e-9)).x
    return {joint.name: float(v) for joint, v in zip(leg.joints, solved, strict=True)}


def _room(joint: Joint) -> tuple[float, float]:
    """The range with a margin at both ends, where it is wide enough for one."""
    lower, upper = _bounds(joint)
    margin = MARGIN_RAD if upper - lower > 4 * MARGIN_RAD else 0.0
    return max(lower + margin, -math.pi), min(upper - margin, math.pi)


def _target(tree: Tree, leg: Leg, legs: tuple[Leg, ...]) -> Array:
    """Where the foot goes, in the root's frame: under the first joint that swings the leg."""
    at_zero = forward_kinematics(tree, {})
    share = CROUCH if len(legs) >= 4 else SETTLE
    floors = []
    for other in legs:
        hip = at_zero[other.joints[0].child].xyz[2]
        floors.append(hip - share * (hip - other.X_root_foot.xyz[2]))
    swing = next((j for j in leg.joints if _pitches(at_zero, j)), leg.joints[0])
    X_root_foot = _foot_in_root(tree, leg)
    return np.array([at_zero[swing.child].xyz[0], X_root_foot.xyz[1], float(np.mean(floors))])


def _foot_in_root(tree: Tree, leg: Leg) -> Pose:
    body, X_body_foot = tree.placement(leg.foot)
    return forward_kinematics(tree, {})[body] @ X_body_foot


def _pitches(at_zero: Mapping[str, Pose], joint: Joint) -> float:
    """+1 or -1 for an axis along the root's y or against it, else 0."""
    y = float((at_zero[joint.child].rotation @ np.asarray(joint.axis))[1])
    return math.copysign(1.0, y) if abs(y) > 0.8 and joint.kind != "prismatic" else 0.0


class _Chain:
    """The way from the root to one foot."""

    def __init__(self, tree: Tree, leg: Leg, others: Mapping[str, float]) -> None:
        self._leg = leg
        self._names = [joint.name for joint in leg.joints]
        self._joints = chain_to(tree, leg.tip)
        self._X_tip_foot = tree.placement(leg.foot)[1]
        self._others = others
        self._at_zero = forward_kinematics(tree, {})

    def foot(self, q: Array) -> Pose:
        """X_root_foot at the leg's joint values."""
        values = {**self._others, **dict(zip(self._names, map(float, q), strict=True))}
        pose = IDENTITY
        for joint in self._joints:
            value = 0.0 if joint.kind == "fixed" else values.get(joint.name, 0.0)
            pose = pose @ joint.X_parent_joint @ joint_motion(joint, value)
        return pose @ self._X_tip_foot

    def _offset(self) -> float:
        """How far the foot is before the joint that swings the leg at the zero pose, m."""
        swing = next((j for j in self._leg.joints if _pitches(self._at_zero, j)), None)
        if swing is None:
            return 0.0
        return self.foot(np.zeros(len(self._names))).xyz[0] - self._at_zero[swing.child].xyz[0]

    def start(self) -> Array:
        """A bent knee that points back: thigh forward, calf twice as far back again.

        A leg drawn with its foot behind its hip is the mirror image: its knee points forward.
        """
        behind = self._offset() < -BEHIND_M
        swings = iter((-0.7, 1.4, -0.7) if behind else (0.7, -1.4, 0.7))
        bend = []
        for joint in self._leg.joints:
            sign = _pitches(self._at_zero, joint)
            bend.append(sign * next(swings, 0.0) if sign else resting(joint))
        return np.array(bend)
