"""MuJoCo beside PhysX, row by row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar

from assetbuild.alignment.check import AlignmentCheck
from assetbuild.alignment.gap import ranges_of, told
from assetbuild.alignment.row import Row
from assetbuild.alignment.touching import Pairs, touching_in_usd
from assetbuild.facts.held import Held
from assetbuild.facts.readers.usd import UsdReader
from assetbuild.findings import Finding, Rule
from assetbuild.robot.model import Control, Tree
from assetbuild.simulators.experiments import Experiment
from assetbuild.simulators.physx import ITERATIONS, PhysxCheck

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
        """As the USD says: PhysX does not tell."""
        usd = UsdReader(robot=self.robot).read(inputs / f"usd/{self.robot}.usda")
        return touching_in_usd(usd, tree)

    def beyond(
        self, rows: Sequence[Row], control: Control, asked: Mapping[str, Experiment]
    ) -> tuple[Mapping[str, object], tuple[Finding, ...]]:
        """What to randomize, so that a policy has met both engines."""
        sine = asked["sine"].sine if "sine" in asked else None
        ranges = dict(ranges_of(rows, control, sine.frequency_hz if sine else 1.0))
        return {"randomize": ranges, "isaac_lab": UNMEASURED}, tuple(told(ranges))
