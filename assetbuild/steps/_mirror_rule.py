"""Do the axes and ranges of left and right joints belong together?

A robot is mirrored in its plane y = 0. A turn is a pseudo-vector: the mirror image of a turn by q
about `a` is one by q about -M a, with M = diag(1, -1, 1). So where the right axis is -M a (two
knees about +y), the ranges of both sides are equal; where it is M a (two hips about +x), they are
[l, u] and [-u, -l]. The other way round one of the two axes points the wrong way.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from assetbuild.findings import Finding
from assetbuild.robot.model import Joint, Tree
from assetbuild.robot.pose import Array
from assetbuild.robot.tree import forward_kinematics

SIDES = (
    (r"(?i:left)", "right"),
    (r"(?<![A-Za-z0-9])[lL](?![A-Za-z0-9])", "r"),
    (r"(?<![A-Za-z])[FfRrBbHhMm][lL](?![a-z])", "?r"),
)
"""How names say left -> what they say on the right; `?` keeps the letter before."""
ALIGNED = 0.99
"""Cosine: axes this close are mirror images."""
BESIDE_M = 1e-3
RANGE_RAD = 0.02
"""Ranges closer than this are equal; a range as wide to both sides tells nothing."""


def mirror_findings(tree: Tree) -> Iterator[Finding]:
    """One finding for each pair whose ranges contradict its axes."""
    poses = forward_kinematics(tree, {})
    for left in tree.moving_joints:
        right = tree.by_joint.get(_other_side(left.name, set(tree.by_joint)))
        if right is None or left.kind != "revolute" or right.kind != "revolute":
            continue
        if left.mimic or right.mimic:
            continue
        a, b = (poses[joint.child].rotation @ np.asarray(joint.axis) for joint in (left, right))
        p, q = (np.asarray(poses[joint.child].xyz) for joint in (left, right))
        if np.abs(p * (1.0, -1.0, 1.0) - q).max() > BESIDE_M:
            continue
        yield from _judge(left, right, a, b)


def _judge(left: Joint, right: Joint, a: Array, b: Array) -> Iterator[Finding]:
    image = a * (1.0, -1.0, 1.0)
    cosine = float(image @ b)
    own, other = _range(left), _range(right)
    if abs(cosine) < ALIGNED or own is None or other is None:
        return
    (low, high), (other_low, other_high) = own, other
    equal = max(abs(low - other_low), abs(high - other_high)) <= RANGE_RAD
    opposite = max(abs(low + other_high), abs(high + other_low)) <= RANGE_RAD
    if equal == opposite:  # as wide to both sides, or no mirror image at all
        return
    if equal == (cosine < 0.0):
        return
    words = "the same" if equal else "opposite"
    yield Finding(
        "joint.mirror",
        "warning",
        f"joint {right.name}",
        f"its range {other_low:g}..{other_high:g} rad is {words} as that of `{left.name}`, "
        f"{low:g}..{high:g}, but the two axes are {'opposite' if equal else 'alike'} as mirror "
        "images: one of them points the wrong way",
        f"edit `flip_axis: {{joint: {right.name}, limits: keep}}`, or of the other, once you know "
        "which; `set_limits` if a range is wrong",
        data={"other": left.name, "lower": other_low, "upper": other_high},
    )


def _range(joint: Joint) -> tuple[float, float] | None:
    lower, upper = joint.limits.lower, joint.limits.upper
    return (lower, upper) if lower is not None and upper is not None and lower < upper else None


def _other_side(name: str, known: set[str]) -> str:
    """The name of the joint on the right of one on the left, "" when there is none."""
    for pattern, word in SIDES:
        for match in re.finditer(pattern, name):
            old = match[0]
            new = word.replace("?", old[:1])
            new = new.upper() if old.isupper() else new.capitalize() if old[0].isupper() else new
            other = name[: match.start()] + new + name[match.end() :]
            if other in known and other != name:
                return other
    return ""
