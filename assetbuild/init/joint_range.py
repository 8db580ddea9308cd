"""Where a joint may stand, rad or m."""

from __future__ import annotations

import math

from assetbuild.robot.model import Joint


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
