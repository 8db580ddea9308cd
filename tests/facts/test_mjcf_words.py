"""What only MJCF says comes out as it went in: no false alarm, and no lie passes."""

# ruff: noqa: E501 # one text per line reads better than wrapped XML

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from mjcfs import Written, hard_arm, read, write
from tiny import run_step

from assetbuild.checks.mjcf_source import MjcfSource
from assetbuild.facts.readers.mjcf import MjcfFacts
from assetbuild.findings import Finding
from assetbuild.geometry.measure_assets import MeasureAssets
from assetbuild.pipeline.recipes import whole_model

RECIPE = {"schema": "assetbuild/v1", "robot": "robot", "source": {"path": ".", "mjcf": "a.xml"}}
ROBOT = """<mujoco><option solver="CG" iterations="7"/><worldbody>
  <body name="torso" pos="0 0 1"><freejoint/><geom name="chest" size=".1" rgba="1 0 0 1"/>
    <site name="hook" pos="0 0 .1"/><site name="plain" group="2"/>
    <camera name="eye" mode="targetbody" target="foot"/>
    <camera name="lens" sensorsize=".004 .002" focal=".002 .002" resolution="64 32"/>
    <geom name="egg" type="ellipsoid" size=".1 .1 .2" contype="2" conaffinity="2"/>
    <body name="foot" pos="0 0 -.3"><joint name="roll"/><joint name="pitch" axis="0 1 0"/>
      <geom name="sole" size=".05" group="1"/>
      <body name="toe" pos=".2 0 0"><joint name="bend" axis="0 1 0"/><geom size=".02"/></body>
    </body></body></worldbody>
<tendon><fixed name="cable"><joint joint="roll" coef="2"/><joint joint="bend" coef="-1"/></fixed>
  <spatial name="rope"><site site="hook"/><geom geom="sole" sidesite="plain"/>
    <site site="plain"/><pulley divisor="2"/><site site="hook"/><site site="plain"/></spatial>
</tendon>
<actuator><motor name="pitch" joint="pitch"/><motor tendon="cable"/></actuator></mujoco>"""


def written(tmp_path: Path, text: str = ROBOT) -> Written:
    reading = read(text, tmp_path / "read") if text else hard_arm(tmp_path / "read")
    made = write(reading, tmp_path / "out")
    shutil.copyfile(reading.read / "links.json", made.inputs / "links.json")
    run_step(MeasureAssets(), made.inputs, tmp_path / "measured")
    shutil.copyfile(tmp_path / "measured" / "assets.json", made.inputs / "assets.json")
    return made


def proved(made: Written) -> list[Finding]:
    check = MjcfFacts.configure(whole_model().model_validate(RECIPE))
    assert check is not None
    out = made.inputs.parent / f"proof{len(list(made.inputs.parent.iterdir()))}"
    return run_step(check, made.inputs, out)


@pytest.mark.parametrize("text", [ROBOT, ""])
def test_words_of_the_source_are_expected(text: str, tmp_path: Path):
    assert proved(written(tmp_path, text)) == []


@pytest.mark.parametrize(
    ("old", "new", "rule", "subject"),
    [
        ('coef="2"', 'coef="2.1"', "path", "tendon cable"),
        ('sidesite="plain"', "", "path", "tendon rope"),
        ('target="foot"', 'target="toe"', "target", "camera eye"),
        ('rgba="1 0 0 1"', 'rgba="0 1 0 1"', "rgba", "shape chest"),
        ('iterations="7"', 'iterations="8"', "iterations", "simulation"),
        ('sensorsize=".004 .002"', 'sensorsize=".004 .001"', "sensorsize", "camera lens"),
    ],
)
def test_a_changed_word_is_found(old: str, new: str, rule: str, subject: str, tmp_path: Path):
    made = written(tmp_path)
    text = made.xml.read_text()
    assert old in text
    made.xml.write_text(text.replace(old, new, 1))
    findings = run_step(MjcfSource(robot="robot"), made.inputs, tmp_path / "compared")
    assert (f"equal.source.{rule}", subject) in {(f.rule, f.subject) for f in findings}


