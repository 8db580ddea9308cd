"""Does a robot that stands stay where it is on a slope in PhysX?"""

from __future__ import annotations

from typing import ClassVar

from assetbuild.findings import Rule
from assetbuild.simulators.physx import PhysxCheck
from assetbuild.simulators.slopes import SlopeCheck

CREEP = Rule(
    "physx.slope",
    "warning",
    "a standing robot slides in PhysX on a slope below the angle of friction",
    "are its drives too weak to hold it? does the friction of its feet reach the USD?",
)


class PhysxSlope(SlopeCheck, PhysxCheck):
    """Does in PhysX what `slope` does in MuJoCo, whose model says how steep it may be."""

    creeps: ClassVar[Rule] = CREEP
