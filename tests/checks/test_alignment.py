"""Two engines that simulate the same robot agree; each difference is a row of its own."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checks.engines import needs_newton, needs_physx
from pxr import Usd, UsdPhysics
from robot_files import checked, mjcf_inputs, models, run_step, spoil_stage, write_robot_ports
from tiny import TinyRobot, bolted, box_inertial, four_bar, pendulum, tiny_quadruped

from assetbuild.alignment.check import SAMPLE_S, Compared, experiments_of, into_stop, stand_rows
from assetbuild.alignment.row import Row, findings_of
from assetbuild.checks._newton import OFF as NEWTON_OFF
from assetbuild.checks._newton import NewtonAlignment, touching_row
from assetbuild.checks._physx import OFF, Alignment
from assetbuild.findings import Finding
from assetbuild.report.summary import WITHHELD, public_message
from assetbuild.robot.model import Actuator, Body, Control, Joint, Limits, Simulation
from assetbuild.simulators import mujoco
from assetbuild.simulators.experiments import (
    Experiment,
    Motion,
    Outcome,
    Setting,
    Sine,
    Swing,
    load,
    swing,
)
from assetbuild.simulators.mujoco.motion import perform

Spoil = Callable[[Usd.Stage], object]
LOST = Outcome(None, None, "it lost its numbers (NaN) after 0.1 s")


def check(
    robot: TinyRobot, folder: Path, spoil: Spoil = lambda stage: None
) -> tuple[list[Finding], dict[str, Any]]:
    inputs = models(folder, robot)
    spoil_stage(inputs / "usd/robot.usda", spoil)
    short = Swing(frequency=4.0, seconds=0.75, tolerance=0.02)
    return checked(Alignment(robot="robot", sine=short), inputs, folder / "out")


@needs_physx
def test_quadruped_is_the_same_in_both(tmp_path: Path) -> None:
    findings, figures = check(tiny_quadruped(), tmp_path)
    assert findings == []
    rows = figures["rows"]
    assert {row["verdict"] for row in rows} == {"ok"}
    ranks = [row["rank"] for row in rows]
    assert ranks == sorted(ranks, key=("HIGH", "MEDIUM").index)
    landing = next(row for row in rows if row["row"] == "landing_s")
    assert landing["physx"] == pytest.approx(math.sqrt(2 / 9.81), rel=0.01)


@needs_physx
@pytest.mark.slow  # seven experiments in two engines
def test_gains_in_the_wrong_unit_are_a_row(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        for prim in stage.Traverse():
            if prim.IsA(UsdPhysics.RevoluteJoint):
                drive = UsdPhysics.DriveAPI(prim, "angular")
                drive.GetDampingAttr().Set(3.0)  # N m s/rad where N m s/deg belong

    found = {f.rule: f for f in check(tiny_quadruped(), tmp_path, spoil)[0]}
    row = found["alignment.physx.sine"]
    assert (row.severity, row.data["rank"]) == ("error", "HIGH")
    assert public_message(row) == WITHHELD


def test_mjcf_that_does_not_load_is_skipped(tmp_path: Path) -> None:
    inputs = write_robot_ports(tmp_path / "inputs", tiny_quadruped())
    (inputs / "mjcf").mkdir()
    (inputs / "mjcf/robot.xml").write_text("<mujoco>")
    found, figures = checked(Alignment(robot="robot"), inputs, tmp_path / "out")
    assert found == [], "`mjcf.load` reports it"
    assert "not_loaded" in figures


def standing(height: float, tilt: float) -> Motion:
    """A root that ends at a height (m), tilted about y (rad)."""
    root, turn = np.zeros((2, 3)), np.zeros((2, 4))
    root[:, 2] = height
    turn[:, 0], turn[:, 2] = math.cos(tilt / 2), math.sin(tilt / 2)
    return Motion(np.array([0.0, 2.0]), {}, root, turn, root)


def test_heights_are_compared_only_of_what_stands() -> None:
    robot = tiny_quadruped()
    both = Compared(Alignment(robot="robot"), robot.tree, robot.control, lambda _: LOST, {}, {})
    asked = load(robot.control)

    def verdict(ours: Motion, theirs: Motion) -> str:
        (row,) = stand_rows(both, asked, ours, theirs)
        return row.verdict

    fallen = standing(0.1, 1.5)
    assert verdict(standing(0.3, 0.1), fallen) == "error"
    assert verdict(standing(0.3, 0.1), standing(0.301, 0.1)) == "ok"
    assert verdict(standing(0.2, 0.6), fallen) == "told"


ROW = Row("kp", "HIGH", "joint a", 1.0, 1.0, 0.0, 0.1, 0.2, "of kp")


def test_rows_are_judged_by_two_limits_and_a_reason_makes_an_error_a_warning() -> None:
    rows = [replace(ROW, off=off) for off in (0.0, 0.15, 0.3, math.nan)]
    known = [replace(row, because="soft") for row in rows]
    assert [row.verdict for row in rows] == ["ok", "warning", "error", "error"]
    assert [row.verdict for row in known] == ["ok", "warning", "warning", "warning"]
    assert known[0].shown("PhysX")["because"] == "soft"


def test_a_kind_of_row_is_one_finding_about_its_worst() -> None:
    """A row without a reason weighs more than a larger one with a reason."""
    worse, known = replace(ROW, subject="joint b", off=0.3), replace(ROW, off=0.4, because="soft")
    (found,) = findings_of([known, ROW, worse, replace(ROW, off=0.15)], OFF, "PhysX")
    assert (found.rule, found.severity) == ("alignment.physx.kp", "error")
    assert (found.subject, found.data["rows"]) == ("joint b", 3)


def excluding(robot: TinyRobot, folder: Path, pairs: tuple[tuple[str, str], ...]) -> mujoco.Model:
    """The model of its MJCF with these pairs excluded instead of its own."""
    robot = replace(robot, control=replace(robot.control, excludes=pairs))
    inputs = mjcf_inputs(folder, robot)
    return mujoco.load(inputs / "mjcf/robot.xml").model


@pytest.mark.parametrize(
    ("here", "there", "verdict", "alone"),
    [
        ((), (), "ok", ""),
        ((("FL_foot", "FR_foot"),), (), "error", "theirs"),
        ((), (("FL_foot", "FR_foot"),), "error", "mujoco"),
        ((), (("trunk", "FL_hip"),), "warning", "mujoco"),
    ],
    ids=["alike", "Newton forgets a pair", "filters one too many", "has none in a joint"],
)
def test_a_touch_that_one_engine_alone_has_is_an_error_but_in_a_joint(
    tmp_path: Path,
    here: tuple[tuple[str, str], ...],
    there: tuple[tuple[str, str], ...],
    verdict: str,
    alone: str,
) -> None:
    """MuJoCo has contacts of a joint where a body's parent is bolted to the world."""
    robot = bolted(replace(tiny_quadruped(), tree=tiny_quadruped().links))
    one, other = excluding(robot, tmp_path / "a", here), excluding(robot, tmp_path / "b", there)
    row = touching_row(one, other, robot.tree)
    assert row.verdict == verdict
    assert alone == "".join(
        side for side in ("mujoco", "theirs") if "alone" in str(getattr(row, side))
    )


