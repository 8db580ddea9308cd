"""One thing changed in an MJCF, and its reader names subject, quantity and both values."""

from __future__ import annotations

import re

# ruff: noqa: E501 # one text per line reads better than wrapped XML
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from gripper import gripper
from hypothesis import given, settings
from mjcfs import Written, hard_arm, read, write
from random_robots import examples, robots
from robot_files import check_inputs, run_step
from tiny import TinyRobot, pendulum, tiny_quadruped

from assetbuild.checks.mjcf_source import MjcfSource
from assetbuild.facts.reader import Reader
from assetbuild.facts.readers._mjcf import BareFacts, MjcfFacts, MjxFacts
from assetbuild.facts.readers.scene import SceneFacts
from assetbuild.facts.table import pair_name, pair_of
from assetbuild.findings import Finding
from assetbuild.geometry.measure_assets import MeasureAssets, ReadMeshes
from assetbuild.pipeline.recipes import whole_model
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.model import Limits
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.mjlab import Mjlab
from assetbuild.targets.mjx import Mjx

FORMS: dict[str, tuple[type[Reader], type, str, str]] = {
    "mjcf": (MjcfFacts, Mjcf, "mjcf", "robot.xml"),
    "mjx": (MjxFacts, Mjx, "mjx", "robot_mjx.xml"),
    "bare": (BareFacts, Mjlab, "mjlab", "mjcf/robot_bare.xml"),
    "scene": (SceneFacts, Mjcf, "mjcf", "scene.xml"),
}
"""Reader, target, folder and file of each form."""


def check(
    robot: TinyRobot, folder: Path, spoil: Callable[[str], str] = str, form: str = "mjcf"
) -> list[Finding]:
    reader, target, name, file = FORMS[form]
    inputs = check_inputs(folder, robot, target(robot="robot"), name)
    path = inputs / name / file
    path.write_text(spoil(path.read_text()))
    return run_step(reader(robot="robot"), inputs, folder / "out")


def replaced(pattern: str, new: str) -> Callable[[str], str]:
    def spoil(text: str) -> str:
        changed, count = re.subn(pattern, new, text, count=1)
        assert count == 1, f"{pattern} is not in the file"
        return changed

    return spoil


@settings(max_examples=examples(40), deadline=None)
@given(robots())
def test_every_random_tree_is_equal(robot: TinyRobot) -> None:
    with TemporaryDirectory() as folder:
        assert check(robot, Path(folder)) == []


def test_a_locked_joint_is_held_where_its_limits_meet(tmp_path: Path) -> None:
    robot = pendulum()
    joint = replace(robot.tree.joints[0], limits=Limits(0.0, 0.0, 5.0, 1.0))
    locked = replace(robot, tree=replace(robot.tree, joints=(joint,)))
    assert check(locked, tmp_path / "a") == []
    found = check(locked, tmp_path / "b", replaced('polycoef="0 0', 'polycoef="0.1 0'))
    assert [f.rule for f in found] == ["equal.mjcf.lower", "equal.mjcf.upper"]


def test_bodies_with_spaces_in_their_names_make_pairs_of_two(tmp_path: Path) -> None:
    """One body is called `world`, which MuJoCo keeps for itself: then names are exchanged."""
    robot, names = tiny_quadruped(), {"trunk": "world", "FR_hip": "hip FR", "FR_thigh": "FR"}

    def renamed(part):
        text = encode(part).decode()
        for old, new in names.items():
            text = text.replace(f'"{old}"', f'"{new}"')
        return decode(type(part), text.encode())

    tree, shapes, control = (renamed(part) for part in (robot.tree, robot.shapes, robot.control))
    assert check(replace(robot, tree=tree, shapes=shapes, control=control), tmp_path) == []


