"""A drive of a looped mechanism feels an inertia that depends on the pose."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tiny import four_bar

from assetbuild.init.drives import drive_rows
from assetbuild.robot.closure import close, felt_inertia, held_by, reflected_range
from assetbuild.robot.dynamics import dynamics, holding_torques
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.tree import forward_kinematics

BAR = four_bar("connect")
DRIVEN = next(row.joint for row in BAR.control.actuators if row.model != "passive")
FREE = [joint.name for joint in BAR.tree.moving_joints if joint.name != DRIVEN]


def posed(angle: float) -> dict[str, float]:
    start = dict(initial_pose(BAR.tree, BAR.control).joints) | {DRIVEN: angle}
    found = close(BAR.tree, BAR.control.loops, start, FREE)
    assert found.closed
    return dict(found.positions)


@pytest.mark.parametrize("angle", [0.3, 0.9])
def test_the_inertia_is_twice_the_kinetic_energy_at_one_radian_per_second(angle: float):
    step = 1e-5
    before, after = posed(angle - step), posed(angle + step)
    robot = dynamics(BAR.tree, posed(angle), {})
    speeds = np.zeros(len(robot.mass))
    for name in robot.joints:
        speeds[robot.column(name)] = (after[name] - before[name]) / (2.0 * step)
    energy = 0.5 * float(speeds @ robot.mass @ speeds)
    assert felt_inertia(BAR.control.loops, robot)[DRIVEN] == pytest.approx(2.0 * energy, rel=1e-6)


@pytest.mark.parametrize("angle", [0.3, 0.9])
def test_the_drive_alone_holds_what_gravity_does_along_the_closed_path(angle: float):
    def height(pose: dict[str, float]) -> float:
        """m kg: the sum of each body's mass and the height of its centre."""
        placed = forward_kinematics(BAR.tree, pose)
        heavy = [body for body in BAR.tree.bodies if body.inertial is not None]
        centres = [placed[body.name].apply(body.inertial.com_m)[2] for body in heavy]
        return sum(b.inertial.mass_kg * z for b, z in zip(heavy, centres, strict=True))

    step = 1e-5
    slope = (height(posed(angle + step)) - height(posed(angle - step))) / (2.0 * step)
    robot = dynamics(BAR.tree, posed(angle), {})
    torques, _ = holding_torques(robot, [])
    found = held_by(BAR.control.loops, robot, torques, [DRIVEN])
    assert found == {DRIVEN: pytest.approx(9.81 * slope, rel=1e-6)}


def test_the_gains_that_init_proposes_fit_what_the_drive_moves_with_its_loop_closed():
    home = posed(0.9)
    (row,) = drive_rows(BAR.tree, home, (), loops=BAR.control.loops, passive=FREE)
    closed = felt_inertia(BAR.control.loops, dynamics(BAR.tree, home, {}))[DRIVEN]
    (open_one,) = (r for r in drive_rows(BAR.tree, home, ()) if DRIVEN in r.joints)
    assert row.joints == (DRIVEN,)
    assert row.inertia == pytest.approx(closed)
    assert abs(row.inertia / open_one.inertia - 1.0) > 0.1


def test_a_joint_that_the_loops_lock_feels_no_end_of_inertia():
    (loop,) = BAR.control.loops
    locked = replace(BAR.control, loops=(replace(loop, kind="weld"),))
    robot = dynamics(BAR.tree, posed(0.3), {})
    assert felt_inertia(locked.loops, robot)[DRIVEN] == math.inf


def test_the_range_holds_the_first_pose_and_ends_where_the_loop_opens():
    home = posed(0.3)
    found = reflected_range(BAR.tree, BAR.control, home)[DRIVEN]
    here = felt_inertia(BAR.control.loops, dynamics(BAR.tree, home, {}))[DRIVEN]
    assert found.least <= here * (1 + 1e-9) and here * (1 - 1e-9) <= found.most
    assert found.most > 1.05 * found.least
    assert close(BAR.tree, BAR.control.loops, home | {DRIVEN: found.at_least}, FREE).closed
