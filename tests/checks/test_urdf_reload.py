"""yourdfpy finds our URDF right, and each way to be wrong is found."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from tiny import TinyRobot, pendulum, run_step, tiny_quadruped, with_mimic, write_robot_ports

from assetbuild.checks.urdf_reload import UrdfReload
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
    return run_step(UrdfReload(robot="bot"), inputs, tmp_path / "out")


@pytest.mark.parametrize("robot", [tiny_quadruped(), pendulum()])
def test_what_we_write_is_the_robot(robot: TinyRobot, tmp_path: Path):
    assert check(robot, tmp_path) == []
    figures = json.loads((tmp_path / "out/figures.json").read_text())
    assert figures["links"] == len(robot.links.bodies)
    assert figures["kinematics_error"] < 1e-12
    assert figures["mass_kg"] == pytest.approx(
        sum(b.inertial.mass_kg for b in robot.links.bodies if b.inertial)
    )


def test_mimic_joints_are_compared_too(tmp_path: Path):
    robot = tiny_quadruped()
    both = with_mimic(robot, "FL_hip_joint", "FR_hip_joint", -1.0, 0.1)
    links = replace(
        robot.links,
        joints=tuple(both.tree.by_joint.get(j.name, j) for j in robot.links.joints),
    )
    assert check(replace(robot, links=links), tmp_path) == []


@pytest.mark.parametrize(
    ("rule", "old", "new"),
    [
        ("unreadable", '<mass value="6.0" />', '<mass value="six" />'),
        ("structure", 'link name="imu"', 'link name="imv"'),
        ("structure", 'FR_hip_joint" type="revolute"', 'FR_hip_joint" type="continuous"'),
        ("mass", '<mass value="6.0" />', '<mass value="6.000001" />'),
        ("mass", '<origin xyz="0.0 0.005 0.0"', '<origin xyz="0.0 0.006 0.0"'),
        ("limits", 'lower="-0.86"', 'lower="-0.87"'),
        ("limits", 'effort="24.0"', 'effort="25.0"'),
        ("mesh", "meshes/trunk_box.obj", "meshes/lost.obj"),
        ("kinematics", '<axis xyz="1.0 0.0 0.0" />', '<axis xyz="-1.0 0.0 0.0" />'),
        ("kinematics", '<origin xyz="0.18 -0.05 0.0"', '<origin xyz="0.1800001 -0.05 0.0"'),
    ],
)  # fmt: skip
def test_a_wrong_file_is_found_out(rule: str, old: str, new: str, tmp_path: Path):
    findings = check(tiny_quadruped(), tmp_path, (old, new))
    assert {f.rule for f in findings} == {f"urdf.reload.{rule}"}
    assert {f.severity for f in findings} == {"error"}
    assert (tmp_path / "out/figures.json").is_file()
