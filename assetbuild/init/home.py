"""A home pose inside the limits: legs under their hips, everything else at 0 where it may be.

Limbs that the drives could not hold stretched out hang instead, and none lies in another. At a pose
of zeros many arms reach straight forward, the heaviest pose they know (PR2's shoulders would need
52 of their 30 N m), and the two arms of a bench may reach into each other, or into the floor. Where
gravity loads a joint too much, the joints beyond it, the outermost first, and then itself, take
another of a few values within their limits: the one that relieves most, and of those the one
nearest to rest. So an arm folds before it drops into the body. Where bodies lie in each other, the
joints between them do the same; where that is in vain, the best of some random poses is the start.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from assetbuild.init.anatomy import ANKLE, Anatomy, Leg
from assetbuild.init.strength import bounds, gravity_loads, resting, sample_poses
from assetbuild.init.wheels import bodies_below
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.model import Joint, Tree
from assetbuild.robot.pose import Array, Pose
from assetbuild.robot.tree import chain_to, forward_kinematics

CROUCH = 0.75
"""Height of the hips of a walker on four legs or more, as a share of the stretched legs'."""
FOLDED = 0.25
"""Height of a hip at the zero pose, as a share of the leg's length, below which a leg is folded."""
SPRAWLED = 0.5
"""The height, and the least way from the hip to the side, of a leg that is drawn stretched out
level: its foot comes down where it likes."""
LEVEL_M = 0.01
"""Feet this close in height stand on one level; hips are at least this far above them."""
SETTLE = 0.97
"""The same on two legs, where a joint of the leg cannot be 0."""
MARGIN_RAD = 0.02
BEHIND_M = 0.02


HEAVY = 0.7
"""Share of the effort limit that holding the pose may need."""
REJECTED = 1.0 - HEAVY
"""Overload with which a build takes no pose: it cannot be held."""
DEEP_M = 0.004
"""How deep a body may lie in another or in the floor: hulls are a little rounder than meshes."""
FULL_DEPTH_M = 0.001 / REJECTED
"""Depth beyond DEEP_M that weighs as much as a load of the whole effort."""
VALUES = 9
"""Values that a joint may try, over its range."""
STEPS = (0.05, 0.1, 0.2, 0.4, 0.8)
"""rad or m to both sides that it may try besides, to come free of another body."""
PULL, PULL_BEYOND = 0.05, 0.3
"""Overload that the other end of its range is worth, of the overloaded joint and of the joints
beyond it: a limb folds where that helps much, and not into itself for little."""
TRUNK = 30.0
"""Times that pull is stronger for a joint that carries all of the robot: a hand turns first."""
ROUNDS = 12
FEW = 6
"""Random poses that show which bodies always lie in each other."""
STARTS = 20
"""Random poses of which the best is a start, where the search from the pose of rest fails; bodies
that lie in each other in all of them are made so."""

JointValues = Mapping[str, float]
Pair = tuple[str, str]
Depths = Callable[[JointValues], Mapping[Pair, float]]
"""Joint values -> depth of overlap by pair of bodies, of their hulls, m, if above DEEP_M; the floor
is ""."""


def nothing_deep(pose: JointValues) -> Mapping[Pair, float]:
    """Return no overlap: the robot's shapes are not known."""
    return {}


Shift = tuple[float, float]
"""How far the feet stand from below the hips, x and y, m."""
UPRIGHT: Shift = (0.0, 0.0)


def home_pose(
    tree: Tree, legs: tuple[Leg, ...], shift: Shift = UPRIGHT, depths: Depths = nothing_deep
) -> dict[str, float]:
    """A value for each moving joint that mimics no other, rad or m, 3 decimals.

    depths: of bodies in each other and in the floor, which joints other than the legs' avoid.
    """
    pose = {j.name: resting(j) for j in tree.moving_joints if j.mimic is None}
    bends = len(legs) >= 4 or any(resting(j) != 0.0 for leg in legs for j in leg.joints)
    if legs and (bends or shift != UPRIGHT):
        for leg in legs:
            pose |= _planted(tree, leg, legs, pose, shift, bends)
    # Overloaded limbs are lowered and none lies in another; legs stay as they stand. Bodies that
    # lie in each other in every pose do so by their shape and are overlooked.
    standing = {joint.name for leg in legs for joint in chain_to(tree, leg.tip)}
    free = [j for j in tree.moving_joints if j.mimic is None and j.name not in standing]
    drawn = [{**pose, **other} for other in sample_poses(free, STARTS)[1:]]
    always = set.intersection(*({*depths(q)} for q in (pose, *drawn[:FEW])))
    pose = _Search(tree, free, pose, depths, always).best(drawn)
    for name, value in pose.items():  # rounded, and within the limits all the same
        lower, upper = bounds(tree.by_joint[name])
        rounded = min(max(round(value, 3), lower), upper) + 0.0
        pose[name] = rounded if math.isfinite(rounded) else 0.0
    return pose


