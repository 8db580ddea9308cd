"""The MJCF is the robot, says nothing twice, and loads everywhere."""

from __future__ import annotations

import os
import re
import subprocess
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image
from robot_files import compiled, emit
from tiny import TinyRobot, box_inertial, pendulum, tiny_quadruped, with_control

from assetbuild.errors import StepError
from assetbuild.robot.model import Body, Control, Frame, Inertial, Joint, Limits, MjcfOnly, Tree
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Material, Mesh, MeshAsset, Shape, Shapes
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.mjcf.classes import shared_words
from assetbuild.targets.mjcf.xml import number

MJCF = Mjcf(robot="robot")


def write_mjcf(robot: TinyRobot, folder: Path) -> Path:
    emit(MJCF, robot, folder)
    return folder / "out/mjcf"


# --- what MuJoCo reads ----------------------------------------------------------------------


def test_the_recipe_s_friction_acts_though_mujoco_s_floor_is_rougher(tmp_path: Path) -> None:
    model = compiled(tiny_quadruped(), tmp_path, "scene.xml")
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[2] -= 0.001
    mujoco.mj_forward(model, data)
    assert data.ncon == 4
    assert data.contact[0].friction[0] == pytest.approx(0.8)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.591 + 0.089, "0.68"),
        (0.1 + 0.2, "0.3"),
        (0.31679705818189247, "0.31679705818189247"),
        (1.0 + 1e-12, "1.000000000001"),
        (-0.0, "0"),
        (1e-300, "1e-300"),
    ],
)
def test_numbers_lose_rounding_and_nothing_else(value: float, text: str) -> None:
    assert number(value) == text


def test_only_pairs_that_mujoco_does_not_filter_are_excluded(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    assert ("FR_hip", "trunk") in robot.control.excludes
    pairs = (*robot.control.excludes, ("FR_thigh", "trunk"))
    floating = with_control(robot, excludes=pairs)
    text = (write_mjcf(floating, tmp_path / "a") / "robot.xml").read_text()
    excluded = re.findall('<exclude body1="([^"]*)" body2="trunk"/>', text)
    # The hips for a base that a user pins, see below; no calf and its thigh.
    assert excluded == ["FL_hip", "FR_hip", "RL_hip", "RR_hip", "FR_thigh"]
    assert text.count("<exclude ") == 5
    # Bolted down, the trunk is part of the world, whose children MuJoCo does not filter.
    bolted = replace(floating, tree=replace(robot.tree, base="fixed"))
    text = (write_mjcf(bolted, tmp_path / "b") / "robot.xml").read_text()
    assert text.count("<exclude ") == 5


# --- default classes ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "word"),
    [
        (["FR_thigh_joint", "FL_thigh_joint"], "thigh"),
        (["ankle_L_Link", "ankle_R_Link"], "ankle"),
        (["joint_1", "joint_2"], "joint"),
    ],
)
def test_a_class_is_called_what_its_members_share(names: list[str], word: str):
    assert shared_words(names) == word


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e-7, 7.7])
@pytest.mark.parametrize("moments", [(0.3, 0.6, 0.9), (0.9, 0.3, 0.6), (0.1 + 0.2, 0.1, 0.2)])
def test_a_flat_body_compiles_in_spite_of_rounding(
    moments: tuple[float, float, float], scale: float, tmp_path: Path
) -> None:
    """0.3 + 0.6 < 0.9 in doubles, and MuJoCo compares them exactly."""
    x, y, z = (moment * scale for moment in moments)
    robot = tiny_quadruped()
    root = Body(robot.tree.root, Inertial(1.0, (0.0, 0.0, 0.0), (x, y, z, 0.0, 0.0, 0.0)))
    tree = replace(robot.tree, bodies=(root, *robot.tree.bodies[1:]))
    inertia = compiled(replace(robot, tree=tree), tmp_path).body(root.name).inertia
    assert np.allclose(np.sort(inertia), np.sort((x, y, z)), rtol=1e-14, atol=0)


# --- the actuator table ---------------------------------------------------------------------


