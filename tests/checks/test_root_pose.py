"""An arm on a wall or a ceiling: every format holds its root there, every check sees it lost."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from pxr import Gf, Usd
from tiny import TinyRobot, check_inputs, pendulum, run_step, tiny_quadruped

from assetbuild.facts.readers.urdf import UrdfFacts
from assetbuild.findings import Finding
from assetbuild.robot.dynamics import dynamics
from assetbuild.robot.pose import IDENTITY, Pose, normalised_quat
from assetbuild.robot.tree import held_by_world
from assetbuild.simulators.experiments import Experiment, Setting
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
    found = run_step(UrdfFacts(robot="bot"), inputs, tmp_path / "out")
    assert [f.rule for f in found] == ["lost.urdf"]
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


def read_back(robot: TinyRobot, folder: Path, place: Pose | None = None) -> list[Finding]:
    """place: written over the robot's own prim."""
    pytest.importorskip("ovphysx", reason="needs the extra `physx`")
    from assetbuild.checks.physx_readback import PhysxReadback

    inputs = check_inputs(folder, robot, UsdTarget(robot="robot"), "usd")
    if place is not None:
        stage = Usd.Stage.Open(str(inputs / "usd/robot.usda"))
        prim = stage.GetPrimAtPath("/robot")
        prim.GetAttribute("xformOp:translate").Set(Gf.Vec3d(*place.xyz))
        prim.GetAttribute("xformOp:orient").Set(Gf.Quatd(*place.quat))
        stage.Save()
        del stage
    return run_step(PhysxReadback(robot="robot", seconds=0.1), inputs, folder / "out")


def test_physx_holds_it_where_it_stands(tmp_path: Path) -> None:
    assert read_back(hung(), tmp_path) == []


def test_a_root_lost_in_physx_is_found(tmp_path: Path) -> None:
    (found,) = read_back(hung(), tmp_path, IDENTITY)
    assert (found.rule, found.severity) == ("equal.physx.base_pose", "error")
    assert found.data["found"] == (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def test_physx_and_mujoco_fall_alike_from_the_wall(tmp_path: Path) -> None:
    """The drop of 0.2 s from rest, beside the motion of a robot whose pose was lost: none."""
    pytest.importorskip("ovphysx", reason="needs the extra `physx`")
    from assetbuild.simulators import physx

    inputs = check_inputs(tmp_path, hung(), UsdTarget(robot="robot"), "usd")
    setting = Setting(0.001, (0.0, 0.0, -9.81), contacts=False)
    fall = Experiment("fall", setting, steps=200, every=200)
    done = physx.perform(inputs / "usd/robot.usda", (fall,))["fall"]
    assert done.motion is not None
    other = check_inputs(tmp_path / "m", hung(), Mjcf(robot="robot"), "mjcf")
    model = mujoco.MjModel.from_xml_path(str(other / "mjcf/robot.xml"))
    model.opt.timestep = 0.001
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 200)
    assert abs(data.qpos[0]) > 0.3
    assert done.motion.joints["swing_joint"][-1] == pytest.approx(data.qpos[0], rel=0.01)


def test_a_floating_robot_has_no_place_of_its_own() -> None:
    assert tiny_quadruped().tree.X_world_root == IDENTITY
