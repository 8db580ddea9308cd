"""MuJoCo beside PhysX, row by row; how far contacts and drives lie apart, for `randomize`.

A policy that has seen the whole range has seen both engines. Each range is the difference that one
experiment shows, in the value that would explain it:

    friction     the deceleration that makes the ways on a slope of half the friction angle equal:
                 d_mu = 2 |s1 - s2| / (g t² cos a)
    restitution  the speed that is left after a fall from h and a rise of r: e = sqrt(r / h)
    damping      the lag of a joint behind its sine, far below its own frequency:
                 d_damping = d_phase kp / omega, as a factor of kd + damping
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import ClassVar

from assetbuild.alignment.asked import DROP_M, SLOPE, STAND_S
from assetbuild.alignment.check import AlignmentCheck
from assetbuild.alignment.row import Row
from assetbuild.alignment.touching import Pairs, touching_in_usd
from assetbuild.facts.held import Held
from assetbuild.facts.readers.usd import UsdReader
from assetbuild.findings import Finding, Rule
from assetbuild.robot.model import Control, Tree
from assetbuild.simulators.experiments import Experiment
from assetbuild.simulators.physx import ITERATIONS, PhysxCheck

LEAST, MOST = 0.25, 4.0
"""Factors of the damping beyond which a range is no answer: the row itself is an error then."""
Ranges = Mapping[str, tuple[float, float]]

GAP = Rule(
    "alignment.physx.gap",
    "info",
    "ranges of friction, restitution and damping that cover both MuJoCo and PhysX",
    "`randomize` them, where a policy must work in both",
)
UNMEASURED = "unmeasured: docs/how-to/isaaclab.md says how to fill in that half"

OFF = Rule(
    "alignment.physx.*",
    ("warning", "error"),
    "a row of the comparison with MuJoCo is off (an error beyond the coarse limit); the how-to "
    "on Isaac Lab describes the rows",
    "read the report's table of `alignment`",
)
FAILED_RUN = Rule(
    "alignment.physx.run",
    "error",
    "an experiment crashed or went to infinity",
    "see `physx.finite`",
)


class Alignment(AlignmentCheck, PhysxCheck):
    """`mjcf/` in MuJoCo and `usd/` in PhysX: how they fall, follow, stand, land, and touch."""

    usual_s = 60.0
    engines: ClassVar[tuple[str, ...]] = ("mujoco", "physx")
    told: ClassVar[Mapping[str, str]] = {**AlignmentCheck.told, **ITERATIONS}
    off: ClassVar[Rule] = OFF
    failed: ClassVar[Rule] = FAILED_RUN

    iterations: int = 8
    """Position iterations of PhysX's solver."""

    def touching(self, inputs: Path, held: Held, tree: Tree) -> Pairs:
        """Pairs by the USD's filters, because PhysX does not report which pairs it tests."""
        usd = UsdReader(robot=self.robot).read(inputs / f"usd/{self.robot}.usda")
        return touching_in_usd(usd, tree)

    def beyond(
        self, rows: Sequence[Row], control: Control, asked: Mapping[str, Experiment]
    ) -> tuple[Mapping[str, object], tuple[Finding, ...]]:
        """What to randomize, so that a policy has met both engines."""
        sine = asked["sine"].sine if "sine" in asked else None
        ranges = dict(ranges_of(rows, control, sine.frequency_hz if sine else 1.0))
        return {"randomize": ranges, "isaac_lab": UNMEASURED}, tuple(told(ranges))


# --- ranges for `randomize` ---------------------------------------------------------------------


def ranges_of(rows: Sequence[Row], control: Control, sine_hz: float) -> Ranges:
    """Key of `randomize` -> range, where its experiment ran. sine_hz: frequency of the sines."""
    by_name = {row.name: row for row in rows if row.subject == "robot"}
    found: dict[str, tuple[float, float]] = {}
    gravity = math.dist(control.simulation.gravity, (0.0, 0.0, 0.0))
    slide, friction = _both(by_name.get("slide_m")), control.contact.friction[0]
    if slide is not None and gravity > 0.0:
        cosine = math.cos(math.atan(SLOPE * friction))
        apart = 2.0 * abs(slide[0] - slide[1]) / (gravity * STAND_S**2 * cosine)
        found["friction"] = (max(0.0, friction - apart), friction + apart)
    if (rise := _both(by_name.get("bounce_m"))) is not None:
        left = sorted(math.sqrt(min(1.0, max(0.0, r) / DROP_M)) for r in rise)
        found["restitution"] = (left[0], left[1])
    if factors := list(_damping(rows, control, 2.0 * math.pi * sine_hz)):
        found["damping"] = (max(LEAST, min(1.0, *factors)), min(MOST, max(1.0, *factors)))
    return found


def told(ranges: Ranges) -> Iterator[Finding]:
    """One finding with all of them."""
    if ranges:
        said = ", ".join(f"{key} {low:.3g} to {high:.3g}" for key, (low, high) in ranges.items())
        yield GAP(
            "recipe randomize",
            f"ranges that cover MuJoCo and PhysX: {said}",
            hint="`friction` and `restitution` of `randomize`; `damping` as `kd` of its joints",
            data={"simulator": "physx", **ranges},
        )


def _both(row: Row | None) -> tuple[float, float] | None:
    if row is None or isinstance(row.mujoco, str) or isinstance(row.theirs, str):
        return None
    if not (math.isfinite(row.mujoco) and math.isfinite(row.theirs)):
        return None
    return row.mujoco, row.theirs


def _damping(rows: Sequence[Row], control: Control, omega: float) -> Iterator[float]:
    for row in rows:
        drive = control.by_joint.get(row.subject.removeprefix("joint "))
        if row.name != "sine_as_is" or row.lag_rad is None or drive is None:
            continue
        damping = drive.kd + drive.damping
        if drive.kp > 0.0 and damping > 0.0:
            yield 1.0 + row.lag_rad * drive.kp / omega / damping
