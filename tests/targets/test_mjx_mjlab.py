"""The mjx model has the same joints and poses; the bare one keeps mjlab's contract."""

from __future__ import annotations

import ast
import re
import shutil
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest
from mjcfs import read, write
from robot_files import check_inputs, emit, run_step
from tiny import TinyRobot, pendulum, tiny_quadruped, with_control

from assetbuild.checks.mjlab_contract import MjlabContract
from assetbuild.errors import StepError
from assetbuild.facts.reader import Reader
from assetbuild.facts.readers._mjcf import BareFacts
from assetbuild.facts.readers.mjlab import MjlabReader
from assetbuild.facts.reference import Assets
from assetbuild.findings import Finding
from assetbuild.robot.codec import encode
from assetbuild.robot.model import Actuator, Frame, General, Place, Sensor
from assetbuild.robot.pose import Pose
from assetbuild.robot.ranges import Randomize
from assetbuild.robot.shapes import Mesh, Sphere
from assetbuild.targets.isaaclab import IsaacLab
from assetbuild.targets.mjlab import Mjlab
from assetbuild.targets.mjlab.module import MjlabOptions
from assetbuild.targets.mjx import Mjx, MjxOptions


def test_contacts_with_fewer_dimensions_are_told(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    sole = robot.control.contact.model_copy(update={"condim": 6, "priority": 1})
    robot = with_control(robot, contacts=(("FR_foot_collision", sole),))
    asked = MjxOptions.model_validate({"condim": 3})
    (finding,) = emit(Mjx(robot="robot", options=asked), robot, tmp_path)
    assert (finding.rule, finding.data) == ("mjx.condim", {"condim": 3, "was": 6})
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out/mjx/robot_mjx.xml"))
    assert set(model.geom_condim) == {3}
    assert model.geom("FR_foot_collision").priority == 1
    assert emit(Mjx(robot="robot"), robot, tmp_path / "as_it_is") == []
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "as_it_is/out/mjx/robot_mjx.xml"))
    assert model.geom("FR_foot_collision").condim == 6


