"""Joints of several coordinates become joints of one each, and the robot moves as it did."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from tiny import TinyRobot, box_inertial, run_step, write_robot_ports

from assetbuild.edits.split_joint import SplitJoint
from assetbuild.engine.step import Files
from assetbuild.errors import RecipeError
from assetbuild.robot.model import Body, Control, Joint, JointKind, Tree
from assetbuild.robot.pose import Pose, normalised_quat, vec3
from assetbuild.robot.shapes import Shapes, SourceShapes
from assetbuild.targets.mjcf import Mjcf

TILTED = vec3(np.array([0.3, -0.2, 0.9]) / np.linalg.norm([0.3, -0.2, 0.9]))


def base(kind: JointKind, axis: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Tree:
    """A car on a joint of several coordinates, with an arm."""
    X = Pose((0.1, 0.2, 0.3), normalised_quat((0.9, 0.1, -0.2, 0.3)))
    joints = (
        Joint("base", kind, "floor", "car", X, axis),
        Joint("arm", "continuous", "car", "arm", Pose((0.1, 0.0, 0.2)), (0.0, 1.0, 0.0)),
    )
    bodies = (
        Body("floor"),
        Body("car", box_inertial(10.0, (0.6, 0.4, 0.2), (0.1, 0.05, 0.1))),
        Body("arm", box_inertial(2.0, (0.1, 0.1, 0.5), (0.0, 0.0, 0.25))),
    )
    return Tree("car", "fixed", bodies, joints)


def split(tree: Tree) -> Tree:
    return SplitJoint(joint="base").edit(tree, SourceShapes(), Files(Path(), Path())).tree


def compiled(tree: Tree, folder: Path) -> mujoco.MjModel:
    inputs = write_robot_ports(folder, TinyRobot(tree, tree, Shapes(), Control()))
    run_step(Mjcf(robot="car"), inputs, inputs)
    return mujoco.MjModel.from_xml_path(str(inputs / "mjcf/car.xml"))


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), TILTED])
def test_a_planar_joint_is_what_the_mjcf_made_of_it_before(axis, tmp_path: Path):
    """Names, masses and motion of the two compiled models."""
    before, after = base("planar", axis), split(base("planar", axis))
    one, other = compiled(before, tmp_path / "a"), compiled(after, tmp_path / "b")
    assert [one.joint(i).name for i in range(4)] == ["base_x", "base_y", "base_yaw", "arm"]
    assert [other.joint(i).name for i in range(4)] == ["base_x", "base_y", "base_yaw", "arm"]
    a, b = mujoco.MjData(one), mujoco.MjData(other)
    a.qvel[:] = b.qvel[:] = (1.0, -0.5, 2.0, 0.3)
    for _ in range(200):
        mujoco.mj_step(one, a)
        mujoco.mj_step(other, b)
    assert b.qpos == pytest.approx(a.qpos, rel=1e-9)


@pytest.mark.parametrize("kind", ["ball", "floating"])
def test_the_angles_reach_every_orientation(kind: JointKind, tmp_path: Path):
    """A mass matrix of full rank away from the pose in which two axes are one."""
    model = compiled(split(base(kind)), tmp_path)
    data = mujoco.MjData(model)
    data.qpos[:] = np.random.default_rng(0).uniform(-1.0, 1.0, model.nq)
    mujoco.mj_forward(model, data)
    matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, matrix)
    assert np.linalg.cond(matrix) < 1e5
    assert model.nv == {"ball": 4, "floating": 7}[kind]


def test_what_changes_is_reported():
    done = SplitJoint(joint="base").edit(base("planar"), SourceShapes(), Files(Path(), Path()))
    (finding,) = done.findings
    assert (finding.severity, finding.data["links"]) == ("info", ("base_x_link", "base_y_link"))
    tree = base("ball")
    tree = replace(tree, joints=(replace(tree.joints[0], damping=1.0), tree.joints[1]))
    (finding,) = SplitJoint(joint="base").edit(tree, SourceShapes(), Files(Path(), Path())).findings
    assert finding.severity == "warning"
    assert "damping and friction are left out" in finding.message
    assert "90 degrees" in finding.message


def test_a_hinge_cannot_be_split_nor_a_name_be_taken_twice():
    with pytest.raises(RecipeError, match="`base` is continuous"):
        split(base("continuous"))
    tree = base("planar")
    tree = replace(tree, joints=(tree.joints[0], replace(tree.joints[1], name="base_yaw")))
    with pytest.raises(RecipeError, match="`base_yaw` is the name"):
        split(tree)
