"""A camera of the USD sees what the MJCF's does: MuJoCo and USD's own library are the readers."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom
from tiny import TinyRobot, pendulum, run_step, tiny_quadruped, write_robot_ports

from assetbuild.robot.model import Camera
from assetbuild.robot.pose import IDENTITY, Pose, quat_of_rpy
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.usd import Usd as UsdTarget

TURNED = Pose((0.1, -0.2, 0.3), quat_of_rpy(0.3, -0.4, 2.0))


def seen(robot: TinyRobot, *cameras: Camera) -> TinyRobot:
    return replace(robot, control=replace(robot.control, cameras=cameras))


def held(robot: TinyRobot) -> TinyRobot:
    """Its root hangs turned in the world."""
    tree = replace(robot.tree, X_world_root=TURNED)
    return replace(robot, tree=tree, links=replace(robot.links, X_world_root=TURNED))


ROBOTS = {
    "on a body": seen(tiny_quadruped(), Camera("eye", "trunk", TURNED, math.radians(58.0))),
    "on a link that was merged": seen(tiny_quadruped(), Camera("eye", "imu", TURNED, 1.2)),
    "two, wide and tall": seen(
        tiny_quadruped(),
        Camera("wide", "trunk", IDENTITY, 0.5, (1280, 720)),
        Camera("tall", "FR_calf", TURNED, 2.5, (480, 640)),
    ),
    "in the world": seen(pendulum(), Camera("eye", None, TURNED, 0.8)),
    "in the world of a root that hangs turned": seen(held(pendulum()), Camera("a", None, TURNED)),
    "named as a link": seen(tiny_quadruped(), Camera("imu", "imu", TURNED)),
    "with a name that USD does not allow": seen(pendulum(), Camera("my eye/1", "arm", TURNED)),
}


@pytest.mark.parametrize("case", ROBOTS)
def test_a_camera_sees_what_mujoco_s_does(case: str, tmp_path: Path):
    robot = ROBOTS[case]
    inputs = write_robot_ports(tmp_path / "in", robot)
    for target, name in ((Mjcf(robot="robot"), "mjcf"), (UsdTarget(robot="robot"), "usd")):
        run_step(target, inputs, tmp_path / name)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "mjcf/mjcf/robot.xml"))
    stage = Usd.Stage.Open(str(tmp_path / "usd/usd/robot.usda"))
    prims = {
        prim.GetMetadata("displayName") or prim.GetName(): UsdGeom.Camera(prim)
        for prim in stage.Traverse()
        if prim.IsA(UsdGeom.Camera)
    }
    assert set(prims) == {camera.name for camera in robot.control.cameras}
    robot_prim = stage.GetDefaultPrim()
    cache = UsdGeom.XformCache()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    for camera in robot.control.cameras:
        index = model.camera(camera.name).id
        prim = prims[camera.name].GetPrim()
        body = prim.GetParent()
        if body == robot_prim:
            theirs, turn = data.cam_xpos[index], data.cam_xmat[index]
            matrix = cache.GetLocalToWorldTransform(prim)
        else:
            turn = np.zeros(9)
            mujoco.mju_quat2Mat(turn, model.cam_quat[index])
            theirs = model.cam_pos[index]
            matrix = cache.ComputeRelativeTransform(prim, body)[0]
            assert body.GetName() == model.body(model.cam_bodyid[index]).name
        ours = np.array(matrix).T
        assert np.allclose(ours[:3, 3], theirs, atol=1e-9)
        assert np.allclose(ours[:3, :3], turn.reshape(3, 3), atol=1e-9)
        lens = prims[camera.name].GetCamera(Usd.TimeCode.Default())
        angle = lens.GetFieldOfView(Gf.Camera.FOVVertical)
        assert angle == pytest.approx(model.cam_fovy[index], rel=1e-6)
        width, height = camera.resolution
        assert lens.aspectRatio == pytest.approx(width / height, rel=1e-6)
        assert lens.clippingRange.min < 0.1
