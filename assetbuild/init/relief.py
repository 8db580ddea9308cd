"""Limbs that the drives could not hold stretched out hang instead.

At a pose of zeros many arms reach straight forward, the heaviest pose they know: PR2's shoulders
would need 52 of their 30 N m. Where gravity loads a joint too much, the joints beyond it, the
outermost first, and then itself, take another of a few values within their limits: the one that
relieves most, and of those the one nearest to rest. So an arm folds before it drops into the body.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from assetbuild.init.anatomy import Leg, chain_to
from assetbuild.init.gravity import gravity_loads
from assetbuild.init.joint_range import bounds
from assetbuild.robot.model import Joint, Tree

HEAVY = 0.7
"""Share of the effort limit that holding the pose may need."""
VALUES = 9
"""Values that a joint may try, over its range."""
PULL, PULL_BEYOND = 0.05, 0.3
"""Overload that the other end of its range is worth, of the overloaded joint and of the joints
beyond it: a limb folds where that helps much, and not into itself for little."""
ROUNDS = 12


def relieved(tree: Tree, pose: Mapping[str, float], legs: tuple[Leg, ...]) -> dict[str, float]:
    """The pose with overloaded limbs lowered; legs stay as they stand."""
    standing = {joint.name for leg in legs for joint in chain_to(tree, leg.tip)}
    free = [j for j in tree.moving_joints if j.mimic is None and j.name not in standing]
    found, stuck = dict(pose), set[str]()
    for _ in range(ROUNDS):
        loads = _loads(tree, found, free)
        heavy = [n for n in loads if loads[n] > HEAVY and n not in stuck]
        if not heavy:
            break
        worst = max(heavy, key=lambda name: (loads[name], name))
        lighter = _relieve(tree, found, pose, free, tree.by_joint[worst])
        if lighter == found:
            stuck.add(worst)
        found = lighter
    return found


def _relieve(
    tree: Tree,
    now: Mapping[str, float],
    rest: Mapping[str, float],
    free: list[Joint],
    joint: Joint,
) -> dict[str, float]:
    """Joint after joint, from the tip inward to the overloaded one, takes its best value."""
    found = dict(now)
    movers = [j for j in free if joint in chain_to(tree, j.child)]
    for mover in sorted(movers, key=lambda j: -len(chain_to(tree, j.child))):
        values = [found[mover.name], *_values(mover)]
        pull = PULL if mover == joint else PULL_BEYOND
        pull /= max(values) - min(values) or 1.0

        def cost(value: float, mover: Joint = mover, pull: float = pull) -> float:
            loads = _loads(tree, {**found, mover.name: value}, free)
            over = sum(max(0.0, load - HEAVY) for load in loads.values())
            return over + pull * abs(value - rest[mover.name])

        found[mover.name] = min(values, key=cost)
        if all(load <= HEAVY for load in _loads(tree, found, [joint]).values()):
            break
    return found


def _values(joint: Joint) -> list[float]:
    lower, upper = bounds(joint)
    lower, upper = max(lower, -math.pi), min(upper, math.pi)
    margin = 0.02 * (upper - lower)
    return [float(v) for v in np.linspace(lower + margin, upper - margin, VALUES)]


def _loads(tree: Tree, pose: Mapping[str, float], joints: list[Joint]) -> dict[str, float]:
    """Share of its effort limit with which each joint holds what hangs on it."""
    limited = [j for j in joints if j.limits.effort and j.kind != "prismatic"]
    loads = gravity_loads(tree, pose, limited)  # a slide holds the same weight in every pose
    return {j.name: loads[j.name] / (j.limits.effort or math.inf) for j in limited}
