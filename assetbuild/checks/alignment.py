"""MuJoCo beside PhysX, row by row."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from assetbuild.alignment.check import AlignmentCheck
from assetbuild.alignment.touching import Pairs, touching_in_usd
from assetbuild.facts.held import Held
from assetbuild.facts.readers.usd import UsdReader
from assetbuild.findings import Rule
from assetbuild.robot.model import Tree
from assetbuild.simulators.physx import ITERATIONS, PhysxCheck

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