# --- legs -----------------------------------------------------------------------------------


def on_its_legs(tree: Tree, anatomy: Anatomy) -> Anatomy:
    """The anatomy, with legs by name as legs where a pose puts all their feet on one level below
    their hips.
    """
    legs = anatomy.called_legs
    at = forward_kinematics(tree, home_pose(tree, legs)) if legs else {}
    feet = [(at[leg.tip] @ leg.X_tip_foot).xyz[2] for leg in legs]
    hips = [at[leg.joints[0].child].xyz[2] for leg in legs]
    if legs and max(feet) < min(LEVEL_M + min(feet), min(hips) - LEVEL_M):
        return replace(anatomy, legs=legs)
    return anatomy


def _planted(
    tree: Tree,
    leg: Leg,
    legs: tuple[Leg, ...],
    others: Mapping[str, float],
    shift: Shift,
    bends: bool,
) -> dict[str, float]:
    """Joint values that put the foot below its hip, all feet at one height.

    A straight leg's foot stays below where it was drawn.

    Least squares on the foot's position (and, with an ankle to turn it by, how it was drawn), with
    a weak pull to the bent knee it starts from; SciPy's bounded trust region method.
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
    sprawls = _sprawls(leg, at_zero)
    bent = [others[name] for name in names]
    if bends and not sprawls:
        bent = _bent(leg, at_zero, behind)
    start = np.clip(bent, lower, upper)
    drawn = (at_zero[leg.tip] @ X_tip_foot).xyz
    sideways = 0.0 if sprawls else 10.0
    target = np.array([hip_x if bends else drawn[0], drawn[1], _floor(legs, at_zero, bends)])
    target += (*shift, 0.0)
    flat = len(leg.joints) >= ANKLE

    def residual(q: Array) -> Array:
        now = foot(q)
        turn = np.ravel(now.rotation - straight.rotation) if flat else np.zeros(0)
        miss = (sideways, sideways, 10.0) * (np.asarray(now.xyz) - target)
        return np.concatenate([miss, 2.0 * turn, 0.02 * (q - start)])

    solved = least_squares(residual, start, bounds=(lower - 1e-9, upper + 1e-9)).x
    return dict(zip(names, map(float, solved), strict=True))


def _room(joint: Joint) -> tuple[float, float]:
    """The range with a margin at both ends, where it is wide enough for one."""
    lower, upper = bounds(joint)
    margin = MARGIN_RAD if upper - lower > 4 * MARGIN_RAD else 0.0
    return max(lower + margin, -math.pi), min(upper - margin, math.pi)


def _floor(legs: tuple[Leg, ...], at_zero: Mapping[str, Pose], bends: bool) -> float:
    """Height of the ground that all feet meet, in the root's frame, m."""
    share = CROUCH if len(legs) >= 4 else SETTLE if bends else 1.0
    heights = []
    for leg in legs:
        hip = at_zero[leg.joints[0].child].xyz[2]
        reach, length = hip - leg.X_root_foot.xyz[2], leg.length
        high = SPRAWLED if _sprawls(leg, at_zero) else share
        heights.append(hip - high * (reach if reach > FOLDED * length else length))
    return float(np.mean(heights))


def _sprawls(leg: Leg, at_zero: Mapping[str, Pose]) -> bool:
    hip, foot = at_zero[leg.joints[0].child].xyz, leg.X_root_foot.xyz
    is_level = hip[2] - foot[2] <= FOLDED * leg.length
    return is_level and math.dist(hip[:2], foot[:2]) > SPRAWLED * leg.length


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


# --- limbs that hang, and bodies apart ---------------------------------------------------------


