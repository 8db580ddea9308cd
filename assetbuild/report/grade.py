"""The quality grade of MuJoCo Menagerie, with the evidence for each step of it.

Menagerie's words: A+ = the values come from system identification; A = realistic values, not
identified; B = stable, some values unrealistic; C = conditionally stable.
"""

from __future__ import annotations

from dataclasses import dataclass

from assetbuild.findings import is_waived
from assetbuild.report.document import Report
from assetbuild.robot.model import Actuator, Control

UNREAL = ("inertia.", "joint.effort_zero", "joint.velocity_zero", "joint.range", "mirror.", "mass.")
"""Families of rules whose warnings say that a value is not realistic."""
UNSTABLE = ("stand.finite", "stand.fall", "free_fall.drop", "trials.", "mjcf.")


@dataclass(frozen=True)
class Criterion:
    """One thing that the grade needs. needed: the grade that is lost without it."""

    needed: str
    what: str
    met: bool
    evidence: str


def grade(control: Control, report: Report) -> tuple[str, tuple[Criterion, ...]]:
    """The best grade that the evidence carries; A+ needs drives that were measured."""
    criteria = (
        _no_findings(report, "B", "it is stable", UNSTABLE),
        _checks(report),
        _no_findings(report, "A", "masses, inertias and limits are realistic", UNREAL),
        _motors(control),
        _identified(control),
    )
    for level in ("B", "A", "A+"):
        if any(c.needed == level and not c.met for c in criteria):
            return {"B": "C", "A": "B", "A+": "A"}[level], criteria
    return "A+", criteria


def _no_findings(report: Report, needed: str, what: str, families: tuple[str, ...]) -> Criterion:
    found = [f for f in report.findings if f.severity != "info" and f.rule.startswith(families)]
    waived = [f for f in report.findings if is_waived(f) and f.rule.startswith(families)]
    rules = ", ".join(dict.fromkeys(f.rule for f in [*found, *waived]))
    met = not found and not waived
    return Criterion(needed, what, met, "none of its rules warns" if met else f"not so: {rules}")


def _checks(report: Report) -> Criterion:
    physical = ("free_fall", "stand", "trials", "mjcf_equal", "oracle")
    states = {name: report.checks[name].status for name in physical if name in report.checks}
    text = ", ".join(f"{name} {status}" for name, status in states.items()) or "no check ran"
    met = bool(states) and "fail" not in states.values()
    return Criterion("B", "the physical checks pass", met, text)


def _motors(control: Control) -> Criterion:
    driven = [a for a in control.actuators if a.model != "passive"]
    bare = [a.joint for a in driven if not _is_known(a)]
    shown = ", ".join(bare[:4]) + (", ..." if len(bare) > 4 else "")
    what = "each drive has a source, an effort limit and a reflected rotor inertia"
    if not bare:
        return Criterion("A", what, True, f"{len(driven)} of {len(driven)} drives")
    return Criterion("A", what, False, f"{len(bare)} of {len(driven)} have not: {shown}")


def _identified(control: Control) -> Criterion:
    """Rotor inertia and friction or damping of each drive, from logs of the real robot."""
    driven = [a for a in control.actuators if a.model != "passive"]
    met = [
        a for a in driven if "armature" in a.measured and {"friction", "damping"} & {*a.measured}
    ]
    what = "values come from system identification"
    if not any(a.measured for a in driven):
        return Criterion("A+", what, False, "none recorded")
    text = f"armature and friction or damping of {len(met)} of {len(driven)} drives are measured"
    return Criterion("A+", what, len(met) == len(driven), text)


def _is_known(actuator: Actuator) -> bool:
    return bool(actuator.source) and actuator.effort is not None and actuator.armature > 0.0
