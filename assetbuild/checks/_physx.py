"""The questions that PhysX is asked as MuJoCo is: one class each, with the rule that it breaks.

Whether PhysX holds the robot at all is the check `physx_readback`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from assetbuild.alignment.check import AlignmentCheck
from assetbuild.findings import Rule
from assetbuild.policy.counting import OrdersCheck
from assetbuild.simulators.free_fall import FreeFallCheck
from assetbuild.simulators.gripping import StageGripping
from assetbuild.simulators.loops import LoopCheck
from assetbuild.simulators.physx import FREE_FALL, ITERATIONS, PhysxCheck
from assetbuild.simulators.slopes import SlopeCheck

CREEP = Rule(
    "physx.slope",
    "warning",
    "a standing robot slides in PhysX on a slope below the angle of friction",
    "are its drives too weak to hold it? does the friction of its feet reach the USD?",
)
LOST = Rule(
    "physx.grip",
    "warning",
    "a gripper loses an object in PhysX, or lets it slip",
    "more effort, collision pieces that do not fill the space between the fingers",
)
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


class PhysxFreeFall(FreeFallCheck, PhysxCheck):
    """Compares the drop of the centre of mass with g/2 t (t + dt/N), N position iterations."""

    own_name = "physx_free_fall"
    recipe_fields: ClassVar[Mapping[str, str]] = ITERATIONS
    wrong: ClassVar[Rule] = FREE_FALL
    rounding: ClassVar[float] = 1e-6

    iterations: int = 8
    """Position iterations of the solver, as the USD target writes them."""


class PhysxOrders(OrdersCheck, PhysxCheck):
    """Does PhysX, and so Isaac Lab, count the joints as the policy's contract says?"""

    own_name = "physx_orders"
    order: ClassVar[str] = "isaaclab"


class PhysxLoops(LoopCheck, PhysxCheck):
    """Swings the driven joints of `usd/<robot>.usda` in PhysX and measures every gap."""

    own_name = "physx_loops"


class PhysxSlope(SlopeCheck, PhysxCheck):
    """Does in PhysX what `slope` does in MuJoCo, whose model says how steep it may be."""

    own_name = "physx_slope"
    creeps: ClassVar[Rule] = CREEP


class PhysxGripping(StageGripping, PhysxCheck):
    """Does each gripper of `usd/<robot>.usda` hold objects in PhysX as well?"""

    own_name = "physx_grip"
    lost: ClassVar[Rule] = LOST


class Alignment(AlignmentCheck, PhysxCheck):
    """`mjcf/` in MuJoCo and `usd/` in PhysX: how they fall, follow, stand and land."""

    own_name = "alignment"
    usual_s = 60.0
    engines: ClassVar[tuple[str, ...]] = ("mujoco", "physx")
    recipe_fields: ClassVar[Mapping[str, str]] = {**AlignmentCheck.recipe_fields, **ITERATIONS}
    off: ClassVar[Rule] = OFF
    failed: ClassVar[Rule] = FAILED_RUN

    iterations: int = 8
    """Position iterations of PhysX's solver."""
