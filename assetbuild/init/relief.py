"""Limbs that the drives could not hold stretched out hang instead, and none lies in another.

At a pose of zeros many arms reach straight forward, the heaviest pose they know (PR2's shoulders
would need 52 of their 30 N m), and the two arms of a bench may reach into each other, or into the
floor. Where gravity loads a joint too much, the joints beyond it, the outermost first, and then
itself, take another of a few values within their limits: the one that relieves most, and of those
the one nearest to rest. So an arm folds before it drops into the body. Where bodies lie in each
other, the joints between them do the same; where that is in vain, the best of some random poses
is the start.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from assetbuild.init.anatomy import Leg, chain_to
from assetbuild.init.gravity import gravity_loads, sample_poses
from assetbuild.init.joint_range import bounds
from assetbuild.robot.model import Joint, Tree

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
ROUNDS = 12
FEW = 6
"""Random poses that show which bodies always lie in each other."""
STARTS = 20
"""Random poses of which the best is a start, where the search from the pose of rest fails."""

Pose = Mapping[str, float]
Depths = Callable[[Pose], Mapping[tuple[str, str], float]]
"""Joint values -> how deep two bodies lie in each other, or "" (the floor) and one; m."""


@dataclass(frozen=True)
class _Search:
    """free: joints that may turn; rest: where they would like to be; always: pairs to overlook."""

    tree: Tree
    free: Sequence[Joint]
    rest: Pose
    depths: Depths
    always: frozenset[tuple[str, str]]

    def must_turn(self, pose: Pose) -> bool:
        """Whether a build rejects the pose, and a joint might help."""
        over = self.objections(pose)
        return any(v > REJECTED and self._movers(what) for what, v in over.items())

    def objections(self, pose: Pose) -> dict[str | tuple[str, str], float]:
        """By joint what it bears beyond HEAVY, by pair of bodies its depth beyond DEEP_M."""
        loads = _loads(self.tree, pose, self.free)
        depths = self.depths(pose).items()
        deep = {p: (d - DEEP_M) / FULL_DEPTH_M for p, d in depths if p not in self.always}
        found = {**{name: load - HEAVY for name, load in loads.items()}, **deep}
        return {what: over for what, over in found.items() if over > 0.0}

    def from_pose(self, pose: Pose) -> dict[str, float]:
        """The pose after ROUNDS of turning what objects most."""
        found, stuck = dict(pose), set[str | tuple[str, str]]()
        for _ in range(ROUNDS):
            over = {w: v for w, v in self.objections(found).items() if w not in stuck}
            if not over:
                break
            worst = max(over, key=lambda what: (over[what], str(what)))
            better = self._turned(found, worst)
            if better == found:
                stuck.add(worst)
            found = better
        return found

    def _turned(self, now: Pose, worst: str | tuple[str, str]) -> dict[str, float]:
        """Joint after joint, from the tip inward, takes its best value."""
        found = dict(now)
        for mover in sorted(self._movers(worst), key=lambda j: -len(chain_to(self.tree, j.child))):
            at = found[mover.name]
            values = [at, *_values(mover, at, fine=not isinstance(worst, str))]
            pull = PULL if mover.name == worst else PULL_BEYOND
            pull /= max(values) - min(values) or 1.0

            def cost(value: float, mover: Joint = mover, pull: float = pull) -> float:
                over = math.fsum(self.objections({**found, mover.name: value}).values())
                return over + pull * abs(value - self.rest[mover.name])

            found[mover.name] = min(values, key=cost)
            if worst not in self.objections(found):
                break
        return found

    def _movers(self, worst: str | tuple[str, str]) -> list[Joint]:
        """The joint and those beyond it; those that move one body against the other."""
        if isinstance(worst, str):
            joint = self.tree.by_joint[worst]
            return [j for j in self.free if joint in chain_to(self.tree, j.child)]
        one, other = (chain_to(self.tree, body) if body else () for body in worst)
        return [j for j in self.free if (j in one) != (j in other)]


def relieved(
    tree: Tree, pose: Pose, legs: tuple[Leg, ...], depths: Depths = lambda pose: {}
) -> dict[str, float]:
    """The pose with overloaded limbs lowered and none in another; legs stay as they stand.

    Bodies that lie in each other in every pose do so by their shape.
    """
    standing = {joint.name for leg in legs for joint in chain_to(tree, leg.tip)}
    free = [j for j in tree.moving_joints if j.mimic is None and j.name not in standing]
    drawn = [{**pose, **other} for other in sample_poses(free, STARTS)[1:]]
    always = set(depths(pose)).intersection(*map(depths, drawn[:FEW])) if depths(pose) else set()
    search = _Search(tree, free, pose, depths, frozenset(always))
    found = search.from_pose(pose)
    if not search.must_turn(found):
        return found
    again = search.from_pose(
        min(drawn, key=lambda start: math.fsum(search.objections(start).values()))
    )
    if search.must_turn(again):
        return found
    for joint in free:
        rested = {**again, joint.name: pose[joint.name]}
        again = again if search.objections(rested) else rested
    return again


def _values(joint: Joint, now: float, fine: bool) -> list[float]:
    lower, upper = bounds(joint)
    lower, upper = max(lower, -math.pi), min(upper, math.pi)
    margin = 0.02 * (upper - lower)
    near = [now + side * step for step in STEPS if fine for side in (-1.0, 1.0)]
    inside = [value for value in near if lower + margin <= value <= upper - margin]
    return inside + [float(v) for v in np.linspace(lower + margin, upper - margin, VALUES)]


def _loads(tree: Tree, pose: Pose, joints: Sequence[Joint]) -> dict[str, float]:
    """Share of its effort limit with which each joint holds what hangs on it."""
    limited = [j for j in joints if j.limits.effort and j.kind != "prismatic"]
    loads = gravity_loads(tree, pose, limited)  # a slide holds the same weight in every pose
    return {j.name: loads[j.name] / (j.limits.effort or math.inf) for j in limited}
