"""Limits the wrong way round: a warning in the source, an error in what is simulated."""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.findings import Finding, Rule, Severity
from assetbuild.robot.model import Joint

CROSSED_LIMITS = Rule(
    "joint.limits",
    ("warning", "error"),
    "the lower limit is above the upper one, so the MJCF gives the joint no range (a warning in "
    "the source, an error after the edits)",
    "set the limits, or make the joint fixed",
)


def crossed_limits(joint: Joint, severity: Severity) -> Iterator[Finding]:
    """`joint.limits` where the lower limit is above the upper one."""
    lower, upper = joint.limits.lower, joint.limits.upper
    if lower is None or upper is None or lower <= upper:
        return
    unit = "m" if joint.kind == "prismatic" else "rad"
    yield CROSSED_LIMITS(
        f"joint {joint.name}",
        f"lower limit {lower:g} {unit} is not below upper limit {upper:g} {unit}",
        "edit `set_limits` gives it both; make the joint `fixed` if it is not meant to move",
        severity=severity,
        data={"lower": lower, "upper": upper},
    )