def test_a_pair_is_not_taken_for_another_whose_names_are_cut_elsewhere() -> None:
    pairs = [("a b", "c"), ("a", "b c"), ("a", "c"), ('"a', "b"), ("", "a\\ b")]
    assert len({pair_name(*pair) for pair in pairs}) == len(pairs)
    for one, other in pairs:
        names = pair_of(pair_name(one, other)), pair_of(pair_name(other, one))
        assert names == (tuple(sorted((one, other))),) * 2


HIP, CALF = "joint FR_hip_joint", "joint FR_calf_joint"
PLANTED = [
    ("mass", "body FR_hip", r'mass="0.5"', 'mass="0.500000001"'),
    ("pose", "body FR_hip", r'pos="0.18 -0.05 0"', 'pos="0.18 -0.05000001 0"'),
    ("axis", HIP, r'axis="1 0 0"', 'axis="1 0.00001 0"'),
    ("upper", HIP, r'range="-0.86 0.86"', 'range="-0.86 0.87"'),
    ("effort_range", CALF, r'forcerange="-36 36"', 'forcerange="-35 36"'),
    ("kp", HIP, r'kp="100"', 'kp="90"'),
    ("missing", "frame imu", r'<site name="imu"[^>]*/>', ""),
    ("role", "shape trunk_visual", r'class="visual" mesh', 'class="collision" type="mesh" mesh'),
    ("friction", "shape trunk_collision", r'friction="0.8 ', 'friction="0.7 '),
    ("target", "keyframe home/RL_calf_joint", r' 0 0.8 -1.6"/>', ' 0 0.8 -1.7"/>'),
    ("timestep", "simulation", r'timestep="0.005"', 'timestep="0.004"'),
    ("filtered", "pair RL_thigh trunk", r"</mujoco>",
     '<contact><exclude body1="RL_thigh" body2="trunk"/></contact></mujoco>'),
    # What MJCF alone says, of which the vocabulary does not know.
    ("solmix", "shape trunk_collision", r'<geom name="trunk_collision"', r'\g<0> solmix="3"'),
    ("extra", "loop equality 0", r"</mujoco>",
     '<equality><weld body1="FR_hip" body2="FL_hip"/></equality></mujoco>'),
]  # fmt: skip


IN_A_GRIPPER = [
    ("mjcf", "mean_corner", "shape skin", r'pos="0.01 0.02 0.03"', 'pos="0.04 0.02 0.03"'),
    ("mjcf", "mimic_multiplier", "joint b_joint", r'polycoef="0.25 -1.5', 'polycoef="0.25 1.5'),
    ("mjcf", "between", "equality b_joint_copy", r'(<joint name="b_joint)("[^>]* polycoef[^>]*/>)',
     r"\1\2\1_copy\2"),
    ("scene", "type", "shape floor_copy", r'(<geom name="floor)("[^>]*/>)', r"\1\2\1_copy\2"),
    ("mjx", "iterations", "simulation", r' iterations="20"', ' iterations="40"'),
    ("bare", "mass", "body base", r' mass="1"', ' mass="3"'),
    ("scene", "friction", "floor", r' friction="[^"]*"', ' friction="3 0 0"'),
    ("scene", "centre", "view", r'center="[^"]*"', 'center="0 0 9"'),
    ("scene", "extent", "view", r' extent="[^"]*"', ' extent="9"'),
    ("scene", "lights", "view", r"<light [^>]*/>", ""),
    ("scene", "timestep", "simulation", r"<statistic", '<option timestep="0.1"/><statistic'),
]  # fmt: skip


@pytest.mark.parametrize(
    ("robot", "form", "rule", "subject", "pattern", "new"),
    [(tiny_quadruped(), "mjcf", *row) for row in PLANTED]
    + [(gripper(), *row) for row in IN_A_GRIPPER],
)
def test_a_planted_change_is_found(
    tmp_path: Path, robot: TinyRobot, form: str, rule: str, subject: str, pattern: str, new: str
) -> None:
    found = check(robot, tmp_path, replaced(pattern, new), form)
    named = {(f.rule, s): f for f in found for s in (f.subject, *f.data.get("subjects", ()))}
    assert (f"equal.{form}.{rule}", subject) in named
    assert {f.severity for f in found} == {"error"}
    if (rule, form) == ("mass", "bare"):
        mass = named[f"equal.{form}.{rule}", subject]
        assert (mass.data["expected"], mass.data["found"]) == (1.0, 3.0)
        assert "3 kg in the" in mass.message and ", 1 kg in the robot" in mass.message