def test_what_mjcf_cannot_hold_is_said_once_with_a_count(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    outside = tuple(replace(a, model="ideal_pd") for a in robot.control.actuators)
    found = emit(MJCF, with_control(robot, actuators=outside), tmp_path)
    assert [(f.rule, f.severity, f.data["joints"]) for f in found] == [
        ("mjcf.velocity_limit", "info", 12),
        ("mjcf.external_gains", "info", 12),
    ]


# --- trees ----------------------------------------------------------------------------------


def joint_to(kind: str, **changes: object) -> TinyRobot:
    robot = pendulum()
    joint = replace(robot.tree.joints[0], kind=kind, **changes)
    return replace(
        robot, tree=replace(robot.tree, joints=(joint,)), control=Control(), shapes=Shapes()
    )


def test_planar_joint_moves_across_its_normal_and_turns_about_it(tmp_path: Path) -> None:
    robot = joint_to("planar", axis=(1.0, 0.0, 0.0), limits=Limits())
    assert [f.rule for f in emit(MJCF, robot, tmp_path)] == ["mjcf.planar_joint"]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out/mjcf/robot.xml"))
    assert model.nv == 3
    assert np.allclose(model.jnt_axis[2], (1, 0, 0))
    assert np.allclose(model.jnt_axis[:2] @ (1, 0, 0), 0)
    assert np.allclose(np.cross(model.jnt_axis[0], model.jnt_axis[1]), (1, 0, 0))


@pytest.mark.parametrize(
    ("robot", "name", "said"),
    [
        (joint_to("floating", limits=Limits()), "robot",
         "swing_joint: MJCF allows a floating joint on the root"),
        (joint_to("revolute", limits=Limits(1.0, None)), "robot", "only one of lower and upper"),
        (pendulum(), "scene", "no room beside"),
    ],
    ids=["a floating joint", "half a limit", "a robot called scene"],
)  # fmt: skip
def test_what_mjcf_has_no_form_for_is_refused(
    robot: TinyRobot, name: str, said: str, tmp_path: Path
) -> None:
    with pytest.raises(StepError, match=said):
        emit(Mjcf(robot=name), robot, tmp_path)


def test_body_called_world_is_renamed_in_all_that_names_it(tmp_path: Path) -> None:
    robot = pendulum()
    tree = replace(
        robot.tree,
        bodies=(Body("world"), robot.tree.bodies[1]),
        joints=(replace(robot.tree.joints[0], parent="world"),),
    )
    item = MjcfOnly("contact", '<exclude name="no" body1="world" body2="arm"/>')
    robot = with_control(replace(robot, tree=tree), mjcf_only=(item,))
    found = emit(MJCF, robot, tmp_path)
    assert [f.subject for f in found if f.rule == "mjcf.reserved_name"] == ["link world"]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out/mjcf/robot.xml"))
    assert (model.body(1).name, model.nexclude) == ("world_body", 1)


def test_texture_is_copied_with_its_transparency_and_a_missing_one_is_said(tmp_path: Path) -> None:
    """MuJoCo reads three channels of a picture unless its file says four."""
    picture = BytesIO()
    Image.new("RGBA", (2, 2), (255, 0, 0, 40)).save(picture, "PNG")
    skin = (Material("good", texture="skin.png"), Material("lost", texture="lost.png"))
    shapes = Shapes(
        tuple(Shape(m.name, "arm", "visual", Mesh("box"), material=m.name) for m in skin),
        skin,
        (MeshAsset("box", "box.obj", 8, 12),),
    )
    meshes = {"box.obj": tiny_quadruped().meshes["trunk_box.obj"], "skin.png": picture.getvalue()}
    found = emit(MJCF, replace(pendulum(), shapes=shapes, meshes=meshes), tmp_path)
    assert [f.severity for f in found if f.rule == "mjcf.texture"] == ["warning"]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out/mjcf/robot.xml"))
    assert (model.ntex, model.nmat) == (1, 2)
    assert model.tex_data.tolist() == [255, 0, 0, 40] * 4


def test_long_chain_needs_no_recursion(tmp_path: Path) -> None:
    count = 1500
    bodies = tuple(Body(f"b{i}", box_inertial(1.0, (0.1, 0.1, 0.1))) for i in range(count))
    joints = tuple(
        Joint(f"j{i}", "fixed", f"b{i}", f"b{i + 1}", Pose((0.1, 0.0, 0.0)))
        for i in range(count - 1)
    )
    tree = Tree("chain", "fixed", bodies, joints, (Frame("tip", f"b{count - 1}", Pose()),))
    text = (write_mjcf(TinyRobot(tree, tree), tmp_path) / "robot.xml").read_text()
    assert text.count("<body ") == count


LOAD_IN_ANOTHER = """
import sys, warnings, mujoco
said = []
mujoco.set_mju_user_warning(said.append)
warnings.simplefilter("error")
for path in sys.argv[1:]:
    model = mujoco.MjModel.from_xml_path(path)
    print(model.nq, model.nv, model.nu, model.nkey, repr(float(sum(model.body_mass))))
assert not said, said
"""


@pytest.mark.slow
def test_files_load_alike_in_every_supported_mujoco(tmp_path: Path) -> None:
    """ASSETBUILD_MUJOCOS: Python interpreters with other versions of mujoco, colon-separated."""
    pythons = [p for p in os.environ.get("ASSETBUILD_MUJOCOS", "").split(":") if p]
    if not pythons:
        pytest.skip("no other MuJoCo here: set ASSETBUILD_MUJOCOS to their Python interpreters")
    files = []
    for name, robot in (("quadruped", tiny_quadruped()), ("pendulum", pendulum())):
        folder = write_mjcf(robot, tmp_path / name)
        files += [str(folder / "robot.xml"), str(folder / "scene.xml")]
    answers = {
        subprocess.run(
            [python, "-c", LOAD_IN_ANOTHER, *files], capture_output=True, text=True, check=True
        ).stdout
        for python in pythons
    }
    assert len(answers) == 1, answers


def test_the_floor_is_under_a_robot_that_hangs_and_at_0_under_one_that_stands(
    tmp_path: Path,
) -> None:
    arm = pendulum()
    hand = replace(arm.tree, frames=(Frame("tip", arm.tree.root, Pose((0.0, 0.0, -0.2))),))
    robots = {"arm": arm, "hand": replace(arm, tree=hand), "dog": tiny_quadruped()}
    height = {}
    for name, robot in robots.items():
        height[name] = compiled(robot, tmp_path / name, "scene.xml").geom("floor").pos[2]
    assert height["arm"] == height["dog"] == 0.0
    assert height["hand"] < -0.2
