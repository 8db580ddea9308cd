"""Sensors, cameras, surfaces and general actuators stand in the MJCF, and the check reads them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import pytest
from robot_files import check_inputs, compiled, emit, run_step
from tiny import TinyRobot, four_bar, pendulum, tiny_quadruped, with_control

from assetbuild.errors import StepError
from assetbuild.facts.readers._mjcf import MjcfFacts
from assetbuild.pipeline.recipes import whole_model
from assetbuild.robot.model import Camera, Contact, LoopEnd, MjcfOnly, Place, Sensor
from assetbuild.robot.pose import Pose, quat_of_rpy
from assetbuild.targets.mjcf import Mjcf

FOOT = Contact(
    friction=(1.0, 0.01, 0.001),
    condim=6,
    priority=1,
    solref=(0.01, 1.0),
    solimp=(0.9, 0.95, 0.001, 0.5, 2.0),
    margin=0.001,
)
FEET = tuple((f"{leg}_foot_collision", FOOT) for leg in ("FR", "FL", "RR", "RL"))
SENSORS = (
    Sensor("imu_ang_vel", "gyro", Place("frame", "imu"), noise=0.1),
    Sensor("trunk_gyro", "gyro", Place("frame", "trunk")),
    Sensor("up", "framezaxis", Place("frame", "trunk"), Place("frame", "imu")),
    Sensor("root_angmom", "subtreeangmom", Place("body", "trunk")),
    Sensor("hip", "jointpos", Place("joint", "FR_hip_joint"), cutoff=2.0),
    Sensor("hip_torque", "actuatorfrc", Place("actuator", "FR_hip_joint")),
    Sensor("FR_foot_contact", "contact", Place("shape", "FR_foot_collision")),
)
CAMERAS = (
    Camera("front", "imu", Pose((0.1, 0.0, 0.02), quat_of_rpy(1.0, 0.2, -0.4)), 1.2, (320, 240)),
    Camera("room", None, Pose((0.0, -2.0, 1.0)), tracking="trackcom"),
)


def robot_with_all() -> TinyRobot:
    return with_control(tiny_quadruped(), contacts=FEET, sensors=SENSORS, cameras=CAMERAS)


def test_every_sensor_camera_and_surface_is_in_the_compiled_model(tmp_path: Path) -> None:
    inputs = check_inputs(tmp_path, robot_with_all(), Mjcf(robot="robot"), "mjcf")
    assert run_step(MjcfFacts(robot="robot"), inputs, tmp_path / "out") == []
    text = (inputs / "mjcf/robot.xml").read_text()
    model = mujoco.MjModel.from_xml_path(str(inputs / "mjcf/robot.xml"))
    assert model.nsensor == len(SENSORS)
    assert text.count("condim") == text.count("solref") == 1, "said once, in the class"
    assert '<default class="foot">' in text
    foot = model.geom("FR_foot_collision")
    assert (foot.condim[0], foot.priority[0], foot.margin[0]) == (6, 1, 0.001)
    assert model.geom("trunk_collision").condim[0] == 3


def test_a_foot_contact_sensor_feels_the_weight(tmp_path: Path) -> None:
    robot = robot_with_all()
    model = compiled(robot, tmp_path, "scene.xml")
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(400):
        mujoco.mj_step(model, data)
    found, *force = data.sensor("FR_foot_contact").data
    weight = 9.81 * sum(b.inertial.mass_kg for b in robot.tree.bodies if b.inertial)
    assert found == 1
    assert abs(force[0]) == pytest.approx(weight / 4, rel=0.25)


def test_a_sensor_without_its_place_is_refused(tmp_path: Path) -> None:
    robot = pendulum()
    drive = replace(robot.control.actuators[0], model="passive")
    sensor = Sensor("t", "actuatorfrc", Place("actuator", "swing_joint"))
    with pytest.raises(StepError, match="sensor t: MJCF has no actuatorfrc"):
        compiled(with_control(robot, actuators=(drive,), sensors=(sensor,)), tmp_path)


def test_the_options_of_the_recipe_are_in_the_file(tmp_path: Path) -> None:
    said = {"solver": "CG", "iterations": 7, "ls_iterations": 9, "cone": "elliptic", "impratio": 3}
    recipe = whole_model().model_validate(
        {"schema": "assetbuild/v1", "robot": "robot", "source": {"path": "p", "urdf": "r"},
         "mjcf": said | {"integrator": "Euler"}}
    )  # fmt: skip
    emit(Mjcf.configure(recipe), tiny_quadruped(), tmp_path)
    option = mujoco.MjModel.from_xml_path(str(tmp_path / "out/mjcf/robot.xml")).opt
    assert (option.iterations, option.ls_iterations, option.impratio) == (7, 9, 3.0)
    assert (option.solver, option.cone, option.integrator) == (1, 1, 0)


def test_materials_that_look_alike_share_one_name(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    grey = robot.shapes.materials[0]
    twin = replace(grey, name="Face636_001")
    shapes = tuple(replace(s, material="Face636_001") if s.name == "imu_visual" else s for s in robot.shapes.shapes)  # fmt: skip # noqa: E501
    alike = replace(robot.shapes, shapes=shapes, materials=(*robot.shapes.materials, twin))
    assert compiled(replace(robot, shapes=alike), tmp_path).nmat == 1


# --- loops ---------------------------------------------------------------------------------------


# All bars lie along x: 0.1 + 0.2 on the coupler's side, 0.2 on the rocker's.
@pytest.mark.parametrize(("rocker", "told"), [(0.15, True), (0.1, False)])
def test_a_loop_that_is_open_at_zero_is_a_warning(rocker: float, told: bool, tmp_path: Path):
    robot = four_bar()
    end = LoopEnd("rocker", Pose((rocker, 0.0, 0.0)))
    loop = replace(robot.control.loops[0], b=end)
    found = emit(Mjcf(robot="robot"), with_control(robot, loops=(loop,)), tmp_path)
    assert ("mjcf.loop_at_zero" in {finding.rule for finding in found}) == told


# --- what only MJCF can say: the whole way from a source is in checks/test_mjcf_source.py -------


@pytest.mark.parametrize(
    ("name", "element"), [("loose", '<freejoint name="loose"/>'), ("", "<freejoint/>")]
)
def test_a_free_joint_is_called_as_in_the_source(name: str, element: str, tmp_path: Path):
    called = MjcfOnly("freejoint", f'<freejoint name="{name}"/>')
    emit(Mjcf(robot="robot"), with_control(tiny_quadruped(), mjcf_only=(called,)), tmp_path)
    assert element in (tmp_path / "out/mjcf/robot.xml").read_text()
