"""A heavy arm hangs in its home pose; one that its drives hold stays stretched."""

from __future__ import annotations

import math

import pytest

from assetbuild.init.hold import held_pose
from assetbuild.init.home import home_pose
from assetbuild.robot.model import Body, Inertial, Joint, Limits, Tree
from assetbuild.robot.pose import Pose


def arm(effort: float, lower: float = -2.0, upper: float = 2.0) -> Tree:
    """2 kg, half a metre from a hinge that lifts it: 9.81 N m at 0, 9.81 cos q elsewhere."""
    load = Inertial(2.0, (0.5, 0.0, 0.0), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
    hinge = Joint(
        "lift", "revolute", "base", "arm", Pose(), (0.0, 1.0, 0.0),
        Limits(lower, upper, effort, 5.0),
    )  # fmt: skip
    return Tree("r", "fixed", (Body("base", load), Body("arm", load)), (hinge,))


def test_an_arm_that_is_held_stays_stretched():
    assert home_pose(arm(effort=20.0), ()) == {"lift": 0.0}


@pytest.mark.parametrize("effort", [12.0, 8.0, 2.0])
def test_a_heavy_arm_turns_as_far_as_it_must(effort: float):
    (value,) = home_pose(arm(effort), ()).values()
    share = 2.0 * 9.81 * 0.5 * abs(math.cos(value)) / effort
    assert share <= 0.8
    # No step of the grid (4 / 47 rad) too far.
    assert abs(value) < math.acos(0.8 * effort / 9.81) + 4.0 / 47


def test_where_no_position_holds_the_best_is_taken():
    (value,) = home_pose(arm(effort=2.0, lower=-0.5, upper=1.0), ()).values()
    assert value == pytest.approx(1.0, abs=1.5 / 47 + 1e-3)


def test_legs_stand_and_are_left_alone():
    assert held_pose(arm(effort=2.0), {"lift": 0.0}, {"lift"}) == {"lift": 0.0}
