"""MuJoCo beside Newton: the rows of `alignment`, with the USD in Newton's solver.

Both are MuJoCo's dynamics, so that a row that is off is about what Newton read in the USD, or
about a default of its solver.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from assetbuild.alignment.check import AlignmentCheck
from assetbuild.alignment.touching import Pairs, touching_in_mujoco
from assetbuild.facts.held import Held, HeldModel
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
    """`mjcf/` in MuJoCo and `usd/` in Newton: how they fall, follow, stand, land, and touch."""

    off: ClassVar[Rule] = OFF
    failed: ClassVar[Rule] = FAILED_RUN

    def touching(self, inputs: Path, held: Held, tree: Tree) -> Pairs:
        """Newton's solver is MuJoCo's."""
        return touching_in_mujoco(HeldModel(held), tree)
