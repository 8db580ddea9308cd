"""What Newton holds of a robot is compared with the robot; a wrong number is told by its name.

MuJoCo's own model stands in for that of Newton's solver, whose form it has; the slow ones ask the
real Newton, once for all stages that were spoilt.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from pxr import Usd
from tiny import TinyRobot, models, spoil_stage, tiny_quadruped, with_mimic

from assetbuild.checks.smoke_newton import SmokeNewton, judged, run_of
from assetbuild.engine.world import World
from assetbuild.findings import Finding
from assetbuild.robot.model import Contact
from assetbuild.simulators import newton
from assetbuild.simulators.experiments import Outcome
from assetbuild.simulators.newton._reading import readings
from assetbuild.simulators.stages import answers

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
    own = (("FR_foot_collision", grip),)
    return replace(found, control=replace(found.control, actuators=rows, contacts=own))


def told(kind: str, done: Outcome) -> list[Finding]:
    return list(judged(kind, done, robot()))  # type: ignore[arg-type] # as `RobotFiles`


# --- without Newton ---------------------------------------------------------------------------


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


def test_a_model_that_is_the_robot_s_is_no_finding(reading: dict[str, Any]):
    assert told("mjcf", Outcome(reading, None)) == []


@pytest.mark.parametrize(
    ("array", "place", "value", "rule", "subject"),
    [
        ("body_mass", 1, 7.0, "mass", "body trunk"),
        ("body_ipos", (2, 0), 0.1, "centre_of_mass", "body FR_hip"),
        ("dof_armature", 6, 0.3, "armature", "joint FR_hip_joint"),
        ("jnt_axis", 1, [0.0, 1.0, 0.0], "axis", "joint FR_hip_joint"),
        ("jnt_range", (1, 0), -0.5, "lower", "joint FR_hip_joint"),
        ("eq_data", (0, 1), 2.0, "mimic_multiplier", "joint FR_calf_joint"),
    ],
)
def test_another_number_in_the_model_is_an_error(
    reading: dict[str, Any], array: str, place: Any, value: object, rule: str, subject: str
):
    rows = np.array(reading[array])
    rows[place] = value
    found = told("mjcf", Outcome(reading | {array: rows.tolist()}, None))
    assert [(f.rule, f.subject) for f in found] == [(f"equal.newton.{rule}", subject)]


def test_what_newton_refuses_or_adds_names_the_key_that_helps(reading: dict[str, Any]):
    for said, hint in (("by base 10: 'pgs'", "`mjcf: {solver: Newton}`"), ("A + B >= C", "single")):
        (found,) = told("mjcf", Outcome(None, None, f"ValueError: {said}"))
        assert (found.rule, hint in found.hint) == ("smoke.failed", True)
    heavy = np.array(reading["body_inertia"])
    heavy[2] += 1e-6
    (found,) = told("mjcf", Outcome(reading | {"body_inertia": heavy.tolist()}, None))
    assert found.rule == "equal.newton.inertia" and "`moments: 2e-10`" in found.hint
    (found,) = told("mjcf", Outcome(reading, None, "it lost its numbers (NaN)"))
    assert found.rule == "smoke.finite"


# --- the real one -----------------------------------------------------------------------------


def times(path: str, factor: float) -> Spoil:
    def spoil(stage: Usd.Stage) -> None:
        attribute = stage.GetAttributeAtPath(path)
        attribute.Set(attribute.Get() * factor)

    return spoil


def put(path: str, value: object) -> Spoil:
    return lambda stage: stage.GetAttributeAtPath(path).Set(value)


STIFFNESS, EFFORT = (f"{HIP}.drive:angular:physics:{word}" for word in ("stiffness", "maxForce"))
LAW = "/robot/Actuators/FL_hip_joint.newton:kp"
SPOILT: dict[tuple[str, str], Spoil] = {
    ("armature", "joint FR_hip_joint"): times(f"{HIP}.newton:armature", 180 / math.pi),
    ("friction", "joint FR_hip_joint"): times(f"{HIP}.newton:friction", 2.0),
    ("kp", "joint FR_hip_joint"): times(STIFFNESS, 180 / math.pi),
    ("effort", "joint FR_hip_joint"): times(EFFORT, 0.5),
    ("solreflimit", "joint FR_hip_joint"): put(f"{HIP}.mjc:solreflimit", [0.2, 1.0]),
    ("lower", "joint FR_hip_joint"): times(f"{HIP}.physics:lowerLimit", math.pi / 180),
    ("mimic_multiplier", "joint FR_calf_joint"): times(f"{CALF}.newton:mimicCoef1", -1.0),
    ("mass", "body trunk"): times("/robot/trunk.physics:mass", 1.001),
    ("condim", "shape FR_foot_collision"): put(f"{FOOT}.mjc:condim", 3),
    ("priority", "shape FR_foot_collision"): put(f"{FOOT}.mjc:priority", 0),
    ("margin", "shape FR_foot_collision"): put(f"{FOOT}.newton:contactMargin", 0.0),
    ("solref", "shape FR_foot_collision"): put(f"{FOOT}.mjc:solref", [0.1, 1.0]),
    ("actuator_kp", "joint FL_hip_joint"): times(LAW, 2.0),
}


@pytest.mark.slow  # starts Newton
@pytest.mark.skipif(
    newton.HOME.python(World()) is None,
    reason="needs `assetbuild smoke RECIPE --consumer newton` once",
)
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
    done = answers(check.start, tmp_path, runs)
    assert told("mjcf", done["mjcf"]) == told("usd", done["usd"]) == []
    for word, subject in SPOILT:
        found = {(f.rule, f.subject) for f in told("usd", done[word])}
        assert (f"equal.newton.{word}", subject) in found
