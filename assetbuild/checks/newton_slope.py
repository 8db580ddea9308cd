"""Does a robot that stands stay where it is on a slope in Newton?"""

from __future__ import annotations

from typing import ClassVar

from assetbuild.findings import Rule
from assetbuild.simulators.newton import NewtonCheck
from assetbuild.simulators.slopes import SlopeCheck

CREEP = Rule(
    "newton.slope",
    "warning",
    "a standing robot slides in Newton on a slope below the angle of friction",
    "a shorter timestep: gravity tilts at once there, and what slides then may not stop; does the "
    "friction of its feet reach the USD?",
)


class NewtonSlope(SlopeCheck, NewtonCheck):
    """Does in Newton what `slope` does in MuJoCo, whose model says how steep it may be."""

    creeps: ClassVar[Rule] = CREEP
