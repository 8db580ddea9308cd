"""A USD in which one number of an engine's own is wrong is told apart by the real Newton."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from pxr import Usd
from tiny import TinyRobot, run_step, tiny_quadruped, with_mimic, write_robot_ports

from assetbuild.checks.smoke_newton import SmokeNewton
from assetbuild.engine.world import World
from assetbuild.robot.model import Contact
from assetbuild.simulators import newton
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.usd import Usd as UsdTarget

pytestmark = [
    pytest.mark.slow,  # each starts Newton
    pytest.mark.skipif(
        newton.HOME.python(World()) is None,
        reason="needs `assetbuild smoke RECIPE --consumer newton` once",
    ),
]
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


def told(folder: Path, spoil: Spoil | None) -> set[tuple[str, str]]:
    inputs = write_robot_ports(folder / "inputs", robot())
    for target, name in ((Mjcf(robot="robot"), "mjcf"), (UsdTarget(robot="robot"), "usd")):
        run_step(target, inputs, folder / "built")
        (folder / "built" / name).rename(inputs / name)
    if spoil is not None:
        stage = Usd.Stage.Open(str(inputs / "usd/robot.usda"))
        spoil(stage)
        stage.Save()
        del stage
    step = SmokeNewton(robot="robot", environment="newton", steps=2)
    return {(found.rule, found.subject) for found in run_step(step, inputs, folder / "out")}


def times(path: str, factor: float) -> Spoil:
    def spoil(stage: Usd.Stage) -> None:
        attribute = stage.GetAttributeAtPath(path)
        attribute.Set(attribute.Get() * factor)

    return spoil


def put(path: str, value: object) -> Spoil:
    return lambda stage: stage.GetAttributeAtPath(path).Set(value)


def test_newton_holds_the_robot(tmp_path: Path):
    assert told(tmp_path, None) == set()


@pytest.mark.parametrize(
    ("word", "subject", "spoil"),
    [
        ("armature", "joint FR_hip_joint", times(f"{HIP}.newton:armature", 180 / math.pi)),
        ("friction", "joint FR_hip_joint", times(f"{HIP}.newton:friction", 2.0)),
        (
            "kp",
            "joint FR_hip_joint",
            times(f"{HIP}.drive:angular:physics:stiffness", 180 / math.pi),
        ),
        ("effort", "joint FR_hip_joint", times(f"{HIP}.drive:angular:physics:maxForce", 0.5)),
        ("solreflimit", "joint FR_hip_joint", put(f"{HIP}.mjc:solreflimit", [0.2, 1.0])),
        ("lower", "joint FR_hip_joint", times(f"{HIP}.physics:lowerLimit", math.pi / 180)),
        ("mimic_multiplier", "joint FR_calf_joint", times(f"{CALF}.newton:mimicCoef1", -1.0)),
        ("mass", "body trunk", times("/robot/trunk.physics:mass", 1.001)),
        ("condim", "shape FR_foot_collision", put(f"{FOOT}.mjc:condim", 3)),
        ("priority", "shape FR_foot_collision", put(f"{FOOT}.mjc:priority", 0)),
        ("margin", "shape FR_foot_collision", put(f"{FOOT}.newton:contactMargin", 0.0)),
        ("solref", "shape FR_foot_collision", put(f"{FOOT}.mjc:solref", [0.1, 1.0])),
    ],
)
def test_a_wrong_number_is_found(tmp_path: Path, word: str, subject: str, spoil: Spoil):
    assert (f"equal.newton.{word}", subject) in told(tmp_path, spoil)


def test_the_law_of_an_explicit_drive_is_found(tmp_path: Path):
    path = "/robot/Actuators/FL_hip_joint.newton:kp"
    assert ("equal.newton.actuator_kp", "joint FL_hip_joint") in told(tmp_path, times(path, 2.0))
