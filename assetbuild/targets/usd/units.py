"""The units of USD physics: degrees where the robot has radians; nothing else changes."""

from __future__ import annotations

import math

from assetbuild.robot.model import Joint

COUPLED_DEG = 1e8
"""PhysX couples two angles only where both have limits; Newton takes these for none."""


def is_angular(joint: Joint) -> bool:
    """True when the coordinate is an angle; False for a prismatic joint."""
    return joint.kind != "prismatic"


def instance(joint: Joint) -> str:
    """What USD's schemas call the one axis of the joint."""
    return "angular" if is_angular(joint) else "linear"


def to_usd_degrees(angle_rad: float) -> float:
    """Angle or angular velocity: rad to deg, rad/s to deg/s."""
    return math.degrees(angle_rad)


def coordinate(joint: Joint, value: float) -> float:
    """A joint coordinate, limit or velocity in USD's unit: deg (deg/s), or m (m/s) unchanged."""
    return to_usd_degrees(value) if is_angular(joint) else value


def gain(joint: Joint, value: float) -> float:
    """Stiffness, damping or viscous friction in USD's unit: per deg, or per m unchanged."""
    return value * (math.pi / 180.0) if is_angular(joint) else value


def limits(joint: Joint) -> tuple[float, float]:
    """(lower, upper) in deg or m; an open side and a continuous joint are infinite."""
    lower, upper = joint.bounds
    return coordinate(joint, lower), coordinate(joint, upper)
