"""What one unit of a policy's action moves."""

from __future__ import annotations

import pytest

from assetbuild.robot.sections import Action


@pytest.mark.parametrize(
    ("action", "effort", "kp", "slides", "unit"),
    [
        (Action(), 24.0, 16.0, False, 0.25 * 24.0 / 16.0),
        (Action(), 24.0, 6.0, False, 0.5),
        (Action(), 24.0, 80.0, False, 0.25),  # a quarter of the effort: 0.075 rad, too little
        (Action(min_rad=0.0), 24.0, 80.0, False, 0.25 * 24.0 / 80.0),
        (Action(rad=0.1), 24.0, 80.0, False, 0.1),
        (Action(), None, 80.0, False, 0.5),
        (Action(), 24.0, 2000.0, True, 0.25 * 24.0 / 2000.0),
        (Action(), 24.0, 100.0, True, 0.05),
    ],
)
def test_a_unit_of_action_moves_a_joint_neither_too_little_nor_too_far(
    action: Action, effort: float | None, kp: float, slides: bool, unit: float
) -> None:
    assert action.scale(effort, kp, slides=slides) == unit
