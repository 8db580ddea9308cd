"""The questions that Newton is asked as MuJoCo is: one class each, with the rule that it breaks.

Both have MuJoCo's dynamics, so that what is off is about what Newton read in the USD, or about a
default of its solver. Whether Newton holds the robot at all is the check `smoke_newton`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from assetbuild.alignment.check import AlignmentCheck
from assetbuild.alignment.row import Row
from assetbuild.alignment.touching import touching_row
from assetbuild.facts.held import Held, HeldModel
from assetbuild.findings import Rule
from assetbuild.policy.counting import OrdersCheck
from assetbuild.robot.model import Tree
from assetbuild.simulators import mujoco
from assetbuild.simulators.loops import LoopCheck
from assetbuild.simulators.newton import NewtonCheck
from assetbuild.simulators.slopes import SlopeCheck
from assetbuild.simulators.stage_grip import StageGripping

CREEP = Rule(
    "newton.slope",
    "warning",
    "a standing robot slides in Newton on a slope below the angle of friction",
    "a shorter timestep: gravity tilts at once there, and what slides then may not stop; does the "
    "friction of its feet reach the USD?",
)
LOST = Rule(
    "newton.grip",
    "warning",
    "a gripper loses an object in Newton, or lets it slip",
    "more effort, stiffer contacts of the fingers; Newton's own cone is pyramidal",
)
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


class NewtonOrders(OrdersCheck, NewtonCheck):
    """Does Newton count the joints of `usd/<robot>.usda` as the policy's contract says?"""

    own_name = "newton_orders"
    order: ClassVar[str] = "newton"


class NewtonLoops(LoopCheck, NewtonCheck):
    """Swings the driven joints of `usd/<robot>.usda` in Newton and measures every gap."""

    own_name = "newton_loops"


class NewtonSlope(SlopeCheck, NewtonCheck):
    """Does in Newton what `slope` does in MuJoCo, whose model says how steep it may be."""

    own_name = "newton_slope"
    creeps: ClassVar[Rule] = CREEP


class NewtonGripping(StageGripping, NewtonCheck):
    """Does each gripper of `usd/<robot>.usda` hold objects in Newton as well?"""

    own_name = "newton_grip"
    lost: ClassVar[Rule] = LOST


class NewtonAlignment(AlignmentCheck, NewtonCheck):
    """`mjcf/` in MuJoCo and `usd/` in Newton: how they fall, follow, stand, land, and touch."""

    own_name = "newton_alignment"
    off: ClassVar[Rule] = OFF
    failed: ClassVar[Rule] = FAILED_RUN

    def held_rows(self, model: mujoco.Model, held: Held, tree: Tree) -> Iterator[Row]:
        """Newton's solver is MuJoCo's, so its masks say what may touch."""
        yield touching_row(model, HeldModel(held), tree)