ARM = """<mujoco><compiler angle="radian"/><worldbody><body name="base"><geom size=".1"/>
<body name="upper"><joint name="j" range="-1 1" limited="true" {joint}/><geom size=".1"/>
<site name="s"/><body name="lower" pos=".3 0 0"><joint name="k" type="slide" {other}/><geom size=".1"/>
<site name="tip"/></body></body></body></worldbody>{more}</mujoco>"""
ROPE = (
    '<tendon><spatial name="t"><site site="s"/><site site="tip"/></spatial></tendon>'
    '<actuator><motor name="m" joint="j"/></actuator>'
)
TEXTS = {
    "force of a joint's actuators": (ROPE + '<sensor><jointactuatorfrc joint="j"/></sensor>', "", ""),
    "force of a tendon's actuators": (ROPE + '<sensor><tendonactuatorfrc tendon="t"/></sensor>', "", ""),
    "rangefinder": ('<sensor><rangefinder site="s"/></sensor>', "", ""),
    "range of a joint's force": (ROPE, 'actuatorfrcrange="-7 9"', ""),
    "no range of a joint's force": (ROPE, 'actuatorfrcrange="-7 9" actuatorfrclimited="false"', ""),
    "gravity by the actuator": (ROPE, 'actuatorgravcomp="true" margin=".1"', ""),
    "weld": ('<equality><weld body1="base" body2="lower"/></equality>', 'pos=".1 0 0"', 'pos="0 .1 0"'),
    "weld by pose": ('<equality><weld body1="lower" body2="upper" relpose=".1 0 0 0 -1 0 0" anchor=".1 0 0"/></equality>', 'pos=".1 0 0"', 'pos="0 .1 0" ref=".2"'),
    "muscle": (ROPE.replace("motor", "muscle").replace('joint="j"', 'tendon="t"'), "", 'axis="1 0 0" range="-.1 .1" limited="true"'),
    "muscle of a joint": ('<actuator><muscle joint="j" lengthrange=".1 1"/></actuator>', "", ""),
    "two drives of a joint": ('<actuator><motor name="a" joint="j" ctrlrange="0 1" ctrllimited="true"/><motor name="b" joint="j"/></actuator>', "", ""),
    "user numbers": ('<actuator><motor joint="j" user="1 2"/></actuator>', "", ""),
    "geared motor at ref": ('<actuator><motor joint="j" gear="3"/></actuator>', 'ref=".2"', ""),
    "gain": ('<actuator><general joint="j" gainprm="20" ctrlrange="-1 2" ctrllimited="true"/></actuator>', "", ""),
    "gain behind a filter": ('<actuator><general joint="j" gainprm="20" ctrlrange="-1 1" ctrllimited="true" dyntype="filter" dynprm=".1"/></actuator>', "", ""),
    "keyframe without commands": ('<actuator><position joint="j" kp="3"/></actuator><keyframe><key name="k" qpos=".3 .1"/></keyframe>', "", ""),
    "keyframes without names": (ROPE.replace('joint="j"', 'tendon="t"') + '<size nkey="2"/><keyframe><key name="k" qpos=".3 .1"/></keyframe>', "", ""),
    "ranges that limit nothing": (ROPE.replace('joint="j"', 'tendon="t" forcerange="-2 2" forcelimited="false" ctrlrange="-1 1" ctrllimited="false"'), "", ""),
    "general motor with a range of forces": ('<actuator><general joint="j" forcerange="-8 8" forcelimited="true"/></actuator>', "", ""),
    "fixed tendon over a joint with ref": ('<tendon><fixed name="t" range="-1 2" limited="true" stiffness="3" springlength=".3"><joint joint="j" coef="2"/><joint joint="k" coef="-1"/></fixed></tendon><equality><tendon tendon1="t"/></equality><actuator><motor tendon="t"/></actuator><sensor><tendonpos tendon="t"/></sensor>', 'ref=".2"', 'ref="-.3"'),
    "fixed tendon with a spring at rest": ('<tendon><fixed name="t" stiffness="3"><joint joint="j" coef="2"/></fixed></tendon>', 'ref=".2"', ""),
    "quadrotor": ('<actuator><motor site="s" gear="0 0 1 0 0 .1"/></actuator>', "", ""),
    "adhesion": ('<actuator><adhesion body="lower" ctrlrange="0 1" gain="2"/></actuator>', "", ""),
}  # fmt: skip


@pytest.mark.parametrize("what", TEXTS)
def test_what_only_mjcf_has_comes_out_as_it_went_in(what: str, tmp_path: Path):
    more, joint, other = TEXTS[what]
    made = written(tmp_path, ARM.format(more=more, joint=joint, other=other))
    assert proved(made) == []
    assert run_step(MjcfSource(robot="robot"), made.inputs, tmp_path / "compared") == []


def test_a_camera_whose_target_is_no_body_looks_ahead(tmp_path: Path):
    text = """<mujoco><worldbody><camera name="c" mode="targetbody" target="focus" fovy="70"/>
    <body name="a"><geom size=".1"/><body name="focus" pos="0 0 1"/></body></worldbody></mujoco>"""
    made = written(tmp_path, text)
    assert "mjcf.dropped" in {finding.rule for finding in made.findings}
    assert proved(made) == []
    assert run_step(MjcfSource(robot="robot"), made.inputs, tmp_path / "compared") == []


def test_geoms_that_collide_in_the_group_of_visual_ones_are_no_difference(tmp_path: Path):
    text = """<mujoco><worldbody><body name="a"><geom name="g" group="2" size=".1" priority="1"
    friction=".7 .005 .001" condim="1" solref=".015 1" solimp=".9 .9 .003 .5 2"/></body></worldbody>
    </mujoco>"""
    made = written(tmp_path, text)
    assert proved(made) == []
    made.xml.write_text(made.xml.read_text().replace('condim="1"', 'condim="3"'))
    assert [finding.rule for finding in proved(made)] == ["equal.mjcf.condim"]


@pytest.mark.parametrize("free", ["", "<joint/>", "<freejoint/>"])
def test_a_muscle_between_world_and_robot_comes_out_as_it_went_in(free: str, tmp_path: Path):
    text = f"""<mujoco><worldbody><site name="anchor" pos="0 0 2"/>
    <body name="a">{free}<geom size=".1"/><site name="s"/></body></worldbody>
    <tendon><spatial name="t"><site site="anchor"/><site site="s"/></spatial></tendon>
    <actuator><muscle name="m" tendon="t" lengthrange="1 2"/></actuator></mujoco>"""
    made = written(tmp_path, text)
    assert proved(made) == []
    assert run_step(MjcfSource(robot="robot"), made.inputs, tmp_path / "compared") == []