# --- In Newton, and how joints answer ---


def motion(joint: str, angle: np.ndarray, sample_s: float = 0.01) -> Motion:
    time = sample_s * np.arange(len(angle))
    still = np.zeros((len(time), 3))
    return Motion(time, {joint: angle}, still, np.ones((len(time), 4)), still)


UPPER = 2.0
"""The pendulum's upper limit, rad."""


def past_upper(coarse: float, fine: float) -> Row:
    """The row of a pendulum that runs so much further past its limit than in MuJoCo, rad.

    fine: in shorter steps.
    """
    tree = pendulum().tree
    drive = Actuator("swing_joint", "pd", kp=20.0, kd=0.2)
    asked = experiments_of(tree, Control((drive,), ()), Swing())
    sine = asked["past_upper"].sine
    positions, _ = sine.commands(1, 0.25)
    assert positions["swing_joint"][0] > UPPER > sine.middle["swing_joint"]

    def moved(past: float) -> Outcome:
        return Outcome(None, motion("swing_joint", np.array([0.0, UPPER + past])))

    theirs = {"past_upper": moved(0.03 + coarse), "past_upper_fine": moved(0.03 + fine)}
    limits = Alignment(robot="robot")
    (row,) = Compared(limits, tree, Control(), lambda _: moved(0.03), asked, theirs).rows()
    return row


