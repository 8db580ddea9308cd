"""Limits and couplings hold full effort in MuJoCo, and other engines get the same numbers."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_robots import examples
from robot_files import compiled
from tiny import TinyRobot, pendulum, tiny_quadruped, with_mimic

from assetbuild.robot.model import Control
from assetbuild.robot.softness import (
    USUAL,
    CouplingError,
    LimitError,
    bare_inertia,
    error_at_rest,
    limit_springs,
    soft_couplings,
    soft_limits,
    softness,
)

LIMITS, COUPLINGS = LimitError.model_validate({}), CouplingError.model_validate({})


def stiffened(robot: TinyRobot) -> TinyRobot:
    """The robot as built by a recipe without `limits` and `couplings`."""
    control = replace(
        robot.control,
        soft_limits=tuple(soft_limits(robot.tree, robot.control, LIMITS)),
        soft_couplings=tuple(soft_couplings(robot.tree, robot.control, COUPLINGS)),
    )
    return replace(robot, control=control)


def weightless(robot: TinyRobot, folder: Path) -> mujoco.MjModel:
    model: mujoco.MjModel = compiled(robot, folder)
    model.opt.gravity[:] = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return model


def pushed(model: mujoco.MjModel, joint: str, effort: float) -> np.ndarray:
    """qpos after a slow push at the upper limit; a damper beside it, so that nothing swings."""
    data = mujoco.MjData(model)
    address, dof = model.joint(joint).qposadr[0], model.joint(joint).dofadr[0]
    model.dof_damping[dof] = 2.0 * math.sqrt(effort / model.dof_invweight0[dof])
    data.qpos[address] = model.joint(joint).range[1]
    steps = int(2.0 / model.opt.timestep)
    for step in range(steps):
        data.qfrc_applied[dof] = effort * min(1.0, 2.0 * step / steps)
        mujoco.mj_step(model, data)
    return data.qpos.copy()


@pytest.mark.parametrize("robot", [pendulum(), tiny_quadruped()], ids=["pendulum", "quadruped"])
@pytest.mark.parametrize("stiff", [False, True])
def test_limits_are_as_stiff_as_mujoco_makes_them(
    robot: TinyRobot, stiff: bool, tmp_path: Path
) -> None:
    """MuJoCo's own inverse inertias give k = 1 / (invweight (1 - d) t^2 z^2), c = 2 t z^2 k."""
    robot = stiffened(robot) if stiff else robot
    model = weightless(robot, tmp_path)
    springs = limit_springs(robot.tree, robot.control)
    assert set(springs) == {joint.name for joint in robot.tree.moving_joints}
    for name, (stiffness, damping) in springs.items():
        joint = model.joint(name)
        time, ratio = model.jnt_solref[joint.id]
        soft = model.dof_invweight0[joint.dofadr[0]] * (1.0 - model.jnt_solimp[joint.id, 1])
        assert stiffness == pytest.approx(1.0 / (soft * (time * ratio) ** 2), rel=1e-6)
        assert damping == pytest.approx(2.0 / (soft * time), rel=1e-6)


def test_the_inertia_is_mujocos_own(tmp_path: Path) -> None:
    """`dof_invweight0`, which knows no mimic and no armature of another joint."""
    robot = coupled()
    model = weightless(robot, tmp_path)
    for name, inertia in bare_inertia(robot.tree, robot.control).items():
        dof = model.joint(name).dofadr[0]
        assert inertia == pytest.approx(1.0 / model.dof_invweight0[dof], rel=1e-6)


def one_bar(effort: float, timestep: float = 0.002) -> TinyRobot:
    robot = pendulum()
    joint = robot.tree.moving_joints[0]
    limits = replace(joint.limits, lower=-1.0, upper=1.0, effort=effort)
    tree = replace(robot.tree, joints=(replace(joint, kind="revolute", limits=limits),))
    simulation = robot.control.simulation.model_copy(update={"timestep": timestep})
    return replace(robot, tree=tree, control=Control(simulation=simulation))


@pytest.mark.parametrize("effort", [5.0, 50.0, 500.0])
@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
def test_full_effort_stays_within_the_wish(effort: float, timestep: float, tmp_path: Path) -> None:
    """MuJoCo's steady state at the limit is the error that the formula gives."""
    robot = one_bar(effort, timestep)
    name = robot.tree.moving_joints[0].name
    past = pushed(weightless(stiffened(robot), tmp_path), name, effort)[0] - 1.0
    soft = dict(soft_limits(robot.tree, robot.control, LIMITS)).get(name)
    if soft is not None:
        inertia = bare_inertia(robot.tree, robot.control)[name]
        assert past == pytest.approx(error_at_rest(soft, effort, inertia, timestep), rel=0.02)
    assert past < 1.01 * LIMITS.turn


def coupled() -> TinyRobot:
    """A calf that follows another, of 36 N m."""
    return with_mimic(tiny_quadruped(), "FL_calf_joint", "FR_calf_joint", 1.0, 0.0)


def parted(robot: TinyRobot, folder: Path) -> float:
    """How far the calves part, rad, when all the effort of one works against the other."""
    model = weightless(robot, folder)
    data = mujoco.MjData(model)
    leader, follower = (model.joint(f"{leg}_calf_joint") for leg in ("FR", "FL"))
    for joint in (leader, follower):  # beyond their limits nothing but the coupling would count
        model.jnt_limited[joint.id] = 0
        model.dof_damping[joint.dofadr[0]] = 10.0
    for _ in range(int(2.0 / model.opt.timestep)):
        data.qfrc_applied[leader.dofadr[0]], data.qfrc_applied[follower.dofadr[0]] = 36.0, -36.0
        mujoco.mj_step(model, data)
    return float(data.qpos[leader.qposadr[0]] - data.qpos[follower.qposadr[0]])


def test_followers_stay_with_their_leader(tmp_path: Path) -> None:
    """The error is that of the formula, with MuJoCo's default it would be far larger."""
    robot = coupled()
    ((joint, soft),) = soft_couplings(robot.tree, robot.control, COUPLINGS)
    assert joint == "FL_calf_joint"
    alone = bare_inertia(robot.tree, robot.control)
    both = 1.0 / (1.0 / alone["FL_calf_joint"] + 1.0 / alone["FR_calf_joint"])
    error = error_at_rest(soft, 36.0, both, robot.control.simulation.timestep)
    assert error <= 1.01 * COUPLINGS.turn
    found = parted(stiffened(robot), tmp_path / "stiff")
    assert found == pytest.approx(error, rel=0.05)
    assert parted(robot, tmp_path / "soft") > 3.0 * COUPLINGS.turn


@settings(max_examples=examples(200), deadline=None)
@given(
    force=st.floats(1e-3, 1e4),
    inertia=st.floats(1e-7, 1e2),
    allowed=st.floats(1e-5, 0.1),
    timestep=st.floats(1e-4, 0.02),
)
def test_softness_is_stable_and_as_small_as_the_step_lets_it(
    force: float, inertia: float, allowed: float, timestep: float
) -> None:
    soft = softness(force, inertia, allowed, timestep)
    time, impedance = soft.solref[0], soft.solimp[1]
    assert 0.95 <= impedance <= 0.9999
    assert time >= 2.0 * timestep or soft == USUAL
    if error_at_rest(soft, force, inertia, timestep) > 1.001 * allowed:
        assert (time, impedance) == (2.0 * timestep, 0.9999)
