"""mjlab finds geoms, feet and joints by name: every source builds, and a slip is found."""

from __future__ import annotations

import ast
import re
import shutil
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest
from mjcfs import read, write
from tiny import TinyRobot, check_inputs, run_step, tiny_quadruped

from assetbuild.checks.mjlab_contract import MjlabContract
from assetbuild.facts.reader import Reader
from assetbuild.facts.readers.bare import BareFacts
from assetbuild.facts.readers.mjlab import MjlabReader
from assetbuild.facts.reference import Assets
from assetbuild.findings import Finding
from assetbuild.robot.codec import encode
from assetbuild.robot.model import Frame
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Sphere
from assetbuild.targets.mjlab import Mjlab

HOPPER = """<mujoco model="hopper"><compiler angle="radian"/>
<worldbody><geom name="slab" type="plane" size="1 1 1"/>
<body name="trunk" pos="0 0 0.6"><freejoint/>
  <geom name="box" group="3" type="box" size=".1 .1 .1" mass="4"/>
  <geom name="shell" type="box" size=".1 .1 .1" contype="0" conaffinity="0" group="2" mass="0"/>
  <site name="top" group="4" pos="0 0 0.1"/>
  <body name="leg" pos="0 0 -0.1"><joint name="knee" type="hinge" axis="0 1 0" range="-1 1"/>
    <geom name="shin" group="3" type="cylinder" fromto="0 0 0 0 0 -0.3" size=".02" mass="1"/>
    <geom name="heel" group="3" pos="-0.03 0 -0.3" size=".03" mass="0.1"/>
    <geom name="ball" group="3" pos="0.03 0 -0.3" size=".03" mass="0.1"/>
    <site name="sole" group="4" pos="0 0 -0.33"/></body></body></worldbody>
<contact><pair name="own" geom1="ball" geom2="box"/></contact>
<tendon><spatial name="string"><site site="top"/><geom geom="shin"/><site site="sole"/>
</spatial></tendon>
<actuator><position name="knee" joint="knee" kp="50" kv="2" forcerange="-20 20"/></actuator>
<sensor><framepos name="where" objtype="geom" objname="ball"/>
  <distance name="apart" geom1="ball" geom2="box" cutoff="1"/></sensor>
<keyframe><key name="home" qpos="0 0 0.43 1 0 0 0 0"/></keyframe></mujoco>"""
MOTOR = '<actuator><motor joint="FR_hip_joint"/></actuator>'
MJLAB = Mjlab(robot="robot", feet=".*_foot|.*_heel", imu="imu")


def module_of(folder: Path) -> str:
    return (folder / "mjlab/python/robot_mjlab.py").read_text()


def constant(text: str, name: str) -> object:
    return ast.literal_eval(re.search(rf"^{name} = (\([^)]*\))", text, re.MULTILINE)[1])


def evaluate(inputs: Path, out: Path) -> list[str]:
    found = run_step(MjlabContract(robot="robot"), inputs, out)
    assert {finding.rule for finding in found} <= {"mjlab.contract"}
    return [finding.message for finding in found]


def proven(inputs: Path, out: Path, reader: type[Reader] = MjlabReader) -> list[Finding]:
    options = {"feet": {"links": MJLAB.feet}, "imu": {"link": MJLAB.imu}}
    found = run_step(reader(robot="robot", options=options), inputs, out)
    return [finding for finding in found if finding.severity == "error"]


@pytest.fixture
def hopper(tmp_path: Path) -> tuple[Path, list[Finding]]:
    """(inputs of a check, findings of the target) of an MJCF with names of its own."""
    inputs = write(read(HOPPER, tmp_path / "read"), tmp_path / "written").inputs
    found = run_step(Mjlab(robot="robot", feet="leg"), inputs, tmp_path / "built")
    (inputs / "mjlab").symlink_to(tmp_path / "built/mjlab")
    return inputs, found


def test_an_mjcf_with_names_of_its_own_builds_for_mjlab(hopper, tmp_path: Path):
    inputs, found = hopper
    assert evaluate(inputs, tmp_path / "out") == []
    (renamed,) = (finding for finding in found if finding.rule == "mjlab.renamed")
    assert set(renamed.data["geoms"]) >= {"box", "shin", "heel", "ball"}
    model = mujoco.MjModel.from_xml_path(str(inputs / "mjlab/mjcf/robot_bare.xml"))
    names = {model.geom(i).name for i in range(model.ngeom)}
    assert {"box_collision", "shin_collision", "shell"} <= names


def test_the_new_names_are_what_the_reader_of_facts_expects(hopper, tmp_path: Path):
    inputs, _ = hopper
    shutil.copyfile(inputs / "tree.json", inputs / "links.json")
    (inputs / "assets.json").write_bytes(encode(Assets()))
    for reader in (BareFacts, MjlabReader):
        step = reader(robot="robot", options={"feet": {"links": "leg"}})
        assert run_step(step, inputs, tmp_path / step.format_id) == []


