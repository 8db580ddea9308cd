"""Which joint of a limb counts the other way round than its twin, where all others agree.

Two conventions are common for the axes of twins: both sides have the same axes in the robot's
frame, or each axis is the mirror image of its twin's. In some legs all axes are turned round. A
limb follows one of the three. A single joint that does not is a slip: its range and its poses may
be turned round with it, so that the robot moves as it should, but commands and observations have
the wrong sign.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from assetbuild.robot.pose import Array
from assetbuild.robot.twins import Motion, Part

LEAST = 3
"""Joints of a limb: of two that differ nobody can say which is wrong."""
Pair = tuple[Part, Part]
Joints = tuple[Motion, Motion]


def odd_axes(
    pairs: Sequence[Pair], flip: Array, tolerance: float, *, strictly: bool
) -> Iterator[tuple[Joints, int]]:
    """Each joint that is alone in its limb, with its twin, and how many others agree.

    strictly: only a joint that follows neither convention; a hand may follow another one than its
    arm.
    pairs: twins; flip: (3, 3) mirror image; tolerance: rad, of axes that are compared at all.
    """
    for limb in _limbs(pairs):
        joints = [
            (one, other)
            for left, right in limb
            if len(left.joints) == len(right.joints)
            for one, other in zip(left.joints, right.joints, strict=True)
            if one.turns == other.turns and _aligned(one, other, flip, tolerance)
        ]
        alike = [_cosine(one.axis, other.axis) > 0.0 for one, other in joints]
        mirrored = [_cosine(image(one, flip), other.axis) > 0.0 for one, other in joints]
        kept = max(alike, mirrored, [not one for one in alike], key=sum)  # the first of equals
        if len(joints) >= LEAST and kept.count(False) == 1:
            odd = kept.index(False)
            if not strictly or not (alike[odd] or mirrored[odd]):
                yield joints[odd], len(joints) - 1


def image(joint: Motion, flip: Array) -> Array:
    """(3,) the axis of the mirror image: a turn is a pseudo-vector."""
    return np.asarray((-1.0 if joint.turns else 1.0) * (flip @ joint.axis))


def _limbs(pairs: Sequence[Pair]) -> list[list[Pair]]:
    """Twins that hang together, parents first."""
    limb_of: dict[str, list[Pair]] = {}
    limbs: list[list[Pair]] = []
    for pair in pairs:
        limb = limb_of.get(pair[0].parent)
        if limb is None:
            limbs.append(limb := [])
        limb.append(pair)
        limb_of[pair[0].name] = limb
    return limbs


def _aligned(one: Motion, other: Motion, flip: Array, tolerance: float) -> bool:
    """Whether the axes are parallel to each other's mirror image, whichever way they point."""
    return float(np.arccos(abs(_cosine(image(one, flip), other.axis)))) <= tolerance


def _cosine(a: Array, b: Array) -> float:
    return float(np.clip(a @ b, -1.0, 1.0))
