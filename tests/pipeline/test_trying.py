"""How a USD that nobody built falls in PhysX is judged; the simulator itself is not needed here."""

from __future__ import annotations

import numpy as np
import pytest

from assetbuild.pipeline.trying import GRAVITY, TIMESTEP_S, _fell
from assetbuild.simulators import physx
from assetbuild.simulators.experiments import Motion

SECONDS = 0.5
IDEAL_M = 9.81 / 2 * SECONDS**2


def fallen(drop_m: float, sideways_m: float = 0.0) -> physx.Outcome:
    """Two samples of a centre of mass."""
    com = np.array([[0.0, 0.0, 1.0], [sideways_m, 0.0, 1.0 - drop_m]])
    turn = np.tile((1.0, 0.0, 0.0, 0.0), (2, 1))
    return physx.Outcome(None, Motion(np.array([0.0, SECONDS]), {}, com, turn, com))


@pytest.mark.parametrize("iterations", [1, 4, 255])
def test_what_falls_as_a_solver_of_any_iterations_must_is_no_finding(iterations: int) -> None:
    drop = 9.81 / 2 * SECONDS * (SECONDS + TIMESTEP_S / iterations)
    assert list(_fell(fallen(drop), physx.Setting(TIMESTEP_S, GRAVITY))) == []


@pytest.mark.parametrize(
    ("drop", "sideways"), [(0.0, 0.0), (0.9 * IDEAL_M, 0.0), (1.1 * IDEAL_M, 0.0), (IDEAL_M, 0.2)]
)
def test_what_is_welded_damped_or_pushed_is_told(drop: float, sideways: float) -> None:
    (finding,) = _fell(fallen(drop, sideways), physx.Setting(TIMESTEP_S, GRAVITY))
    assert finding.rule == "physx.free_fall"
