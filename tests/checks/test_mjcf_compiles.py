"""A file that MuJoCo refuses, or talks about, does not pass."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tiny import check_inputs, pendulum, run_step, tiny_quadruped

from assetbuild.checks.mjcf_compiles import MjcfCompiles
from assetbuild.findings import Finding
from assetbuild.targets.mjcf import Mjcf


@pytest.fixture
def inputs(tmp_path: Path) -> Path:
    return check_inputs(tmp_path, tiny_quadruped(), Mjcf(robot="robot"), "mjcf")


def check(inputs: Path) -> list[Finding]:
    return run_step(MjcfCompiles(), inputs, inputs.parent / "out")


def test_good_robot_compiles_without_a_word(inputs: Path) -> None:
    assert check(inputs) == []
    figures = json.loads((inputs.parent / "out/figures.json").read_text())
    assert sorted(figures) == ["robot.xml", "scene.xml"]
    robot = figures["robot.xml"]
    assert (robot["nq"], robot["nv"], robot["nu"], robot["keyframes"]) == (19, 18, 12, 2)


def test_a_scene_whose_floor_lacks_its_material_does_not_load(inputs: Path) -> None:
    scene = inputs / "mjcf/scene.xml"
    scene.write_text(scene.read_text().replace('material="ground"', 'material="other"'))
    (found,) = check(inputs)
    assert found.rule == "mjcf.load"
    assert "scene.xml" in found.message


def test_broken_xml_names_the_file(inputs: Path) -> None:
    (inputs / "mjcf/robot.xml").write_text("<mujoco><worldbody></mujoco>")
    assert {f.rule for f in check(inputs)} == {"mjcf.load"}


def test_mass_of_zero_on_a_moving_body_is_refused(tmp_path: Path) -> None:
    inputs = check_inputs(tmp_path, pendulum(), Mjcf(robot="robot"), "mjcf")
    path = inputs / "mjcf/robot.xml"
    path.write_text(path.read_text().replace('mass="1"', 'mass="0"'))
    found = check(inputs)
    assert [f.rule for f in found] == ["mjcf.load", "mjcf.load"]
    assert "mass" in found[0].message


def test_a_warning_of_the_compiler_becomes_a_finding(tmp_path: Path) -> None:
    """Two parts with two timesteps: MuJoCo takes one and warns."""
    (tmp_path / "mjcf").mkdir()
    (tmp_path / "part").mkdir()
    (tmp_path / "part/hand.xml").write_text(
        '<mujoco model="hand"><option timestep="0.01"/><worldbody><body name="b"/></worldbody>'
        "</mujoco>"
    )
    (tmp_path / "mjcf/robot.xml").write_text(
        '<mujoco model="arm"><option timestep="0.004"/>'
        '<asset><model name="hand" file="../part/hand.xml"/></asset>'
        '<worldbody><frame><attach model="hand" body="b" prefix="x"/></frame></worldbody></mujoco>'
    )
    found = run_step(MjcfCompiles(), tmp_path, tmp_path / "out")
    assert {(f.rule, f.severity) for f in found} == {("mjcf.warning", "warning")}
    assert "robot.xml" in found[0].message


def test_no_log_file_is_left_behind(
    inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    check(inputs)
    assert not list(tmp_path.glob("MUJOCO_LOG*"))
