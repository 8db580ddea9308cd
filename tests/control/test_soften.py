"""Who decides how soft a limit is: MuJoCo, the source or the recipe."""

from __future__ import annotations

from dataclasses import replace

from tiny import TinyRobot, pendulum

from assetbuild.robot.model import Control, MjcfOnly
from assetbuild.robot.sides import Side
from assetbuild.robot.softness import CouplingError, LimitError, softened

LIMITS, COUPLINGS = LimitError.model_validate({}), CouplingError.model_validate({})
SAID = MjcfOnly("joint", '<joint solreflimit="0.03 1"/>', "swing_joint")


def strong(effort: float = 500.0) -> TinyRobot:
    """The pendulum with a motor that MuJoCo's default limits do not hold."""
    robot = pendulum()
    (row,) = robot.control.actuators
    control = replace(robot.control, actuators=(replace(row, effort=effort),))
    return replace(robot, control=control)


def limits_of(robot: TinyRobot, side: Side, control: Control | None = None) -> tuple[str, ...]:
    made = softened(robot.tree, control or robot.control, (side,), LIMITS, COUPLINGS)
    return tuple(name for name, _ in made.soft_limits)


def test_a_strong_motor_gets_stiffer_limits_and_a_weak_one_keeps_mujocos() -> None:
    assert limits_of(strong(), Side()) == ("swing_joint",)
    assert limits_of(strong(5.0), Side()) == ()


def test_an_mjcf_keeps_its_limits_unless_the_recipe_states_a_wish() -> None:
    assert limits_of(strong(), Side(from_mjcf=True)) == ()
    assert limits_of(strong(), Side(from_mjcf=True, stated=("limits",))) == ("swing_joint",)


def test_softness_that_the_source_states_wins() -> None:
    robot = strong()
    said = replace(robot.control, mjcf_only=(SAID,))
    assert limits_of(robot, Side(from_mjcf=True, stated=("limits",)), said) == ()
