"""A table on four legs stays where it is on an elliptic cone, and slides on a pyramidal one."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from tiny import TinyRobot, check_inputs, run_step, tiny_quadruped

from assetbuild.checks.slope import Slope
from assetbuild.findings import Finding
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
