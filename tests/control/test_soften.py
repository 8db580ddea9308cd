"""Who decides how soft a limit is, and what is said of effort that nothing holds."""

from __future__ import annotations

from dataclasses import replace

from tiny import TinyRobot, pendulum, tiny_quadruped, with_mimic

from assetbuild.control.soften import softened
from assetbuild.robot.model import Control, MjcfOnly
from assetbuild.robot.sides import Side
from assetbuild.robot.softness import CouplingError, LimitError

LIMITS, COUPLINGS = LimitError.model_validate({}), CouplingError.model_validate({})
SAID = MjcfOnly("joint", '<joint solreflimit="0.03 1"/>', "swing_joint")


def strong(effort: float = 500.0) -> TinyRobot:
    """The pendulum with a motor that MuJoCo's default limits do not hold."""
    robot = pendulum()
    (row,) = robot.control.actuators
    control = replace(robot.control, actuators=(replace(row, effort=effort),))
    return replace(robot, control=control)


def limits_of(robot: TinyRobot, side: Side, control: Control | None = None) -> tuple[str, ...]:
    made, _ = softened(robot.tree, control or robot.control, (side,), LIMITS, COUPLINGS)
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


def test_effort_that_no_limit_holds_at_this_timestep_is_reported() -> None:
    """F / I = 3e8 rad/s2: two steps of 5 ms at the stiffest impedance leave 3.0 rad."""
    robot = strong(2.5e7)
    made, findings = softened(robot.tree, robot.control, (Side(),), LIMITS, COUPLINGS)
    (found,) = findings
    assert (found.rule, found.severity) == ("limits.soft", "warning")
    assert dict(made.soft_limits)["swing_joint"].solimp[1] == 0.9999
    inertia = 0.5**2 / 3 + 0.02**2 / 12  # of a bar about its end
    assert abs(found.data["error"] - 1e-4 * 0.01**2 * 2.5e7 / inertia) < 0.01
    calm = robot.control.simulation.model_copy(update={"timestep": 1e-5})
    control = replace(robot.control, simulation=calm)
    assert not softened(robot.tree, control, (Side(),), LIMITS, COUPLINGS)[1]


def test_effort_that_no_coupling_holds_is_reported() -> None:
    robot = with_mimic(tiny_quadruped(), "FL_calf_joint", "FR_calf_joint", 1.0, 0.0)
    rows = tuple(
        replace(row, effort=1e6) if row.joint == "FR_calf_joint" else row
        for row in robot.control.actuators
        if row.joint != "FL_calf_joint"
    )
    control = replace(robot.control, actuators=rows)
    _, findings = softened(robot.tree, control, (Side(),), LIMITS, COUPLINGS)
    assert ("couplings.soft", "joint FL_calf_joint") in {(f.rule, f.subject) for f in findings}
