"""Mimic joints follow, and robots start at home or as near to 0 as they may stand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from robot_files import check_inputs, run_step
from tiny import TinyRobot, tiny_quadruped, with_mimic

from assetbuild.facts.readers._mjcf import MjcfFacts
from assetbuild.facts.readers._usd import UsdReader, UsdSceneReader
from assetbuild.facts.readers.isaaclab import IsaacLabReader
from assetbuild.facts.readers.mjlab import MjlabReader
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Body, Joint, Limits, Mimic, Tree
from assetbuild.simulators.mujoco import at_key
from assetbuild.targets.isaaclab import IsaacLab
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.mjlab import Mjlab
from assetbuild.targets.usd import Usd


def gripper(*mimics: tuple[str, Mimic | None]) -> Tree:
    joints = tuple(
        Joint(name, "revolute", "palm", f"{name}_link", mimic=mimic) for name, mimic in mimics
    )
    return Tree("gripper", "fixed", (Body("palm"), *(Body(j.child) for j in joints)), joints)


def test_a_chain_of_mimics_follows_to_its_end():
    tree = gripper(("c", Mimic("b", 2.0, 0.5)), ("b", Mimic("a", -1.0)), ("a", None))
    assert with_mimics(tree, {"a": 0.25}) == {"c": 0.0, "b": -0.25, "a": 0.25}


def test_a_circle_is_refused():
    with pytest.raises(ValueError, match="a -> b -> a"):
        with_mimics(gripper(("a", Mimic("b")), ("b", Mimic("a"))), {})


QUADRUPED = tiny_quadruped()
"""Its calves turn from -2.8 to -0.9 rad."""


FORMS = {
    Mjcf(robot="robot"): (MjcfFacts(robot="robot"),),
    Usd(robot="robot"): (UsdReader(robot="robot"), UsdSceneReader(robot="robot")),
    Mjlab(robot="robot"): (MjlabReader(robot="robot"),),
    IsaacLab(robot="robot"): (IsaacLabReader(robot="robot"),),
}
"""Targets, and what reads their files back and compares them with the robot."""


def without_keyframes() -> TinyRobot:
    return replace(QUADRUPED, control=replace(QUADRUPED.control, keyframes=()))


def with_names(*names: str) -> TinyRobot:
    keys = QUADRUPED.control.keyframes
    renamed = tuple(replace(key, name=name) for key, name in zip(keys, names, strict=True))
    return replace(QUADRUPED, control=replace(QUADRUPED.control, keyframes=renamed))


@pytest.mark.parametrize(
    ("names", "wanted"),
    [(("home", "crouch"), 0), (("crouch", "home"), 1), (("stance", "crouch"), 0)],
)
def test_a_robot_starts_at_home_else_at_its_first_keyframe(names: tuple[str, str], wanted: int):
    robot = with_names(*names)
    assert initial_pose(robot.tree, robot.control) == robot.control.keyframes[wanted]


def test_without_keyframes_joints_are_as_near_to_zero_as_they_may_be_and_mimics_follow():
    robot = with_mimic(without_keyframes(), "FL_calf_joint", "FR_calf_joint", 0.5, -1.0)
    start = dict(initial_pose(robot.tree, robot.control).joints)
    assert start["FR_hip_joint"] == 0.0
    assert start["FR_calf_joint"] == -0.9
    assert start["FL_calf_joint"] == pytest.approx(-1.0 - 0.45)


def test_a_joint_that_turns_without_end_starts_at_zero():
    joints = tuple(
        replace(joint, kind="continuous", limits=Limits(1.0, 2.0))
        for joint in QUADRUPED.tree.joints
    )
    tree = replace(QUADRUPED.tree, joints=joints)
    start = initial_pose(tree, without_keyframes().control)
    assert {value for _, value in start.joints} == {0.0}


@pytest.mark.parametrize(
    "robot", [without_keyframes(), with_names("stance", "crouch"), with_names("crouch", "home")]
)
def test_every_form_of_a_robot_starts_in_its_initial_pose(robot: TinyRobot, tmp_path: Path):
    start = dict(initial_pose(robot.tree, robot.control).joints)
    for number, (target, readers) in enumerate(FORMS.items()):
        folder = tmp_path / str(number)
        inputs = check_inputs(folder, robot, target, target.outputs[0].strip("/"))
        for reader in readers:
            found = run_step(reader, inputs, folder / reader.format_id)
            assert found == [], (reader.display_name, found)
    data = at_key(mujoco.MjModel.from_xml_path(str(tmp_path / "0/inputs/mjcf/robot.xml")))
    in_mujoco = {name: float(data.joint(name).qpos[0]) for name in start}
    assert in_mujoco == pytest.approx(start, abs=1e-12)


def test_mujoco_starts_a_foreign_model_without_keyframes_inside_its_limits():
    xml = """<mujoco><worldbody><body><geom size="0.1"/><joint name="knee" range="-115 -29"/>
      <body><geom size="0.1"/><joint name="toe"/></body></body></worldbody>
      <equality><joint joint1="toe" joint2="knee" polycoef="0.1 2 0 0 0"/></equality></mujoco>"""
    data = at_key(mujoco.MjModel.from_xml_string(xml))
    knee = np.radians(-29.0)
    assert data.joint("knee").qpos[0] == pytest.approx(knee)
    assert data.joint("toe").qpos[0] == pytest.approx(0.1 + 2.0 * knee)
