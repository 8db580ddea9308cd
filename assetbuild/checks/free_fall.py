"""Dropped in MuJoCo without contacts and drives, does the robot fall as its integrator must?"""

from __future__ import annotations

from typing import ClassVar

from assetbuild.findings import Rule
from assetbuild.simulators.free_fall import FreeFallCheck
from assetbuild.simulators.mujoco.motion import MujocoCheck

WRONG_DROP = Rule(
    "free_fall.drop",
    ("warning", "error"),
    "the robot does not fall by g/2 t (t + dt) (an error above 5 %)",
    "check whether a part is fixed to the world",
)
FIXED_BASE = Rule("free_fall.fixed_base", "info", "a fixed base is not dropped", "nothing")


class FreeFall(FreeFallCheck, MujocoCheck):
    """Compares the drop of the centre of mass in MuJoCo with g/2 t (t + dt)."""

    wrong: ClassVar[Rule] = WRONG_DROP
    fixed: ClassVar[Rule | None] = FIXED_BASE
    rounding: ClassVar[float] = 1e-9
