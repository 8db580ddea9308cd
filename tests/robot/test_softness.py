"""Limits are as stiff for other engines as MuJoCo makes them."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest
from tiny import TinyRobot, check_inputs, pendulum, tiny_quadruped

from assetbuild.robot.softness import limit_springs
from assetbuild.targets.mjcf import Mjcf


@pytest.mark.parametrize("robot", [pendulum(), tiny_quadruped()], ids=["pendulum", "quadruped"])
def test_limits_are_as_stiff_as_mujoco_makes_them(robot: TinyRobot, tmp_path: Path) -> None:
    """MuJoCo's own inverse inertias give k = 1 / (invweight (1 - d) t^2 z^2), c = 2 t z^2 k."""
    inputs = check_inputs(tmp_path, robot, Mjcf(robot="robot"), "mjcf")
    model = mujoco.MjModel.from_xml_path(str(inputs / "mjcf/robot.xml"))
    springs = limit_springs(robot.tree, robot.control)
    assert set(springs) == {joint.name for joint in robot.tree.moving_joints}
    for name, (stiffness, damping) in springs.items():
        joint = model.joint(name)
        time, ratio = model.jnt_solref[joint.id]
        softness = model.dof_invweight0[joint.dofadr[0]] * (1.0 - model.jnt_solimp[joint.id, 1])
        assert stiffness == pytest.approx(1.0 / (softness * (time * ratio) ** 2), rel=1e-6)
        assert damping == pytest.approx(2.0 / (softness * time), rel=1e-6)
