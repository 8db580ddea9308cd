"""A table on four legs stays where it is on an elliptic cone, and slides on a pyramidal one."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import pytest
from pxr import Usd, UsdPhysics
from tiny import TinyRobot, check_inputs, models, run_step, spoil_stage, tiny_quadruped

from assetbuild.checks.newton_slope import NewtonSlope
from assetbuild.checks.physx_slope import PhysxSlope
from assetbuild.checks.slope import Slope
from assetbuild.engine.world import World
from assetbuild.findings import Finding
from assetbuild.simulators.newton import HOME
from assetbuild.targets.mjcf import Mjcf, MjcfOptions


def judged(
    folder: Path, options: MjcfOptions, robot: TinyRobot | None = None
) -> tuple[list[Finding], dict[str, dict]]:
    inputs = check_inputs(
        folder, robot or tiny_quadruped(), Mjcf(robot="robot", options=options), "mjcf"
    )
    findings = run_step(Slope(robot="robot"), inputs, folder / "out")
    return findings, json.loads((folder / "out/figures.json").read_text())


def test_feet_stay_on_a_slope_that_friction_holds(tmp_path: Path) -> None:
    findings, figures = judged(tmp_path, MjcfOptions())
    assert findings == []
    row = figures["mjcf"]
    assert row["speed_m_s"] < 1e-3
    assert row["angle_rad"] == pytest.approx(0.8 * math.atan(row["friction"]), rel=1e-3)


def test_a_pyramidal_cone_without_impratio_lets_them_slide(tmp_path: Path) -> None:
    (found,), figures = judged(tmp_path, MjcfOptions(cone="pyramidal"))
    assert found.rule == "slope.creep"
    assert figures["mjcf"]["speed_m_s"] > 1e-3


def test_feet_without_friction_are_not_judged(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    contact = robot.control.contact.model_copy(update={"condim": 1, "priority": 1})
    robot = replace(robot, control=replace(robot.control, contact=contact, contacts=()))
    findings, figures = judged(tmp_path, MjcfOptions(), robot)
    assert findings == []
    assert figures["mjcf"]["skipped"] == "its feet have no friction"


def test_drives_that_give_way_get_a_flatter_slope(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    soft = tuple(replace(row, kp=25.0, kd=1.0) for row in robot.control.actuators)
    robot = replace(robot, control=replace(robot.control, actuators=soft))
    findings, figures = judged(tmp_path, MjcfOptions(), robot)
    assert findings == []
    row = figures["mjcf"]
    assert row["angle_rad"] == pytest.approx(0.8 * math.atan(row["friction"]), rel=1e-3)
    _, firm = judged(tmp_path / "firm", MjcfOptions())
    assert row["angle_rad"] <= firm["mjcf"]["angle_rad"] / 2.0


def slippery(stage: Usd.Stage) -> None:
    """Feet whose friction is lost, and that no longer win over the floor's."""
    for prim in stage.Traverse():
        if prim.HasAPI(UsdPhysics.MaterialAPI):
            prim.GetAttribute("physics:staticFriction").Set(0.05)
            prim.GetAttribute("physics:dynamicFriction").Set(0.05)
            prim.GetAttribute("physxMaterial:frictionCombineMode").Set("average")


@pytest.mark.skipif(find_spec("ovphysx") is None, reason="needs the extra `physx`")
def test_feet_that_lost_their_friction_slide_in_physx(tmp_path: Path) -> None:
    inputs = models(tmp_path, tiny_quadruped())
    assert run_step(PhysxSlope(robot="robot"), inputs, tmp_path / "good") == []
    spoil_stage(inputs / "usd/robot.usda", slippery)
    (found,) = run_step(PhysxSlope(robot="robot"), inputs, tmp_path / "bad")
    assert found.rule == "physx.slope"


@pytest.mark.slow
@pytest.mark.skipif(
    HOME.python(World()) is None, reason="needs `assetbuild smoke RECIPE --consumer newton` once"
)
def test_a_pyramidal_cone_slides_in_newton_too(tmp_path: Path) -> None:
    check, inputs = NewtonSlope(robot="robot", environment=""), models(tmp_path, tiny_quadruped())
    assert run_step(check, inputs, tmp_path / "good") == []
    cone = Mjcf(robot="robot", options=MjcfOptions(cone="pyramidal"))
    run_step(cone, inputs, tmp_path / "pyramidal")
    shutil.copytree(tmp_path / "pyramidal/mjcf", inputs / "mjcf", dirs_exist_ok=True)
    (found,) = run_step(check, inputs, tmp_path / "bad")
    assert found.rule == "newton.slope"
