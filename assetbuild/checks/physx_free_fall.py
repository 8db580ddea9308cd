"""Dropped in PhysX without contacts, does the robot fall as its solver must?"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from assetbuild.findings import Rule
from assetbuild.simulators.free_fall import FreeFallCheck
from assetbuild.simulators.physx import FREE_FALL, ITERATIONS, PhysxCheck


class PhysxFreeFall(FreeFallCheck, PhysxCheck):
    """Compares the drop of the centre of mass with g/2 t (t + dt/N), N position iterations."""

    told: ClassVar[Mapping[str, str]] = ITERATIONS
    wrong: ClassVar[Rule] = FREE_FALL
    rounding: ClassVar[float] = 1e-6

    iterations: int = 8
    """Position iterations of the solver, as the USD target writes them."""
