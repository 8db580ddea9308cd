"""Mass matrix and gravity are MuJoCo's; holding torques balance; gains follow from them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from tiny import (
    TinyRobot,
    ball_inertial,
    examples,
    pendulum,
    robots,
    run_step,
    standing_height,
    tiny_quadruped,
    write_robot_ports,
)

from assetbuild.robot.dynamics import dynamics, holding_torques
from assetbuild.robot.model import Body, Mimic
from assetbuild.robot.pose import Pose
from assetbuild.simulators.mujoco import mass_matrix
from assetbuild.targets.mjcf import Mjcf


def compiled(robot: TinyRobot, folder: Path) -> tuple[mujoco.MjModel, mujoco.MjData]:
    write_robot_ports(folder / "in", robot)
    run_step(Mjcf(robot="robot"), folder / "in", folder / "out")
    model = mujoco.MjModel.from_xml_path(str(folder / "out/mjcf/robot.xml"))
    return model, mujoco.MjData(model)


def armatures(robot: TinyRobot) -> dict[str, float]:
    return {a.joint: a.armature for a in robot.control.actuators}


@settings(max_examples=examples(40), deadline=None)
@given(robots())
def test_the_mass_matrix_of_any_tree_is_mujocos(robot: TinyRobot) -> None:
    with TemporaryDirectory() as folder:
        model, data = compiled(robot, Path(folder))
    q = {j.name: 0.1 + 0.2 * i for i, j in enumerate(robot.tree.moving_joints)}
    for name, value in q.items():
        data.qpos[model.joint(name).qposadr[0]] = value
    if robot.tree.base == "floating":
        data.qpos[:7] = (0, 0, 0, 1, 0, 0, 0)
    mujoco.mj_forward(model, data)
    ours = dynamics(robot.tree, q, armatures(robot))
    columns = list(range(ours.free)) + [int(model.joint(n).dofadr[0]) for n in ours.joints]
    theirs = mass_matrix(model, data)[np.ix_(columns, columns)]
    assert np.allclose(ours.mass, theirs, rtol=0, atol=1e-12 * np.abs(theirs).max(initial=1.0))
    bias = data.qfrc_bias[columns]
    assert np.allclose(ours.gravity, bias, rtol=0, atol=1e-10 * np.abs(bias).max(initial=1.0))


def test_a_pendulum_has_the_inertia_of_a_rod_about_its_end() -> None:
    found = dynamics(pendulum().tree, {"swing_joint": 0.5}, {"swing_joint": 0.25})
    rod = (0.02**2 + 0.5**2) / 12 + 0.25**2
    assert found.effective_inertia["swing_joint"] == pytest.approx(rod + 0.25)
    torque, left = holding_torques(found, ())
    assert torque["swing_joint"] == pytest.approx(9.81 * 0.25 * math.sin(0.5))
    assert left == 0.0


def test_four_equal_legs_share_the_weight() -> None:
    robot = tiny_quadruped()
    q = dict(robot.control.keyframes[0].joints)
    base = Pose((0.0, 0.0, standing_height(0.8)))
    found = dynamics(robot.tree, q, armatures(robot), base=base)
    feet = []
    for leg in ("FR", "FL", "RR", "RL"):
        body, X_body_foot = robot.tree.placement(f"{leg}_foot")
        feet.append((body, found.motions[body].pose.apply(X_body_foot.xyz)))
    torque, left = holding_torques(found, feet)
    assert left == pytest.approx(0.0, abs=1e-6)
    calves = [abs(torque[f"{leg}_calf_joint"]) for leg in ("FR", "FL", "RR", "RL")]
    # Left equals right but for the IMU of 10 g; a calf carries its share of the weight over the
    # lever, less what hangs below the knee.
    assert calves[0::2] == pytest.approx(calves[1::2], rel=0.03)
    total = sum(b.inertial.mass_kg for b in robot.tree.bodies if b.inertial)
    lever = 0.2 * math.sin(0.8)
    assert sum(calves) == pytest.approx((total - 4 * 0.15) * 9.81 * lever, rel=0.03)


@pytest.mark.parametrize("apart", [1e-9, 1e-12, 0.0])
def test_feet_that_stand_on_one_line_bear_no_more_than_the_weight(apart: float) -> None:
    """A singular pose: to balance the moment such feet would have to pull at the floor, hard."""
    robot = tiny_quadruped()
    found = dynamics(robot.tree, {}, armatures(robot), base=Pose((0.0, 0.0, standing_height(0.0))))
    weight = 9.81 * sum(b.inertial.mass_kg for b in robot.tree.bodies if b.inertial)
    feet = [
        (robot.tree.placement(f"{leg}_foot")[0],
         np.array([0.02 + apart * index, 0.0, 0.0]))
        for index, leg in enumerate(("FR", "FL", "RR", "RL"))
    ]  # fmt: skip
    torque, left = holding_torques(found, feet)
    assert max(map(abs, torque.values())) < 1.0 * weight
    assert left < 0.2


def test_without_feet_nothing_holds_the_base() -> None:
    robot = tiny_quadruped()
    assert holding_torques(dynamics(robot.tree, {}, {}), ())[1] == pytest.approx(1.0)


def test_a_mimic_joint_moves_with_its_leader() -> None:
    """A rotor that mimics with -9 adds 81 times its inertia."""
    arm = pendulum().tree
    hinge = arm.joints[0]
    rotor = replace(hinge, name="rotor", child="rotor", mimic=Mimic("swing_joint", -9.0))
    small = Body("rotor", ball_inertial(0.1, 0.01))
    both = replace(arm, bodies=(*arm.bodies, small), joints=(hinge, rotor))
    moment = 0.4 * 0.1 * 0.01**2
    alone, geared = dynamics(arm, {}, {}), dynamics(both, {}, {})
    assert geared.joints == ("swing_joint",)
    assert geared.mass[0, 0] - alone.mass[0, 0] == pytest.approx(81 * moment)
