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
    four_bar,
    models,
    pendulum,
    run_step,
    spoil_stage,
    tiny_quadruped,
)

from assetbuild.alignment.asked import SAMPLE_S, experiments_of, into_stop
from assetbuild.alignment.moved import Compared, FloorLimits
from assetbuild.alignment.row import Row, findings_of
from assetbuild.checks._newton import OFF, NewtonAlignment
from assetbuild.engine.world import World
from assetbuild.findings import Finding
from assetbuild.robot.model import Actuator, Control, Joint, Limits
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

needs_newton = pytest.mark.skipif(
    newton.HOME.python(World()) is None, reason="needs `assetbuild smoke --consumer newton` once"
)


def motion(joint: str, angle: np.ndarray) -> Motion:
    time = 0.01 * np.arange(len(angle))
    still = np.zeros((len(time), 3))
    return Motion(time, {joint: angle}, still, np.ones((len(time), 4)), still)


def past_upper(further: float) -> Row:
    """The row of a pendulum that runs so much further past its limit than in MuJoCo, rad."""
    tree = pendulum().tree
    (joint,) = tree.moving_joints
    drive = Actuator(joint.name, "pd", kp=20.0, kd=0.2)
    asked = experiments_of(tree, Control((drive,), ()), Swing())
    sine = asked["past_upper"].sine
    assert sine is not None and joint.limits.upper is not None
    assert sine.target(joint.name, 0.25) > joint.limits.upper > sine.middle[joint.name]

    def moved(past: float) -> Outcome:
        return Outcome(None, motion(joint.name, np.array([0.0, joint.limits.upper + past])))

    theirs = {"past_upper": moved(0.03 + further)}
    limits, wish = FloorLimits(), Swing()
    both = Compared(tree, Control(), wish, Fall(), limits, 1, lambda _: moved(0.03), asked, theirs)
    (row,) = both.rows()
    return row


@pytest.mark.parametrize(("further", "verdict"), [(0.005, "ok"), (0.3, "warning")])
def test_a_limit_that_gives_way_further_than_mujocos_is_a_row(further: float, verdict: str):
    row = past_upper(further)
    assert (row.name, row.verdict) == ("past_upper", verdict)
    found = [finding.rule for finding in findings_of([row], OFF, "Newton")]
    assert found == ([] if verdict == "ok" else ["alignment.newton.past_upper"])


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


SINE = Sine({"swing_joint": 0.0}, {"swing_joint": 0.3}, 1.0, 3.0)


def answer(lag_rad: float, *, touched: bool = False) -> Motion:
    """A joint that follows `SINE` late by a phase."""
    time = np.linspace(0.0, 3.0, 301)
    return replace(motion("swing_joint", 0.3 * np.sin(2.0 * np.pi * time - lag_rad)),
                   time=time, touched=touched)  # fmt: skip


@pytest.mark.parametrize(
    ("name", "rubbing", "touched", "verdict"),
    [
        ("sine", False, False, "error"),
        ("sine_as_is", True, False, "warning"),
        ("sine_as_is", True, True, "told"),
    ],
)
def test_only_what_engines_model_alike_is_an_error(
    name: str, rubbing: bool, touched: bool, verdict: str
):
    setting = Setting(0.01, (0.0, 0.0, 0.0), rubbing=rubbing)
    asked = swing(name, setting, SINE, SAMPLE_S)
    ours, theirs = answer(0.0, touched=touched), answer(1.0)
    both = Compared(
        pendulum().tree, Control(), Swing(), Fall(), FloorLimits(), 1,
        lambda _: Outcome(None, ours), {name: asked}, {name: Outcome(None, theirs)},
    )  # fmt: skip
    (row,) = both.rows()
    assert row.verdict == verdict
    assert "1.0000 rad later" in str(row.theirs)


@pytest.mark.parametrize(("off", "verdict"), [(0.01, "ok"), (0.3, "warning")])
def test_a_reason_makes_an_error_a_warning(off: float, verdict: str):
    row = Row("self_collision", "HIGH", "robot", "1", "2", off, 0.05, 0.2, because="no contacts")
    assert row.verdict == verdict
    assert row.shown("PhysX")["because"] == "no contacts"