@dataclass(frozen=True)
class _Search:
    """free: joints that may turn; rest: where they would like to be;
    among: pairs of bodies that may be apart.
    """

    tree: Tree
    free: Sequence[Joint]
    rest: JointValues
    depths: Depths
    overlooked: Set[Pair]

    def best(self, others: Sequence[JointValues]) -> dict[str, float]:
        """Search from the pose of rest; from the best of others where a build takes none of it,
        and then with as many joints at rest as may be.
        """
        from_rest = self.from_pose(self.rest)
        if not self._must_turn(from_rest):
            return from_rest
        start = min(others, key=lambda pose: math.fsum(self.objections(pose).values()))
        again = self.from_pose(start)
        if self._must_turn(again):
            return from_rest
        for joint in self.free:
            rested = {**again, joint.name: self.rest[joint.name]}
            again = again if self.objections(rested) else rested
        return again

    def _must_turn(self, pose: JointValues) -> bool:
        """Whether a build rejects the pose, and a joint might help."""
        over = self.objections(pose)
        return any(v > REJECTED and self._movers(what) for what, v in over.items())

    def objections(self, pose: JointValues) -> dict[str | Pair, float]:
        """Return the excess of each joint's load (HEAVY) and of each pair's depth (DEEP_M)."""
        excess: dict[str | Pair, float] = {}
        # A slide holds the same weight in every pose.
        limited = [j for j in self.free if j.limits.effort and j.kind != "prismatic"]
        for name, load in gravity_loads(self.tree, pose, limited).items():
            excess[name] = load / (self.tree.by_joint[name].limits.effort or math.inf) - HEAVY
        for pair, depth in self.depths(pose).items():
            if pair not in self.overlooked:
                excess[pair] = (depth - DEEP_M) / FULL_DEPTH_M
        return {what: over for what, over in excess.items() if over > 0.0}

    def from_pose(self, pose: JointValues) -> dict[str, float]:
        """The pose after ROUNDS of turning what objects most."""
        current, stuck = dict(pose), set[str | Pair]()
        for _ in range(ROUNDS):
            over = {w: v for w, v in self.objections(current).items() if w not in stuck}
            if not over:
                break
            worst = max(over, key=lambda what: (over[what], str(what)))
            better = self._turned(current, worst)
            if better == current:
                stuck.add(worst)
            current = better
        return current

    def _turned(self, now: JointValues, worst: str | Pair) -> dict[str, float]:
        """Joint after joint, from the tip inward, takes its best value: of a limb that is too heavy
        until it can be held. Where two bodies meet, the joint turns that frees them best.
        """
        pose, tries = dict(now), []
        for mover in sorted(self._movers(worst), key=lambda j: -len(chain_to(self.tree, j.child))):
            best, over = self._best(pose, mover, worst)
            if isinstance(worst, str):
                pose[mover.name] = best
                if worst not in self.objections(pose):
                    break
            else:
                tries.append((over, mover.name, best))
        if tries:
            _, name, best = min(tries, key=lambda it: it[0])
            pose[name] = best
        return pose

    def _best(self, now: JointValues, mover: Joint, worst: str | Pair) -> tuple[float, float]:
        """The value of a joint that costs least, and what it costs."""
        at = now[mover.name]
        values = [at, *_values(mover, at, fine=not isinstance(worst, str))]
        pull = PULL if mover.name == worst else PULL_BEYOND
        carried = [
            self.tree.by_body[body].inertial for body in bodies_below(self.tree, mover.child)
        ]
        share = math.fsum(i.mass_kg for i in carried if i) / total_mass(self.tree)
        pull *= 1.0 + TRUNK * share
        pull /= max(values) - min(values) or 1.0

        def cost(value: float) -> float:
            over = math.fsum(self.objections({**now, mover.name: value}).values())
            return over + pull * abs(value - self.rest[mover.name])

        best = min(values, key=cost)
        return best, cost(best)

    def _movers(self, worst: str | Pair) -> list[Joint]:
        """The joint and those beyond it; those that move one body against the other."""
        if isinstance(worst, str):
            joint = self.tree.by_joint[worst]
            return [j for j in self.free if joint in chain_to(self.tree, j.child)]
        one, other = (chain_to(self.tree, body) if body else () for body in worst)
        return [j for j in self.free if (j in one) != (j in other)]


def made_so(tree: Tree, depths: Depths, home: JointValues) -> dict[Pair, float]:
    """Bodies that lie in each other at home and in random poses alike, and how deep at home, m.

    As the two halves of a gas spring or the bars of a finger do. No pose frees them.
    """
    deep = {pair: depth for pair, depth in depths(home).items() if all(pair)}
    free = [joint for joint in tree.moving_joints if joint.mimic is None]
    for pose in sample_poses(free, STARTS)[1:]:
        if deep:
            now = depths(pose)
            deep = {pair: depth for pair, depth in deep.items() if pair in now}
    return deep


def _values(joint: Joint, now: float, fine: bool) -> list[float]:
    lower, upper = bounds(joint)
    lower, upper = max(lower, -math.pi), min(upper, math.pi)
    margin = 0.02 * (upper - lower)
    near = [now + side * step for step in STEPS if fine for side in (-1.0, 1.0)]
    inside = [value for value in near if lower + margin <= value <= upper - margin]
    return inside + [float(v) for v in np.linspace(lower + margin, upper - margin, VALUES)]
