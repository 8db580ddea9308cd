"""Do limits, mimic joints and loops hold what drives can bring, in the full model and in mjx?"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

from assetbuild.engine.step import Files
from assetbuild.findings import Data, Finding, Rule, Severity
from assetbuild.kinds import write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.softness import Allowed, CouplingError, LimitError, effort_at
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco.pushes import Pushed, off_couplings, open_loops, past_limits

MOST = 2.0
"""Times the wish; the load grows in a fifth of a second, which swings a little."""

LIMITS_SOFT = Rule(
    "limits.soft",
    ("info", "warning"),
    "full effort pushes joints further past their limits in MuJoCo than twice what `limits` allows "
    "(information where an MJCF source says how soft they are)",
    "state the rotor's inertia (`motors` or `armature`), or a shorter timestep; of an MJCF, state "
    "`limits`",
)
COUPLINGS_SOFT = Rule(
    "couplings.soft",
    ("info", "warning"),
    "full effort parts joints from those that they follow, or the ends of loops, in MuJoCo by more "
    "than twice what `couplings` allows (information where an MJCF source says how soft they are)",
    "state the rotor's inertia (`motors` or `armature`), or a shorter timestep; of an MJCF, state "
    "`couplings`",
)


class FullEffort(mujoco.InMujoco):
    """Pushes joints against their limits, followers from their leaders, and loops apart.

    Findings `limits.soft` and `couplings.soft`; figures by file: the largest error of turning and
    of sliding joints, rad and m.
    """

    also: ClassVar[tuple[str, ...]] = ("mjx",)
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")

    told: ClassVar[Mapping[str, str]] = {
        "limits_wish": "limits",
        "couplings_wish": "couplings",
        "source": "source.mjcf",
    }

    robot: str
    limits_wish: LimitError = LimitError.model_validate({})
    couplings_wish: CouplingError = CouplingError.model_validate({})
    source: str | None = None
    """An MJCF that says itself how soft its constraints are."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the robot, `mjcf/<robot>.xml` and, where it is built, `mjx/<robot>_mjx.xml`."""
        robot = RobotFiles(files.inputs)
        tree, control = robot.tree, robot.control
        efforts = {joint.name: effort_at(tree, control, joint) for joint in tree.moving_joints}
        pushing = {row.joint for row in control.actuators if row.model != "passive"}
        driven = {joint: effort for joint, effort in efforts.items() if joint in pushing}
        figures: dict[str, object] = {}
        for folder, path, model in mujoco.full_and_mjx_models(files.inputs, self.robot, figures):
            limits = tuple(past_limits(model, efforts))
            coupled = (*off_couplings(model, efforts), *open_loops(model, driven))
            figures[folder] = {"limits": _worst(limits), "couplings": _worst(coupled)}
            for rule, pushed, wish, ours in (
                (LIMITS_SOFT, limits, self.limits_wish, control.soft_limits),
                (COUPLINGS_SOFT, coupled, self.couplings_wish, control.soft_couplings),
            ):
                # Where none is ours, an MJCF source has decided how soft they are.
                severity: Severity = "warning" if ours or not self.source else "info"
                yield from _judge(rule, pushed, wish, path.name, severity)
        write_figures(files, figures)


def _judge(
    rule: Rule, pushed: Sequence[Pushed], wish: Allowed, file: str, severity: Severity
) -> Iterator[Finding]:
    """One finding for all joints, the furthest first; an unstable simulation before all."""
    shares = [_error(one) / (MOST * (wish.slide if one.slides else wish.turn)) for one in pushed]
    order = sorted(range(len(pushed)), key=lambda index: -shares[index])
    far = [pushed[index] for index in order if shares[index] > 1.0]
    if not far:
        return
    shown = ", ".join(f"`{one.joint}` by {_length(one)}" for one in far[:4])
    verb = "past their limits" if rule is LIMITS_SOFT else "from where they are held"
    data: Data = {"joints": len(far), "of": len(pushed), "first": far[0].joint}
    yield rule(
        "robot",
        f"{file}: full effort pushes {len(far)} of {len(pushed)} joints {verb}: {shown}"
        f"{', ...' if len(far) > 4 else ''} (limit {MOST * wish.turn:.3g} rad, "
        f"{1e3 * MOST * wish.slide:.3g} mm)",
        hint="state the rotor's inertia (`motors` or `armature`), or a shorter timestep"
        + (f"; or state `{rule.id.partition('.')[0]}` in the recipe" if severity == "info" else ""),
        severity=severity,
        data=data,
    )


def _error(one: Pushed) -> float:
    """Infinite where the simulation became unstable."""
    return one.error if math.isfinite(one.error) else math.inf


def _length(one: Pushed) -> str:
    if not math.isfinite(one.error):
        return "more than can be simulated"
    return f"{1e3 * one.error:.3g} mm" if one.slides else f"{one.error:.3g} rad"


def _worst(pushed: Sequence[Pushed]) -> dict[str, object]:
    """The largest error and its joint, for joints that turn and that slide; None if unstable."""
    found: dict[str, object] = {"joints": len(pushed)}
    for kind, slides in (("turn", False), ("slide", True)):
        one = max((one for one in pushed if one.slides == slides), key=_error, default=None)
        if one is not None:
            known = one.error if math.isfinite(one.error) else None
            found[kind] = {"error": known, "joint": one.joint}
    return found