@pytest.mark.parametrize("line", [r"(?m)^(f) (\S+) (\S+)", r"(?m)^(v) (\S+) (\S+)"])
@pytest.mark.parametrize("form", ["mjcf", "bare"])
def test_one_line_of_a_mesh_is_found_in_every_form(form: str, line: str, tmp_path: Path) -> None:
    """A face that is turned over; a corner of which two numbers are exchanged."""
    reader, target, name, file = FORMS[form]
    inputs = check_inputs(tmp_path, gripper(), target(robot="robot"), name)
    mesh = next((inputs / name / file).parent.glob("assets/block*.obj"))
    mesh.write_text(re.sub(line, r"\1 \3 \2", mesh.read_text(), count=1))
    found = {f.rule for f in run_step(reader(robot="robot"), inputs, tmp_path / "out")}
    assert found & {f"equal.{form}.volume", f"equal.{form}.mean_corner"}


def test_an_attribute_that_mujoco_does_not_know_is_reported(tmp_path: Path) -> None:
    (found,) = check(pendulum(), tmp_path, replaced(r"<option ", r"\g<0>wings='2' "))
    assert found.rule == "equal.unreadable"
    assert "wings" in found.message


# --- words of MJCF -------------------------------------------------------------------------------


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
    run_step(ReadMeshes(), made.inputs, made.inputs)
    run_step(MeasureAssets(), made.inputs, tmp_path / "measured")
    shutil.copyfile(tmp_path / "measured" / "assets.json", made.inputs / "assets.json")
    return made


def proved(made: Written) -> list[Finding]:
    check = MjcfFacts.configure(whole_model().model_validate(RECIPE))
    assert check is not None
    out = made.inputs.parent / f"proof{len(list(made.inputs.parent.iterdir()))}"
    return run_step(check, made.inputs, out)


@pytest.mark.parametrize(
    ("old", "new", "rule", "subject"),
    [
        ('coef="2"', 'coef="2.1"', "path", "tendon cable"),
        ('sidesite="plain"', "", "path", "tendon rope"),
        ('target="foot"', 'target="toe"', "target", "camera eye"),
        ('rgba="1 0 0 1"', 'rgba="0 1 0 1"', "rgba", "shape chest_visual"),
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


MUSCLE = """<mujoco><worldbody><site name="anchor" pos="0 0 2"/>
  <body name="a">{free}<geom size=".1"/><site name="s"/></body></worldbody>
  <tendon><spatial name="t"><site site="anchor"/><site site="s"/></spatial></tendon>
  <actuator><muscle name="m" tendon="t" lengthrange="1 2"/></actuator></mujoco>"""
WHOLE = {
    "a camera whose target is no body": """<mujoco><worldbody>
    <camera name="c" mode="targetbody" target="focus" fovy="70"/><body name="a"><geom size=".1"/>
    <body name="focus" pos="0 0 1"/></body></worldbody></mujoco>""",
    "a muscle to the world": MUSCLE.format(free=""),
    "a muscle to a hinge": MUSCLE.format(free="<joint/>"),
    "a muscle to a floating body": MUSCLE.format(free="<freejoint/>"),
    "words of the source": ROBOT,
    "a hard arm": "",
} | {what: ARM.format(more=m, joint=j, other=o) for what, (m, j, o) in TEXTS.items()}


@pytest.mark.parametrize("what", WHOLE)
def test_what_only_mjcf_has_comes_out_as_it_went_in(what: str, tmp_path: Path):
    made = written(tmp_path, WHOLE[what])
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
