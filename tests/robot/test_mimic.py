"""Mimic joints follow, and robots start at home or as near to 0 as they may stand."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from tiny import tiny_quadruped, with_control, with_mimic

from assetbuild.robot.initial import initial_pose
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Body, Joint, Limits, Mimic, Tree
from assetbuild.simulators.mujoco import at_key


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


BARE = with_control(QUADRUPED, keyframes=())


@pytest.mark.parametrize(
    ("names", "wanted"),
    [(("home", "crouch"), 0), (("crouch", "home"), 1), (("stance", "crouch"), 0)],
)
def test_a_robot_starts_at_home_else_at_its_first_keyframe(names: tuple[str, str], wanted: int):
    keys = zip(QUADRUPED.control.keyframes, names, strict=True)
    keyframes = tuple(replace(key, name=name) for key, name in keys)
    control = replace(QUADRUPED.control, keyframes=keyframes)
    assert initial_pose(QUADRUPED.tree, control) == keyframes[wanted]


def test_without_keyframes_joints_are_as_near_to_zero_as_they_may_be_and_mimics_follow():
    robot = with_mimic(BARE, "FL_calf_joint", "FR_calf_joint", 0.5, -1.0)
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
    start = initial_pose(tree, BARE.control)
    assert {value for _, value in start.joints} == {0.0}


def test_mujoco_starts_a_foreign_model_without_keyframes_inside_its_limits():
    xml = """<mujoco><worldbody><body><geom size="0.1"/><joint name="knee" range="-115 -29"/>
      <body><geom size="0.1"/><joint name="toe"/></body></body></worldbody>
      <equality><joint joint1="toe" joint2="knee" polycoef="0.1 2 0 0 0"/></equality></mujoco>"""
    data = at_key(mujoco.MjModel.from_xml_string(xml))
    knee = np.radians(-29.0)
    assert data.joint("knee").qpos[0] == pytest.approx(knee)
    assert data.joint("toe").qpos[0] == pytest.approx(0.1 + 2.0 * knee)
