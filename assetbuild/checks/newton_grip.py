"""Does each gripper hold objects in Newton as well?"""

from __future__ import annotations

from typing import ClassVar

from assetbuild.findings import Rule
from assetbuild.simulators.newton import NewtonCheck
from assetbuild.simulators.stage_grip import StageGripping

LOST = Rule(
    "newton.grip",
    "warning",
    "a gripper loses an object in Newton, or lets it slip",
    "more effort, stiffer contacts of the fingers; Newton's own cone is pyramidal",
)


class NewtonGripping(StageGripping, NewtonCheck):
    """In Newton, on `usd/<robot>.usda`."""

    lost: ClassVar[Rule] = LOST
