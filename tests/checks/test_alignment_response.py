"""A light joint with dry friction: MuJoCo's soft one creeps, and the row says so."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiny import box_inertial, pendulum, run_step, write_robot_ports

from assetbuild.alignment.asked import SAMPLE_S
from assetbuild.alignment.moved import Compared, FloorLimits
from assetbuild.alignment.row import Row, findings_of
from assetbuild.checks.alignment import OFF
from assetbuild.robot.model import Actuator, Body, Control, Simulation
from assetbuild.simulators.experiments import Motion, Outcome, Setting, Sine, Swing, swing
from assetbuild.simulators.free_fall import Fall
from assetbuild.simulators.mujoco.motion import perform
from assetbuild.targets.mjcf import Mjcf

WRIST = Actuator("swing_joint", "pd", kp=20.0, kd=0.2, friction=1.0, effort=30.0)
SINE = Sine({"swing_joint": 0.0}, {"swing_joint": 0.3}, 1.0, 3.0)
WISH = Swing.model_validate({})
STEP = 0.005


def row_beside(angle: np.ndarray, folder: Path, drive: Actuator = WRIST) -> Row:
    """The row of a wrist of 1e-3 kg m2 beside another engine's motion, sampled at 1 ms."""
    robot = pendulum()
    wrist = Body("arm", box_inertial(0.2, (0.02, 0.02, 0.2), (0.0, 0.0, 0.0)))
    tree = replace(robot.tree, bodies=(robot.tree.bodies[0], wrist))
    weightless = Simulation(timestep=STEP, gravity=(0.0, 0.0, 0.0))
    control = Control((drive,), (), simulation=weightless)
    robot = replace(robot, tree=tree, links=tree, control=control)
    run_step(Mjcf(robot="r"), write_robot_ports(folder / "in", robot), folder / "out")
    time = 1e-3 * np.arange(len(angle))
    still = np.zeros((len(time), 3))
    theirs = Motion(time, {"swing_joint": angle}, still, np.ones((len(time), 4)), still)
    asked = swing("sine_as_is", Setting(STEP, weightless.gravity), SINE, SAMPLE_S)
    both = Compared(
        tree,
        control,
        WISH,
        Fall(),
        FloorLimits(),
        1,
        lambda one: perform(folder / "out/mjcf", "r", (one,))[one.name],
        {asked.name: asked},
        {asked.name: Outcome(None, theirs)},
    )
    (row,) = both.rows()
    return row


def by_coulomb() -> np.ndarray:
    """Without inertia: kd dq/dt = kp (target - q) less the friction, and none below it."""
    dt, angle, out = 1e-4, 0.0, []
    for step in range(30001):
        if step % 10 == 0:
            out.append(angle)
        torque = WRIST.kp * (SINE.target("swing_joint", step * dt) - angle)
        angle += dt * np.sign(torque) * max(abs(torque) - WRIST.friction, 0.0) / WRIST.kd
    return np.array(out)


def test_friction_that_holds_explains_the_row(tmp_path: Path):
    row = row_beside(by_coulomb(), tmp_path)
    assert row.off is not None
    assert row.off > 0.05
    assert row.verdict == "warning"
    (finding,) = findings_of([row], OFF, "PhysX")
    assert finding.severity == "warning"
    assert "soft" in finding.message


def test_a_joint_that_sticks_for_good_is_an_error(tmp_path: Path):
    row = row_beside(np.zeros(3001), tmp_path)
    assert (row.verdict, row.because) == ("error", "")


def test_without_friction_there_is_no_such_reason(tmp_path: Path):
    row = row_beside(by_coulomb(), tmp_path, replace(WRIST, friction=0.0))
    assert row.because == ""
    assert row.verdict in ("warning", "error")


def test_a_reason_makes_an_error_a_warning_and_stands_in_the_table():
    row = Row("sine_as_is", "HIGH", "joint a", "1", "2", 0.3, 0.05, 0.2)
    assert row.verdict == "error"
    known = replace(row, because="soft")
    assert known.verdict == "warning"
    assert known.shown("PhysX")["because"] == "soft"
    (finding,) = findings_of([known, replace(row, off=0.25)], OFF, "PhysX")
    assert finding.severity == "error", "an unexplained row weighs more than a larger known one"


@pytest.mark.parametrize("off", [0.01, 0.04])
def test_a_reason_changes_nothing_within_the_limits(off: float):
    row = Row("sine_as_is", "HIGH", "joint a", "1", "2", off, 0.05, 0.2, because="soft")
    assert row.verdict == "ok"


def test_a_speed_that_only_one_engine_limits_explains_the_row(tmp_path: Path):
    """0.3 rad at 1 Hz is 1.9 rad/s; an engine that keeps to 0.5 rad/s lags behind."""
    drive = replace(WRIST, friction=0.0, velocity=0.5)
    row = row_beside(np.zeros(3000), tmp_path / "limited", drive)
    assert row.verdict == "warning"
    assert row.because.startswith("MuJoCo has no limit of speed: `swing_joint` moves at")
    (found,) = findings_of([row], OFF, "PhysX")
    assert "validate.sine.frequency" in found.hint
    quick = row_beside(np.zeros(3000), tmp_path / "quick", replace(drive, velocity=5.0))
    assert (quick.verdict, quick.because) == ("error", "")
