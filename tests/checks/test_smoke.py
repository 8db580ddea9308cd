"""What a trainer answered is judged; the child itself runs where its environment is named."""

from __future__ import annotations

import math
import os
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from checks.engines import needs_newton
from newton_child import readings
from pxr import Usd
from robot_files import about, configured, laid_out, models, run_step, spoil_stage
from tiny import TinyRobot, tiny_quadruped, with_control, with_mimic

from assetbuild.checks._newton import SmokeNewton, run_of
from assetbuild.checks._newton import evaluate as judged_newton
from assetbuild.checks.smoke_mjlab import SmokeMjlab, _rounded_figures, evaluate
from assetbuild.cli import main
from assetbuild.cli.smoke import environments_to_make
from assetbuild.engine.world import World
from assetbuild.findings import Finding
from assetbuild.robot.model import Contact
from assetbuild.robot.ranges import Randomize
from assetbuild.simulators.children import ask
from assetbuild.simulators.consumers import MADE, Environment, SmokeBounds
from assetbuild.simulators.experiments import Outcome
from assetbuild.simulators.stages import answers
from assetbuild.targets.mjlab import Mjlab

BOUNDS = SmokeBounds.model_validate({})
GOOD: dict[str, Any] = {
    "envs": 8,
    "fell": 0,
    "finite": True,
    "walks": True,
    "gpu": False,
    "iterations": 2,
    "weights_finite": True,
    "weights_moved": 0.01,
    "height_m": 0.28,
    "start_m": 0.3,
    "effort_share": 1.0,
    "inconsistent": 0,
    "drawn": 104,
    "mass_ratio": [0.9, 1.1],
}
BAD = {
    "smoke.finite": {"finite": False},
    "smoke.fell": {"fell": 3},
    "smoke.height": {"height_m": 0.2},
    "smoke.effort": {"effort_share": 1.1},
    "smoke.weights": {"weights_moved": 0.0},
    "smoke.inertia": {"inconsistent": 1},
}


def test_a_good_answer_says_nothing_and_the_verdict_quotes_it() -> None:
    assert list(evaluate(GOOD, BOUNDS)) == []
    assert list(evaluate({**GOOD, "effort_share": 1.09}, BOUNDS, effort_factor=1.1)) == []
    assert _rounded_figures(GOOD)["summary"] == (
        "0 of 8 robots fell under zero actions, the root went from 0.300 m to 0.280 m; "
        "then trained for 2 iterations on a CPU"
    )


@pytest.mark.parametrize("rule", BAD)
def test_each_fault_has_its_rule(rule: str) -> None:
    assert [finding.rule for finding in evaluate(GOOD | BAD[rule], BOUNDS)] == [rule]


def test_nobody_is_asked_whom_the_recipe_does_not_name() -> None:
    assert configured(SmokeMjlab) is None
    ranges = {"joints": {".*": {"effort": [0.9, 1.2]}}}
    step = configured(SmokeMjlab, validate={"smoke": ["mjlab"]}, randomize=ranges)
    assert isinstance(step, SmokeMjlab) and step.effort_factor == 1.2


def test_an_environment_is_named_by_its_pins_and_counts_when_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path))
    one, other = Environment("t", ("a==1",)), Environment("t", ("a==2",))
    assert one.folder != other.folder
    assert one.folder.is_relative_to(tmp_path)
    (one.folder / "bin").mkdir(parents=True)
    (one.folder / "bin/python").touch()
    assert one.python(World()) is None, "half made"
    (one.folder / MADE).touch()
    assert one.python(World()) is not None
    (line,) = environments_to_make(["mjlab"])
    assert "3.4 GB to download" in line and str(tmp_path) in line


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("import sys; sys.exit('no such joint')", "no such joint"),
        ("import os; os.kill(os.getpid(), 9)", "crashed with signal 9"),
        ("import time; time.sleep(60)", "took more than 1 s"),
    ],
)
def test_a_consumer_that_fails_says_why(tmp_path: Path, text: str, why: str) -> None:
    program = tmp_path / "child.py"
    program.write_text(text)
    seconds = 1.0 if "sleep" in text else 30.0
    answer, failure = ask(Path(sys.executable), program, {}, tmp_path, seconds)
    assert answer is None
    assert why in failure


