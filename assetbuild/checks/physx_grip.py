"""Does each gripper hold objects in PhysX as well?"""

from __future__ import annotations

from typing import ClassVar

from assetbuild.findings import Rule
from assetbuild.simulators.physx import PhysxCheck
from assetbuild.simulators.stage_grip import StageGripping

LOST = Rule(
    "physx.grip",
    "warning",
    "a gripper loses an object in PhysX, or lets it slip",
    "more effort, collision pieces that do not fill the space between the fingers",
)


class PhysxGripping(StageGripping, PhysxCheck):
    """In PhysX, on `usd/<robot>.usda`."""

    lost: ClassVar[Rule] = LOST
