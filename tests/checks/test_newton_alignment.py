"""Rows of two engines that move one robot: limits, answers of joints, ranges that cover both."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Usd
from tiny import (
    box_inertial,
    four_bar,
    models,
    pendulum,
    run_step,
    spoil_stage,
    tiny_quadruped,
    write_robot_ports,
)

from assetbuild.alignment.asked import SAMPLE_S, experiments_of, into_stop
from assetbuild.alignment.moved import Compared, FloorLimits
from assetbuild.alignment.row import Row, findings_of
from assetbuild.checks._newton import OFF, NewtonAlignment
from assetbuild.engine.world import World
from assetbuild.findings import Finding
from assetbuild.robot.model import Actuator, Body, Control, Joint, Limits, Simulation
from assetbuild.simulators import newton
from assetbuild.simulators.experiments import (
    Experiment,
    Motion,
    Outcome,
    Setting,
    Sine,
    Swing,
    swing,
)
from assetbuild.simulators.free_fall import Fall
from assetbuild.simulators.mujoco.motion import perform
from assetbuild.targets.mjcf import Mjcf

needs_newton = pytest.mark.skipif(
    newton.HOME.python(World()) is None, reason="needs `assetbuild smoke --consumer newton` once"
)


def motion(joint: str, angle: np.ndarray) -> Motion:
    time = 0.01 * np.arange(len(angle))
    still = np.zeros((len(time), 3))
    return Motion(time, {joint: angle}, still, np.ones((len(time), 4)), still)


def past_upper(coarse: float, fine: float) -> Row:
    """The row of a pendulum that runs so much further past its limit than in MuJoCo, rad.

    fine: in shorter steps.
    """
    tree = pendulum().tree
    (joint,) = tree.moving_joints
    drive = Actuator(joint.name, "pd", kp=20.0, kd=0.2)
    asked = experiments_of(tree, Control((drive,), ()), Swing())
    sine = asked["past_upper"].sine
    assert sine is not None and joint.limits.upper is not None
    assert sine.target(joint.name, 0.25) > joint.limits.upper > sine.middle[joint.name]

    def moved(past: float) -> Outcome:
        return Outcome(None, motion(joint.name, np.array([0.0, joint.limits.upper + past])))

    theirs = {"past_upper": moved(0.03 + coarse), "past_upper_fine": moved(0.03 + fine)}
    limits, wish = FloorLimits(), Swing()
    both = Compared(tree, Control(), wish, Fall(), limits, 1, lambda _: moved(0.03), asked, theirs)
    (row,) = both.rows()
    return row


@pytest.mark.parametrize(("further", "verdict"), [(0.005, "ok"), (0.02, "warning"), (0.3, "error")])
def test_a_limit_that_gives_way_further_than_mujocos_is_a_row(further: float, verdict: str):
    row = past_upper(further, further)
    assert (row.name, row.verdict) == ("past_upper", verdict)
    found = [finding.rule for finding in findings_of([row], OFF, "Newton")]
    assert found == ([] if verdict == "ok" else ["alignment.newton.past_upper"])


def test_a_limit_that_gives_way_in_long_steps_alone_names_the_integrator():
    named = past_upper(0.2, 0.001)
    assert named.verdict == "warning" and "integrators part" in named.because
    assert "`simulation.timestep`" in named.advice
    same = past_upper(0.2, 0.15)
    assert same.verdict == "error" and not same.because


def test_a_run_that_newton_refuses_or_loses_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    still = motion("j", np.zeros(3))
    lost = Outcome(None, replace(still, root=np.full((3, 3), np.nan)))

    def perform(_: NewtonAlignment, __: Path, asked: Sequence[Experiment]) -> dict[str, Outcome]:
        refused = Outcome(None, None, "it refuses the stage")
        return {each.name: refused if each.name == "load" else lost for each in asked}

    monkeypatch.setattr(NewtonAlignment, "perform", perform)
    found, _ = check(tmp_path)
    runs = {f.message.split("`")[1] for f in found if f.rule == "alignment.newton.run"}
    assert {"load", "fall", "sine", "stand"} < runs


def test_a_joint_without_limits_or_drive_runs_into_none():
    tree = pendulum().tree
    assert into_stop(tree, Control((), ()), {}, "lower") is None


def test_joints_of_a_loop_stay_where_it_is_closed_while_others_run_into_their_limits():
    bar = four_bar()
    flag = Joint("flag_joint", "revolute", bar.tree.root, "flag", limits=Limits(-0.5, 0.7))
    bodies = (*bar.tree.bodies, replace(bar.tree.bodies[-1], name="flag"))
    tree = replace(bar.tree, bodies=bodies, joints=(*bar.tree.joints, flag))
    rows = (*bar.control.actuators, Actuator("flag_joint", "pd", kp=20.0, kd=0.2))
    home = {joint.name: 0.1 for joint in bar.tree.moving_joints}
    sine = into_stop(tree, replace(bar.control, actuators=rows), home, "upper")
    assert sine is not None
    assert {name for name, width in sine.swing.items() if width} == {"flag_joint"}
    assert {sine.middle[name] for name in home} == {0.1}
    assert into_stop(bar.tree, bar.control, home, "upper") is None


Spoil = Callable[[Usd.Stage], object]


def check(
    folder: Path, spoil: Spoil = lambda stage: None
) -> tuple[list[Finding], list[dict[str, Any]]]:
    inputs = models(folder, tiny_quadruped())
    spoil_stage(inputs / "usd/robot.usda", spoil)
    short = Swing(frequency=4.0, seconds=0.75)
    step = NewtonAlignment(robot="robot", environment="newton", sine=short)
    found = run_step(step, inputs, folder / "out")
    return found, json.loads((folder / "out/figures.json").read_text())["rows"]


@needs_newton
@pytest.mark.slow  # eight experiments in two engines
def test_newton_moves_the_quadruped_as_mujoco_does(tmp_path: Path):
    found, rows = check(tmp_path)
    assert found == []
    assert {row["verdict"] for row in rows} == {"ok"}
    judged = {row["row"] for row in rows}
    assert {"self_collision", "free_fall", "sine", "sine_as_is"} < judged
    assert {"past_lower", "past_upper", "stand_height", "landing_s"} < judged
    assert max(row["off"] for row in rows if row["row"] in ("sine", "past_upper")) < 1e-4


@needs_newton
@pytest.mark.slow  # as above
def test_soft_limits_and_wrong_gains_in_the_usd_are_rows(tmp_path: Path):
    def spoil(stage: Usd.Stage) -> None:
        for prim in stage.Traverse():
            if softness := prim.GetAttribute("mjc:solreflimit"):
                softness.Set([0.2, 1.0])
            damping = prim.GetAttribute("drive:angular:physics:damping")
            if damping and prim.GetName().startswith("FL"):
                damping.Set(3.0)  # N m s/rad where N m s/deg belong

    found, _ = check(tmp_path, spoil)
    errors = {finding.rule for finding in found if finding.severity == "error"}
    assert "alignment.newton.sine" in errors
    assert "alignment.newton.past_upper" in {finding.rule for finding in found}


# --- how joints answer ---------------------------------------------------------------------------


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