def test_mjlab_takes_the_tiny_robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Minutes: torch, warp and mjlab are imported, kernels are compiled once."""
    python = os.environ.get("ASSETBUILD_MJLAB_PYTHON")
    if not python:
        pytest.skip("no mjlab here: set ASSETBUILD_MJLAB_PYTHON to the Python of its environment")
    monkeypatch.setattr(Environment, "python", lambda self, world: Path(python))
    ranges = {
        "links": {".*": {"density": [0.8, 1.2], "com": 0.01}},
        "joints": {".*": {"kp": [0.9, 1.1], "friction": [0.5, 2], "delay": [0, 2]}},
        "friction": [0.4, 1.2],
    }
    drawn = Randomize.model_validate(ranges)
    target = Mjlab(robot="tiny", feet=".*_foot", imu="imu", randomize=drawn)
    inputs = laid_out(tmp_path / "in", tiny_quadruped(), (target, "mjlab"))
    check = SmokeMjlab(robot="tiny", environment="test", envs=4, stand_steps=10, rollout=4)

    assert [f for f in run_step(check, inputs, tmp_path / "out") if f.severity == "error"] == []


def test_a_mistyped_recipe_is_found_before_anything_is_downloaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def download(self: Environment, say: object) -> None:
        raise AssertionError("pip was called")

    monkeypatch.setattr(Environment, "make", download)
    assert main(["smoke", str(tmp_path / "none.yaml"), "--consumer", "mjlab"]) == 2
    assert "there is no such file" in capsys.readouterr().err


# --- Newton --------------------------------------------------------------------------------------


HIP, CALF = "/robot/Joints/FR_hip_joint", "/robot/Joints/FR_calf_joint"
FOOT = "/robot/FR_calf/collisions/FR_foot_collision"
Spoil = Callable[[Usd.Stage], object]


def robot() -> TinyRobot:
    """One foot grips otherwise; a calf follows a thigh, another drive acts outside."""
    found = with_mimic(tiny_quadruped(), "FR_calf_joint", "FR_thigh_joint", -2.0, 0.1)
    rows = tuple(
        replace(row, model="ideal_pd") if row.joint == "FL_hip_joint" else row
        for row in found.control.actuators
    )
    grip = Contact(friction=(1.2, 0.02, 0.01), condim=6, priority=1, margin=0.002)
    return with_control(found, actuators=rows, contacts=(("FR_foot_collision", grip),))


def told(kind: str, done: Outcome) -> list[Finding]:
    return list(judged_newton(kind, done, robot()))  # type: ignore[arg-type] # as `RobotFiles`


@pytest.fixture(scope="module")
def reading(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    inputs = models(tmp_path_factory.mktemp("robot"), robot())
    held = mujoco.MjModel.from_xml_path(str(inputs / "mjcf/robot.xml"))
    empty = SimpleNamespace(numpy=lambda: np.zeros(0))
    model = SimpleNamespace(
        body_label=[], joint_label=[], shape_margin=empty, shape_gap=empty, joint_qd_start=empty,
        actuators=[],
    )  # fmt: skip
    return readings(model, held, {"bodies": {}, "joints": {}})


@pytest.mark.parametrize(
    ("array", "place", "value", "rule", "subject"),
    [
        ("body_mass", 1, 7.0, "mass", "body trunk"),
        ("dof_armature", 6, 0.3, "armature", "joint FR_hip_joint"),
        ("jnt_range", (1, 0), -0.5, "lower", "joint FR_hip_joint"),
        ("eq_data", (0, 1), 2.0, "mimic_multiplier", "joint FR_calf_joint"),
    ],
)
def test_another_number_in_the_model_is_an_error(
    reading: dict[str, Any], array: str, place: Any, value: object, rule: str, subject: str
):
    assert told("mjcf", Outcome(reading, None)) == []
    rows = np.array(reading[array])
    rows[place] = value
    found = told("mjcf", Outcome(reading | {array: rows.tolist()}, None))
    assert about(found) == {(f"equal.newton.{rule}", subject)}


def test_what_newton_refuses_or_adds_names_the_key_that_helps(reading: dict[str, Any]):
    (found,) = told("mjcf", Outcome(None, None, "ValueError: by base 10: 'pgs'"))
    assert found.rule == "smoke.failed" and "`mjcf: {solver: Newton}`" in found.hint
    heavy = np.array(reading["body_inertia"])
    heavy[2] += 1e-6
    (found,) = told("mjcf", Outcome(reading | {"body_inertia": heavy.tolist()}, None))
    assert found.rule == "equal.newton.inertia" and "`moments: 2e-10`" in found.hint
    (found,) = told("mjcf", Outcome(reading, None, "it lost its numbers (NaN)"))
    assert found.rule == "smoke.finite"


def times(path: str, factor: float) -> Spoil:
    def spoil(stage: Usd.Stage) -> None:
        attribute = stage.GetAttributeAtPath(path)
        attribute.Set(attribute.Get() * factor)

    return spoil


def put(path: str, value: object) -> Spoil:
    return lambda stage: stage.GetAttributeAtPath(path).Set(value)


STIFFNESS = f"{HIP}.drive:angular:physics:stiffness"
LAW = "/robot/Actuators/FL_hip_joint.newton:kp"
SPOILT: dict[tuple[str, str], Spoil] = {
    ("armature", "joint FR_hip_joint"): times(f"{HIP}.newton:armature", 180 / math.pi),
    ("kp", "joint FR_hip_joint"): times(STIFFNESS, 180 / math.pi),
    ("solreflimit", "joint FR_hip_joint"): put(f"{HIP}.mjc:solreflimit", [0.2, 1.0]),
    ("lower", "joint FR_hip_joint"): times(f"{HIP}.physics:lowerLimit", math.pi / 180),
    ("mimic_multiplier", "joint FR_calf_joint"): times(f"{CALF}.newton:mimicCoef1", -1.0),
    ("mass", "body trunk"): times("/robot/trunk.physics:mass", 1.001),
    ("condim", "shape FR_foot_collision"): put(f"{FOOT}.mjc:condim", 3),
    ("margin", "shape FR_foot_collision"): put(f"{FOOT}.newton:contactMargin", 0.0),
    ("actuator_kp", "joint FL_hip_joint"): times(LAW, 2.0),
}


@pytest.mark.slow  # starts Newton
@needs_newton
def test_newton_holds_the_robot_and_each_wrong_number_is_found(tmp_path: Path):
    one = robot()
    inputs = models(tmp_path, one)
    stages = {"mjcf": inputs / "mjcf/robot.xml", "usd": inputs / "usd/robot.usda"}
    for (word, _), spoil in SPOILT.items():
        copy = Path(shutil.copytree(inputs / "usd", tmp_path / word))
        spoil_stage(copy / "robot.usda", spoil)
        stages[word] = copy / "robot.usda"
    runs = [run_of(name, path, one, steps=2) for name, path in stages.items()]  # type: ignore[arg-type] # as `RobotFiles`
    check = SmokeNewton(robot="robot", environment="newton")
    done = answers(check.start, tmp_path, runs, 600.0)
    assert told("mjcf", done["mjcf"]) == told("usd", done["usd"]) == []
    for word, subject in SPOILT:
        assert (f"equal.newton.{word}", subject) in about(told("usd", done[word]))