def with_heels(robot: TinyRobot) -> TinyRobot:
    """Every foot has a second link, which fixed joints hold at the same calf."""
    legs = ("FR", "FL", "RR", "RL")
    foot = next(s for s in robot.shapes.shapes if s.name == "FR_foot_collision")
    places = {frame.name: frame.X_body_frame for frame in robot.tree.frames}
    up = Pose((0.0, 0.0, 0.02))
    frames = tuple(Frame(f"{leg}_heel", f"{leg}_calf", places[f"{leg}_foot"] @ up) for leg in legs)
    more = tuple(
        replace(foot, name=f"{leg}_heel_collision", link=f"{leg}_heel", geometry=Sphere(0.01))
        for leg in legs
    )
    return replace(
        robot,
        tree=replace(robot.tree, frames=robot.tree.frames + frames),
        shapes=replace(robot.shapes, shapes=more + robot.shapes.shapes),
    )


def test_links_that_one_body_holds_are_one_foot(tmp_path: Path):
    robot = with_heels(tiny_quadruped())
    inputs = check_inputs(tmp_path, robot, MJLAB, "mjlab")
    text = module_of(inputs)
    assert constant(text, "FOOT_SITES") == ("FR_foot", "FL_foot", "RR_foot", "RL_foot")
    assert len(constant(text, "FOOT_GEOMS")) == 8
    assert 'mode="body", pattern=("FR_calf", "FL_calf", "RR_calf", "RL_calf",)' in text
    assert proven(inputs, tmp_path / "proof") == []
    assert evaluate(inputs, tmp_path / "out") == []


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('("FR_calf", "FL_calf",', '("FR_calf", "FR_calf", "FL_calf",', "counts 5 feet"),
        ('"RR_calf", "RL_calf",)', '"RR_calf",)', "counts 3 feet"),
        ('"FR_calf", "FL_calf",', '"FR_shin", "FL_calf",', "no body of the bare MJCF is"),
        ('    "FR_foot",\n', "", "`FOOT_SITES` has 3"),
        ('    "FR_foot_collision",\n', '    "FR_toe",\n', "FOOT_GEOMS: no geom"),
        ('IMU_SITE = "imu"', 'IMU_SITE = "compass"', "IMU_SITE: no site"),
    ],
)
def test_the_check_finds_what_mjlab_would_stop_at(old: str, new: str, said: str, tmp_path: Path):
    inputs = check_inputs(tmp_path, with_heels(tiny_quadruped()), MJLAB, "mjlab")
    path = inputs / "mjlab/python/robot_mjlab.py"
    assert old in path.read_text(), path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    assert any(said in message for message in evaluate(inputs, tmp_path / "out"))


@pytest.mark.parametrize(
    ("file", "old", "new", "rule"),
    [
        ("python/robot_mjlab.py", 'ROOT_BODY = "trunk"', 'ROOT_BODY = "base"', "root"),
        ("python/robot_mjlab.py", '    "FR_hip_joint",', '    "FR_hop_joint",', "kp"),
        ("mjcf/robot_bare.xml", 'name="FR_foot_collision"', 'name="FR_sole"', "missing"),
        ("mjcf/robot_bare.xml", 'name="root_angmom"', 'name="angmom"', "missing"),
        ("mjcf/robot_bare.xml", "</mujoco>", f"{MOTOR}</mujoco>", "model"),
        ("mjcf/robot_bare.xml", "</mujoco>", "</mujoc>", "unreadable"),
    ],
)  # fmt: skip
def test_the_readers_find_what_mjlab_would_miss(
    file: str, old: str, new: str, rule: str, tmp_path: Path
):
    inputs = check_inputs(tmp_path, tiny_quadruped(), MJLAB, "mjlab")
    path = inputs / "mjlab" / file
    assert old in path.read_text(), path.read_text()
    path.write_text(path.read_text().replace(old, new))
    reader = MjlabReader if file.endswith(".py") else BareFacts
    found = proven(inputs, tmp_path / "proof", reader)
    assert rule in {finding.rule.rpartition(".")[2] for finding in found}, found


def test_a_floating_robot_without_keyframes_is_told_to_add_one(tmp_path: Path):
    robot = tiny_quadruped()
    robot = replace(robot, control=replace(robot.control, keyframes=()))
    inputs = check_inputs(tmp_path, robot, MJLAB, "mjlab")
    (finding,) = run_step(MjlabContract(robot="robot"), inputs, tmp_path / "out")
    assert finding.rule == "mjlab.buried"
    assert "home" in finding.hint
