"""A file that MuJoCo refuses, or talks about, does not pass."""

from __future__ import annotations

from pathlib import Path

import pytest
from robot_files import checked, edit, mjcf_inputs, ranked, rules, run_step
from tiny import tiny_quadruped

from assetbuild.checks.mjcf_compiles import MjcfCompiles, lint_file


def test_good_robot_compiles_without_a_word(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    found, figures = checked(MjcfCompiles(), mjcf_inputs(tmp_path, tiny_quadruped()), tmp_path)
    assert found == []
    assert not list(tmp_path.glob("MUJOCO_LOG*"))
    assert sorted(figures) == ["robot.xml", "scene.xml"]
    robot = figures["robot.xml"]
    assert (robot["nq"], robot["nv"], robot["nu"], robot["keyframes"]) == (19, 18, 12, 2)


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("scene.xml", 'material="ground"', 'material="other"'),
        ("robot.xml", "</worldbody>", ""),
    ],
)
def test_a_file_that_mujoco_refuses_does_not_load(
    file: str, old: str, new: str, tmp_path: Path
) -> None:
    inputs = mjcf_inputs(tmp_path, tiny_quadruped())
    edit(inputs / "mjcf" / file, (old, new))
    found = run_step(MjcfCompiles(), inputs, tmp_path)
    assert rules(found) == {"mjcf.load"}
    assert file in found[0].message


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
    assert set(ranked(found)) == {("mjcf.warning", "warning")}
    assert "robot.xml" in found[0].message


# --- lints ---------------------------------------------------------------------------------------


LEG = """
<mujoco>
  <compiler angle="radian"/>
  {head}
  <default>
    <default class="front"><joint axis="0 1 0" range="-1.5 3.4"/></default>
    <default class="back"><joint axis="0 1 0" range="-0.4 4.3"/></default>
  </default>
  <worldbody>
    <body name="trunk">
      <freejoint/>
      <inertial pos="0 0 0" mass="5" diaginertia="0.1 0.1 0.1"/>
      <body name="FL_thigh" pos="0.2 0.1 0">
        <joint name="FL_thigh_joint" class="front"/>
        <inertial pos="0 0.01 -0.1" mass="1" diaginertia="0.01 0.01 0.001"/>
      </body>
      <body name="FR_thigh" pos="0.2 -0.1 0">
        <joint name="FR_thigh_joint" class="front"/>
        <inertial pos="0 -0.01 -0.1" mass="{mass}" diaginertia="0.01 0.01 0.001"/>
      </body>
    </body>
  </worldbody>
  {actuator}
  {key}
</mujoco>
"""
GOOD = {
    "head": "",
    "mass": "1",
    "actuator": """<actuator>
      <position name="FL" class="front" joint="FL_thigh_joint" kp="20" inheritrange="1"/>
      <position name="FR" class="front" joint="FR_thigh_joint" kp="20" inheritrange="1"/>
    </actuator>""",
    "key": '<keyframe><key name="home" qpos="0 0 0.3 1 0 0 0 0.9 0.9" ctrl="0.9 0.9"/></keyframe>',
}
# go2_mjx.xml of Menagerie at 0b2491b8 gives a drive of the front the class of the rear hips.
SWAPPED = GOOD["actuator"].replace('"FR" class="front"', '"FR" class="back"')
BAD = {
    "lint.grammar": {"head": '<option integrator="Euler"><flag speculative="enable"/></option>'},
    "lint.absolute_path": {"head": '<compiler meshdir="/home/me/meshes"/>'},
    "lint.range": {"actuator": GOOD["actuator"].replace('inheritrange="1"', 'ctrlrange="2 1"')},
    "lint.class": {"actuator": SWAPPED},
    "lint.key_position": {"key": GOOD["key"].replace("0.9 0.9", "0.9 -2", 1)},
    "lint.key_ctrl": {"key": GOOD["key"].replace('ctrl="0.9 0.9"', 'ctrl="0.9 9"')},
    "lint.key_target": {"key": GOOD["key"].replace('ctrl="0.9 0.9"', 'ctrl="0 0"')},
    "mjcf.load": {"mass": "-1"},
}


def linted(folder: Path, **said: str) -> list[str]:
    path = folder / "leg.xml"
    path.write_text(LEG.format(**GOOD | said))
    return [finding.rule for finding in lint_file(path)]


@pytest.mark.parametrize("rule", BAD)
def test_each_rule_speaks_of_a_bad_file_alone(rule: str, tmp_path: Path) -> None:
    assert rule in linted(tmp_path, **BAD[rule])
    assert linted(tmp_path) == []


def test_included_files_are_read_and_what_is_no_mjcf_does_not_load(tmp_path: Path) -> None:
    (tmp_path / "inner.xml").write_text('<mujoco><compiler meshdir="/home/me"/></mujoco>')
    (tmp_path / "outer.xml").write_text('<mujoco><include file="inner.xml"/></mujoco>')
    assert [f.rule for f in lint_file(tmp_path / "outer.xml")] == ["lint.absolute_path"]
    for text in ('<mujoco><include file="a.xml"/></mujoco>', "<mujoco"):
        (tmp_path / "a.xml").write_text(text)
        assert [f.rule for f in lint_file(tmp_path / "a.xml")] == ["mjcf.load"]
