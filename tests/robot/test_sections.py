"""What one unit of a policy's action moves."""

from __future__ import annotations

import pytest

from assetbuild.robot.sections import Action


@pytest.mark.parametrize(
    ("action", "effort", "kp", "unit"),
    [
        (Action(), 24.0, 16.0, 0.25 * 24.0 / 16.0),
        (Action(), 24.0, 6.0, 0.5),
        (Action(), 24.0, 80.0, 0.25),  # a quarter of the effort is 0.075 rad: it learns to stand
        (Action(min_rad=0.0), 24.0, 80.0, 0.25 * 24.0 / 80.0),
        (Action(rad=0.1), 24.0, 80.0, 0.1),
        (Action(), None, 80.0, 0.5),
    ],
)
def test_a_unit_of_action_moves_a_joint_neither_too_little_nor_too_far(
    action: Action, effort: float | None, kp: float, unit: float
) -> None:
    assert action.scale(effort, kp, slides=False) == unit
    assert action.scale(24.0, 2000.0, slides=True) == 0.25 * 24.0 / 2000.0
