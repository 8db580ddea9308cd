"""An arm on a wall or a ceiling: every format holds its root there, every check sees it lost."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from pxr import Gf, Usd
from tiny import TinyRobot, check_inputs, pendulum, run_step, spoil_stage

from assetbuild.checks.urdf_kinematics import UrdfKinematics
from assetbuild.findings import Finding
from assetbuild.robot.dynamics import dynamics
from assetbuild.robot.pose import IDENTITY, Pose, normalised_quat
from assetbuild.robot.tree import held_by_world
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.urdf import Urdf
from assetbuild.targets.usd import Usd as UsdTarget

ON_THE_WALL = Pose((0.5, -0.2, 1.5), normalised_quat((1.0, 0.0, 1.0, 0.0)))
"""A quarter turn about y: the pendulum's rest, its -z, points along the world's -x."""


def hung(place: Pose = ON_THE_WALL) -> TinyRobot:
    robot = pendulum()
    tree = replace(robot.tree, X_world_root=place)
    return replace(robot, tree=tree, links=tree)


# --- what is written ----------------------------------------------------------------------------


def test_gravity_pulls_where_the_arm_hangs(tmp_path: Path) -> None:
    """1 kg, 0.25 m beside the hinge: m g l, in our own dynamics and in MuJoCo."""
    robot = hung()
    inputs = check_inputs(tmp_path, robot, Mjcf(robot="robot"), "mjcf")
    model = mujoco.MjModel.from_xml_path(str(inputs / "mjcf/robot.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert abs(data.qfrc_bias[0]) == pytest.approx(9.81 * 0.25)
    held = dynamics(robot.tree, {}, {}).gravity
    assert held == pytest.approx(data.qfrc_bias)
    assert dynamics(pendulum().tree, {}, {}).gravity == pytest.approx([0.0])


def test_the_robots_own_prim_holds_it_in_usd_and_the_link_stays_in_its_origin(
    tmp_path: Path,
) -> None:
    """Isaac Lab replaces the pose of that prim, and at a reset that of the root link."""
    inputs = check_inputs(tmp_path, hung(), UsdTarget(robot="robot"), "usd")
    stage = Usd.Stage.Open(str(inputs / "usd/robot.usda"))
    top = np.array(stage.GetPrimAtPath("/robot").GetAttribute("xformOp:translate").Get())
    assert top == pytest.approx(ON_THE_WALL.xyz)
    link = np.array(stage.GetPrimAtPath("/robot/base").GetAttribute("xformOp:translate").Get())
    assert link == pytest.approx((0.0, 0.0, 0.0))
    stage = Usd.Stage.Open(str(inputs / "usd/scene.usda"))
    prim = stage.GetPrimAtPath("/World/robot")
    assert np.array(prim.GetAttribute("xformOp:translate").Get()) == pytest.approx(ON_THE_WALL.xyz)


def test_in_urdf_a_fixed_joint_holds_it_to_a_link_called_world(tmp_path: Path) -> None:
    robot = hung()
    inputs = check_inputs(tmp_path, robot, Urdf(robot="bot"), "urdf")
    assert run_step(UrdfKinematics(robot="bot"), inputs, tmp_path / "out") == []
    text = (inputs / "urdf/bot.urdf").read_text()
    assert text.index('<link name="world" />') < text.index('<link name="base"')
    (told,) = [f for f in run_step(Urdf(robot="bot"), inputs, tmp_path / "again")
               if f.rule == "urdf.world"]  # fmt: skip
    assert "(0.5, -0.2, 1.5) m" in told.message


def test_a_robot_in_the_origin_gets_no_world_and_names_never_clash() -> None:
    robot = pendulum()
    assert held_by_world(robot.tree) is robot.tree
    named = replace(hung().tree, bodies=(replace(robot.tree.bodies[0], name="world"),
                                         robot.tree.bodies[1]))  # fmt: skip
    assert held_by_world(named).root == "world_"


# --- in PhysX -----------------------------------------------------------------------------------


def read_back(robot: TinyRobot, folder: Path, place: Pose = ON_THE_WALL) -> list[Finding]:
    """place: written over the robot's own prim."""
    pytest.importorskip("ovphysx", reason="needs the extra `physx`")
    from assetbuild.checks.physx_readback import PhysxReadback

    def move(stage: Usd.Stage) -> None:
        prim = stage.GetPrimAtPath("/robot")
        prim.GetAttribute("xformOp:translate").Set(Gf.Vec3d(*place.xyz))
        prim.GetAttribute("xformOp:orient").Set(Gf.Quatd(*place.quat))

    inputs = check_inputs(folder, robot, UsdTarget(robot="robot"), "usd")
    spoil_stage(inputs / "usd/robot.usda", move)
    return run_step(PhysxReadback(robot="robot", seconds=0.1), inputs, folder / "out")


def test_a_root_lost_in_physx_is_found(tmp_path: Path) -> None:
    assert read_back(hung(), tmp_path / "same") == []
    (found,) = read_back(hung(), tmp_path / "lost", IDENTITY)
    assert (found.rule, found.severity) == ("equal.physx.base_pose", "error")
    assert found.data["found"] == (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
