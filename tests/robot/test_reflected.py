"""A drive of a looped mechanism feels an inertia that depends on the pose."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tiny import four_bar

from assetbuild.robot.closure import close
from assetbuild.robot.dynamics import dynamics
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.reflected import felt_inertia, reflected_range

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
