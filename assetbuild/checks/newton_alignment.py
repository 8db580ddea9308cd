"""MuJoCo beside Newton: the rows of `alignment`, with the USD in Newton's solver.

Both are MuJoCo's dynamics, so that a row that is off is about what Newton read in the USD, or
about a default of its solver.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

from assetbuild.alignment.check import AlignmentCheck
from assetbuild.alignment.held import newton_rows
from assetbuild.alignment.row import Row
from assetbuild.facts.held import Held
from assetbuild.findings import Rule
from assetbuild.robot.model import Tree
from assetbuild.simulators.newton import NewtonCheck

OFF = Rule(
    "alignment.newton.*",
    ("warning", "error"),
    "a row of the comparison of Newton with MuJoCo is off (an error beyond the coarse limit)",
    "read the report's table of `newton_alignment`",
)
FAILED_RUN = Rule(
    "alignment.newton.run",
    "error",
    "Newton refuses the USD, or an experiment went to infinity in it",
    "the message is Newton's",
)


class NewtonAlignment(AlignmentCheck, NewtonCheck):
    """`mjcf/` in MuJoCo and `usd/` in Newton: what they hold, how they fall, follow, stand."""

    off: ClassVar[Rule] = OFF
    failed: ClassVar[Rule] = FAILED_RUN

    def held_rows(self, inputs: Path, model: Any, held: Held, tree: Tree) -> Iterator[Row]:
        """Rows of what both hold, and of what may touch. model: MuJoCo's."""
        return newton_rows(model, held, tree)