def test_a_hull_with_many_corners_is_capped_and_told(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    shapes = tuple(
        replace(s, geometry=Mesh("trunk_box")) if s.name == "trunk_collision" else s
        for s in robot.shapes.shapes
    )
    robot = replace(robot, shapes=replace(robot.shapes, shapes=shapes))
    target = Mjx(robot="robot", options=MjxOptions.model_validate({"max_vertices": 4}))
    findings = emit(target, robot, tmp_path)
    assert [f.rule for f in findings] == ["mjx.hull"]
    assert 'maxhullvert="4"' in (tmp_path / "out/mjx/robot_mjx.xml").read_text()


def test_a_pattern_that_leaves_nothing_to_stand_on_is_refused(tmp_path: Path) -> None:
    target = Mjx(robot="robot", options=MjxOptions.model_validate({"touching": "paw"}))
    with pytest.raises(StepError, match="leaves no collision shape"):
        emit(target, tiny_quadruped(), tmp_path)


@pytest.mark.parametrize(("touching", "untouchable"), [(".*_foot", [13]), (".*", [])])
def test_links_that_touch_nothing_are_counted(
    touching: str, untouchable: list[int], tmp_path: Path
) -> None:
    """The trunk and three links of each leg."""
    target = Mjx(robot="robot", options=MjxOptions.model_validate({"touching": touching}))
    found = emit(target, tiny_quadruped(), tmp_path)
    assert [f.data["links"] for f in found if f.rule == "mjx.collision_disabled"] == untouchable


def test_sensors_that_mjlab_makes_itself_are_left_out(tmp_path: Path) -> None:
    touch = Sensor("touch", "contact", Place("body", "FR_calf"))
    gyro = Sensor("gyro", "gyro", Place("frame", "imu"))
    robot = with_control(tiny_quadruped(), sensors=(touch, gyro))
    found = emit(MJLAB, robot, tmp_path)
    assert [f.data["sensors"] for f in found if f.rule == "mjlab.sensors"] == [("touch",)]


def test_the_recipe_decides_what_only_mjlab_knows(tmp_path: Path) -> None:
    options = {
        "soft_joint_pos_limit_factor": 0.8,
        "num_envs": 64,
        "cone": "pyramidal",
        "impratio": 2.5,
        "njmax": None,
        "nconmax": 90,
        "action": {"effort_share": 0.5, "min_rad": 0.05, "rad": 0.1},
        "foot_scan": {"radius": 0.02, "samples": 6},
        "pose": {"knees": ".*_thigh_joint", "walking": [0.2, 0.4]},
    }
    asked = MjlabOptions.model_validate(options)
    target = MJLAB.model_copy(update={"options": asked})
    inputs = check_inputs(tmp_path, tiny_quadruped(), target, "mjlab")
    said = {"mjlab": asked.model_dump(), "feet": {"links": MJLAB.feet}, "imu": {"link": MJLAB.imu}}
    assert run_step(MjlabReader(robot="robot", options=said), inputs, tmp_path / "proof") == []
    text = module_of(inputs)
    for said in (
        "num_envs: int = 64)",
        "cfg.sim.njmax = None",
        "cfg.sim.nconmax = 90",
        "single_ring(radius=0.02, num_samples=6)",
        '"std_walking": (0.2, 0.4),',
    ):
        assert said in text
    assert constant(text, "KNEES") == tuple(f"{leg}_thigh_joint" for leg in LEGS)


def test_what_mjlab_cannot_randomize_is_told(tmp_path: Path) -> None:
    wide = {"links": {".*": {"stretch": 0.1}}, "restitution": [0, 0.5]}
    target = MJLAB.model_copy(update={"randomize": Randomize.model_validate(wide)})
    (finding,) = emit(target, tiny_quadruped(), tmp_path)
    assert finding.rule == "mjlab.randomize"
    stretch, bounce = finding.data["without"]
    assert stretch.startswith("stretch")
    assert bounce.startswith("restitution")
    assert '"d_range": (-0.1, 0.1)' in module_of(tmp_path / "out")


def test_a_robot_without_feet_has_no_task_and_is_told(tmp_path: Path) -> None:
    findings = emit(Mjlab(robot="robot"), tiny_quadruped(), tmp_path)
    assert [f.rule for f in findings] == ["mjlab.imu", "mjlab.feet"]
    assert "velocity" not in module_of(tmp_path / "out")


@pytest.mark.parametrize(("stall", "said"), [(None, 5.0), (12.0, 12.0)])
def test_a_dc_motor_saturates_at_its_stall_torque(
    stall: float | None, said: float, tmp_path: Path
) -> None:
    drive = Actuator("swing_joint", "dc_motor", 9.0, effort=5.0, velocity=10.0, stall=stall)
    robot = with_control(pendulum(), actuators=(drive,))
    found = [f.rule for each in (Mjlab, IsaacLab) for f in emit(each(robot="r"), robot, tmp_path)]
    unstated = ["mjlab.saturation", "isaaclab.saturation"]
    assert found == ([] if stall else unstated)
    for file in ("mjlab/python/r_mjlab.py", "isaaclab/r_isaaclab_2.py"):
        text = (tmp_path / "out" / file).read_text()
        assert f"saturation_effort={said!r}" in text
        assert "effort_limit=5.0" in text


def test_a_general_actuator_is_told_not_dropped(tmp_path: Path) -> None:
    drive = Actuator("swing_joint", "general", general=General(gainprm=(1.0,)))
    robot = with_control(pendulum(), actuators=(drive,))
    assert [f.rule for f in emit(Mjlab(robot="r"), robot, tmp_path)] == ["mjlab.actuator"]


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
LEGS = ("FR", "FL", "RR", "RL")
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


def test_a_bare_file_with_a_keyframe_is_no_bare_file(hopper, tmp_path: Path):
    inputs, _ = hopper
    bare = inputs / "mjlab/mjcf/robot_bare.xml"
    bare.write_text(bare.read_text().replace("</mujoco>", "<keyframe><key/></keyframe></mujoco>"))
    (message,) = evaluate(inputs, tmp_path / "out")
    assert "keyframes" in message


def test_the_new_names_are_what_the_reader_of_facts_expects(hopper, tmp_path: Path):
    inputs, _ = hopper
    shutil.copyfile(inputs / "tree.json", inputs / "links.json")
    (inputs / "assets.json").write_bytes(encode(Assets()))
    for reader in (BareFacts, MjlabReader):
        step = reader(robot="robot", options={"feet": {"links": "leg"}})
        assert run_step(step, inputs, tmp_path / step.format_id) == []


def with_heels(robot: TinyRobot) -> TinyRobot:
    """Every foot has a second link, which fixed joints hold at the same calf."""
    foot = next(s for s in robot.shapes.shapes if s.name == "FR_foot_collision")
    places = {frame.name: frame.X_body_frame for frame in robot.tree.frames}
    up = Pose((0.0, 0.0, 0.02))
    frames = tuple(Frame(f"{leg}_heel", f"{leg}_calf", places[f"{leg}_foot"] @ up) for leg in LEGS)
    more = tuple(
        replace(foot, name=f"{leg}_heel_collision", link=f"{leg}_heel", geometry=Sphere(0.01))
        for leg in LEGS
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


def test_an_arm_whose_base_weighs_and_is_called_world_builds_for_mjlab(tmp_path: Path):
    """MuJoCo keeps that name for itself: the module names the body as the bare MJCF does."""
    robot = pendulum()
    base, arm = robot.tree.bodies
    tree = replace(
        robot.tree,
        bodies=(replace(base, name="world", inertial=arm.inertial), arm),
        joints=(replace(robot.tree.joints[0], parent="world"),),
    )
    shapes = replace(robot.shapes, shapes=tuple(s for s in robot.shapes.shapes if s.link == "arm"))
    ranges = {
        "links": {"world": {"density": [0.5, 2]}},
        "payloads": [{"link": "world", "mass": [0, 1], "size": [0.2, 0.2, 0.2]}],
    }
    randomize = Randomize.model_validate(ranges)
    target = Mjlab(robot="robot", randomize=randomize)
    robot = replace(robot, links=tree, tree=tree, shapes=shapes)
    inputs = check_inputs(tmp_path, robot, target, "mjlab")
    assert evaluate(inputs, tmp_path / "out") == []
    reader = MjlabReader(robot="robot", options={"randomize": randomize.model_dump()})
    assert run_step(reader, inputs, tmp_path / "proof") == []


def test_a_floating_robot_without_keyframes_is_told_to_add_one(tmp_path: Path):
    robot = with_control(tiny_quadruped(), keyframes=())
    inputs = check_inputs(tmp_path, robot, MJLAB, "mjlab")
    (finding,) = run_step(MjlabContract(robot="robot"), inputs, tmp_path / "out")
    assert finding.rule == "mjlab.buried"
    assert "home" in finding.hint