@pytest.mark.parametrize(("further", "verdict"), [(0.005, "ok"), (0.02, "warning"), (0.3, "error")])
def test_a_limit_that_gives_way_further_than_mujocos_is_a_row(further: float, verdict: str):
    row = past_upper(further, further)
    assert (row.name, row.verdict) == ("past_upper", verdict)
    found = [finding.rule for finding in findings_of([row], NEWTON_OFF, "Newton")]
    assert found == ([] if verdict == "ok" else ["alignment.newton.past_upper"])


def test_a_limit_that_gives_way_in_long_steps_alone_names_the_integrator():
    named = past_upper(0.2, 0.001)
    assert named.verdict == "warning" and "integrators part" in named.because
    assert "`simulation.timestep`" in named.advice
    same = past_upper(0.2, 0.15)
    assert same.verdict == "error" and not same.because


@pytest.mark.parametrize(
    ("step", "rule"),
    [
        (NewtonAlignment(robot="robot", environment="newton"), "alignment.newton.run"),
        (Alignment(robot="robot"), "alignment.physx.run"),
    ],
    ids=["newton", "physx"],
)
def test_a_run_that_an_engine_refuses_or_loses_is_an_error(
    step: NewtonAlignment | Alignment, rule: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    lost = replace(motion("j", np.zeros(3)), root=np.full((3, 3), np.nan))
    refused = Outcome(None, None, "it refuses the stage")

    def perform(_: object, __: Path, asked: Sequence[Experiment]) -> dict[str, Outcome]:
        return {e.name: refused if e.name == "load" else Outcome(None, lost) for e in asked}

    monkeypatch.setattr(type(step), "perform", perform)
    found = run_step(step, models(tmp_path, tiny_quadruped()), tmp_path / "out")
    runs = {f.message.split("`")[1]: f for f in found if f.rule == rule}
    assert {"load", "fall", "sine", "stand"} < runs.keys()
    assert runs["load"].message == "no comparison of `load`: it refuses the stage"
    assert (public_message(runs["load"]) == WITHHELD) == (rule == "alignment.physx.run")


def test_joints_of_a_loop_stay_where_it_is_closed_while_others_run_into_their_limits():
    bar = four_bar()
    flag = Joint("flag_joint", "revolute", bar.tree.root, "flag", limits=Limits(-0.5, 0.7))
    bodies = (*bar.tree.bodies, replace(bar.tree.bodies[-1], name="flag"))
    tree = replace(bar.tree, bodies=bodies, joints=(*bar.tree.joints, flag))
    rows = (*bar.control.actuators, Actuator("flag_joint", "pd", kp=20.0, kd=0.2))
    home = {joint.name: 0.1 for joint in bar.tree.moving_joints}
    sine = into_stop(tree, replace(bar.control, actuators=rows), home, "upper")
    assert {name for name, width in sine.swing.items() if width} == {"flag_joint"}
    assert {sine.middle[name] for name in home} == {0.1}
    undriven = into_stop(pendulum().tree, Control((), ()), {}, "lower")
    for still in (into_stop(bar.tree, bar.control, home, "upper"), undriven):
        assert not any(still.swing.values())


@needs_newton
@pytest.mark.slow  # eight experiments in two engines
def test_newton_moves_the_quadruped_as_mujoco_does(tmp_path: Path):
    short = Swing(frequency=4.0, seconds=0.75)
    step = NewtonAlignment(robot="robot", environment="newton", sine=short)
    found, figures = checked(step, models(tmp_path, tiny_quadruped()), tmp_path / "out")
    rows = figures["rows"]
    assert found == []
    assert {row["verdict"] for row in rows} == {"ok"}
    judged = {row["row"] for row in rows}
    assert {"self_collision", "free_fall", "sine", "sine_as_is"} < judged
    assert {"past_lower", "past_upper", "stand_height", "landing_s"} < judged
    assert max(row["off"] for row in rows if row["row"] in ("sine", "past_upper")) < 1e-4


WRIST = Actuator("swing_joint", "pd", kp=20.0, kd=0.2, friction=1.0, effort=30.0)
SINE = Sine({"swing_joint": 0.0}, {"swing_joint": 0.3}, 1.0, 3.0)

STEP = 0.005


def row_beside(angle: np.ndarray, folder: Path, drive: Actuator = WRIST) -> Row:
    """The row of a wrist of 1e-3 kg m2 beside another engine's motion, sampled at 1 ms."""
    robot = pendulum()
    wrist = Body("arm", box_inertial(0.2, (0.02, 0.02, 0.2), (0.0, 0.0, 0.0)))
    tree = replace(robot.tree, bodies=(robot.tree.bodies[0], wrist))
    weightless = Simulation(timestep=STEP, gravity=(0.0, 0.0, 0.0))
    control = Control((drive,), (), simulation=weightless)
    inputs = mjcf_inputs(folder, replace(robot, tree=tree, links=tree, control=control))
    asked = swing("sine_as_is", Setting(STEP, weightless.gravity), SINE, SAMPLE_S)
    theirs = {asked.name: Outcome(None, motion("swing_joint", angle, 1e-3))}
    limits, ours = Alignment(robot="robot"), partial(perform, inputs / "mjcf", "robot")
    (row,) = Compared(limits, tree, control, ours, {asked.name: asked}, theirs).rows()
    return row


def by_coulomb() -> np.ndarray:
    """Without inertia: kd dq/dt = kp (target - q) less the friction, and none below it."""
    dt, angle, out = 1e-4, 0.0, []
    target = [SINE.middle["swing_joint"], *SINE.commands(30000, dt)[0]["swing_joint"]]
    for step in range(30001):
        if step % 10 == 0:
            out.append(angle)
        torque = WRIST.kp * (target[step] - angle)
        angle += dt * np.sign(torque) * max(abs(torque) - WRIST.friction, 0.0) / WRIST.kd
    return np.array(out)


STICKS, SLOW = np.zeros(3001), replace(WRIST, friction=0.0, velocity=0.5)
FRICTIONLESS, QUICK = replace(WRIST, friction=0.0), replace(SLOW, velocity=5.0)


@pytest.mark.parametrize(
    ("angle", "drive", "verdict", "because"),
    [
        (by_coulomb(), WRIST, "warning", "soft"),
        (STICKS, WRIST, "error", ""),
        (by_coulomb(), FRICTIONLESS, "warning", ""),
        # 0.3 rad at 1 Hz is 1.9 rad/s; an engine that keeps to 0.5 rad/s lags behind.
        (STICKS, SLOW, "warning", "MuJoCo has no limit of speed: `swing_joint` moves at"),
        (STICKS, QUICK, "error", ""),
    ],
    ids=["friction that holds", "sticks", "no friction", "limited speed", "quick enough"],
)
def test_a_row_is_excused_by_what_only_one_engine_does(
    angle: np.ndarray, drive: Actuator, verdict: str, because: str, tmp_path: Path
):
    row = row_beside(angle, tmp_path, drive)
    assert row.off is not None and row.off > 0.05
    assert (row.verdict, bool(row.because)) == (verdict, bool(because))
    assert because in row.because
    (finding,) = findings_of([row], NEWTON_OFF, "PhysX")
    assert finding.severity == verdict and because in finding.message
    assert (drive is SLOW) == ("validate.sine.frequency" in finding.hint)
