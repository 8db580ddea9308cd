"""What is wrong with the columns of a log: signs, units, joints that are swapped or stand still."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from assetbuild.robot.model import Tree
from assetbuild.robot.pose import Array

OUTSIDE = 0.05
"""rad or m beyond its limits that a joint may be: limits are soft, zeros a little off."""
STILL = 0.01
"""A joint whose command moves by so much (rad or m, standard deviation) should move as well."""
MOVES = 0.02
"""Share of the command's motion that a joint follows at least, unless it stands still."""
FOLLOWS = 0.6
"""Correlation of position and command from which the one follows the other."""


@dataclass(frozen=True)
class Suspicion:
    """One thing that is wrong, and the next move."""

    message: str
    hint: str


def suspicions(
    tree: Tree, joints: Sequence[str], time: Array, values: Mapping[str, Array]
) -> list[Suspicion]:
    """What is wrong, the most telling first. values: (N, J) by the kind of column, rad or m."""
    position, target = values["position"], values["target"]
    found = [*_swapped(joints, position, target), *_against(joints, position, target)]
    found += _still(joints, position, target)
    found += _outside(tree, joints, position)
    if "velocity" in values:
        found += _velocity(joints, time, position, values["velocity"])
    return found


def _correlations(a: Array, b: Array) -> Array:
    """(J, J) correlation of each column of a with each of b; 0 for one that is constant."""
    every = max(1, len(a) // 5000)
    a, b = a[::every] - a[::every].mean(axis=0), b[::every] - b[::every].mean(axis=0)
    spread = np.outer(np.linalg.norm(a, axis=0), np.linalg.norm(b, axis=0))
    found: Array = (a.T @ b) / np.maximum(spread, 1e-12)
    return found


def _swapped(joints: Sequence[str], position: Array, target: Array) -> Iterator[Suspicion]:
    alike = np.abs(_correlations(position, target))
    left = 1.0 - alike**2  # share of the motion that the command leaves open
    for i, joint in enumerate(joints):
        best = int(np.argmax(alike[i]))
        mutual = int(np.argmax(alike[best])) == i
        clear = all(left[a, b] < 0.5 * left[a, a] for a, b in ((i, best), (best, i)))
        if i < best and mutual and clear and alike[i, best] > 0.9:
            yield Suspicion(
                f"the position of `{joint}` follows the command of `{joints[best]}` and the other "
                "way round: two columns are swapped",
                "correct `names`, or the columns of the log",
            )


def _against(joints: Sequence[str], position: Array, target: Array) -> Iterator[Suspicion]:
    alike = np.diag(_correlations(position, target))
    for joint, value in zip(joints, alike, strict=True):
        if value < -FOLLOWS:
            yield Suspicion(
                f"`{joint}` moves against its command (correlation {value:.2f}): the sign of its "
                "position or of its command is wrong",
                "turn the sign of the column in the log",
            )


def _still(joints: Sequence[str], position: Array, target: Array) -> Iterator[Suspicion]:
    for joint, q, u in zip(joints, position.T, target.T, strict=True):
        if np.std(u) > STILL and np.std(q) < MOVES * np.std(u):
            yield Suspicion(
                f"`{joint}` never moves: its position varies by {np.std(q):.2g} while its command "
                f"varies by {np.std(u):.2g}",
                "leave it out by the pattern `joints` of the entry, or correct its column",
            )


def _outside(tree: Tree, joints: Sequence[str], position: Array) -> Iterator[Suspicion]:
    for i, name in enumerate(joints):
        joint = tree.by_joint[name]
        lower, upper = joint.limits.lower, joint.limits.upper
        unlimited = joint.kind == "continuous" or lower is None or upper is None
        if unlimited or lower is None or upper is None:
            lower, upper = (-math.inf, math.inf) if joint.kind == "prismatic" else (-100.0, 100.0)
        low, high = (float(v) for v in np.quantile(position[:, i], (0.005, 0.995)))
        if lower - OUTSIDE <= low and high <= upper + OUTSIDE:
            continue
        yield Suspicion(
            f"`{name}` is at {low:.4g}..{high:.4g}, outside of its limits {lower:.4g}..{upper:.4g}",
            _explained(low, high, lower, upper, joint.kind == "prismatic"),
        )


def _explained(low: float, high: float, lower: float, upper: float, slides: bool) -> str:
    """What would bring the position inside of the limits."""

    def fits(a: float, b: float) -> bool:
        return lower - OUTSIDE <= min(a, b) and max(a, b) <= upper + OUTSIDE

    degree = math.pi / 180.0
    if slides:
        if fits(low * 1e-3, high * 1e-3):
            return "it would be inside if the log were in millimetres: convert it to metres"
    elif max(abs(low), abs(high)) > 6.5 and fits(low * degree, high * degree):
        return "it would be inside in degrees: state `angle_unit: deg`"
    elif max(abs(low), abs(high)) > 100.0:
        return "these may be encoder ticks: state `angle_unit: 4096`, the ticks of one turn"
    if fits(-low, -high):
        return "it would be inside with the other sign: turn the sign of the column in the log"
    return "its zero is off, the columns are another joint's, or the log is another robot's"


def _velocity(
    joints: Sequence[str], time: Array, position: Array, velocity: Array
) -> Iterator[Suspicion]:
    slope = np.gradient(position, time, axis=0)
    alike = _correlations(slope, velocity)
    for i, joint in enumerate(joints):
        if np.std(velocity[:, i]) > 0.0 and alike[i, i] < -FOLLOWS:
            yield Suspicion(
                f"the velocity of `{joint}` has the opposite sign of the slope of its position",
                "turn the sign of one of the two columns",
            )
