"""yourdfpy finds that our URDF moves as the robot does, and sees where one does not."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tiny import TinyRobot, pendulum, run_step, tiny_quadruped, write_robot_ports

from assetbuild.checks.urdf_kinematics import UrdfKinematics
from assetbuild.findings import Finding
from assetbuild.targets.urdf import Urdf


def check(robot: TinyRobot, tmp_path: Path, *edits: tuple[str, str]) -> list[Finding]:
    """Emit, change the file by `edits`, and check."""
    inputs = write_robot_ports(tmp_path / "in", robot)
    run_step(Urdf(robot="bot"), inputs, inputs)
    path = inputs / "urdf/bot.urdf"
    text = path.read_text()
    for old, new in edits:
        assert old in text
        text = text.replace(old, new, 1)
    path.write_text(text)
    return run_step(UrdfKinematics(robot="bot"), inputs, tmp_path / "out")


@pytest.mark.parametrize("robot", [tiny_quadruped(), pendulum()])
def test_what_we_write_moves_as_the_robot(robot: TinyRobot, tmp_path: Path):
    assert check(robot, tmp_path) == []
    figures = json.loads((tmp_path / "out/figures.json").read_text())
    assert figures["links"] == len(robot.links.bodies)
    assert figures["kinematics_error"] < 1e-12


@pytest.mark.parametrize(
    ("rule", "old", "new"),
    [
        ("unreadable", '<mass value="6.0" />', '<mass value="six" />'),
        ("unreadable", 'link name="imu"', 'link name="imv"'),
        ("place", '<axis xyz="1.0 0.0 0.0" />', '<axis xyz="-1.0 0.0 0.0" />'),
        ("place", '<origin xyz="0.18 -0.05 0.0"', '<origin xyz="0.1800001 -0.05 0.0"'),
    ],
)
def test_a_wrong_file_is_found_out(rule: str, old: str, new: str, tmp_path: Path):
    findings = check(tiny_quadruped(), tmp_path, (old, new))
    assert {f.rule for f in findings} == {f"urdf.kinematics.{rule}"}
    assert {f.severity for f in findings} == {"error"}
    assert (tmp_path / "out/figures.json").is_file()
