"""A loop that is open with all joints at 0 is one that not every reader of the MJCF holds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from tiny import TinyRobot, four_bar, run_step, write_robot_ports

from assetbuild.robot.model import LoopEnd
from assetbuild.robot.pose import Pose
from assetbuild.targets.mjcf import Mjcf


def rules_of(robot: TinyRobot, folder: Path) -> set[str]:
    inputs = write_robot_ports(folder / "in", robot)
    return {finding.rule for finding in run_step(Mjcf(robot="bot"), inputs, folder)}


# All bars lie along x: 0.1 + 0.2 on the coupler's side, 0.2 on the rocker's.
@pytest.mark.parametrize(("rocker", "told"), [(0.15, True), (0.1, False)])
def test_a_loop_that_is_open_at_zero_is_a_warning(rocker: float, told: bool, tmp_path: Path):
    robot = four_bar()
    end = LoopEnd("rocker", Pose((rocker, 0.0, 0.0)))
    loop = replace(robot.control.loops[0], b=end)
    robot = replace(robot, control=replace(robot.control, loops=(loop,)))
    assert ("mjcf.loop_at_zero" in rules_of(robot, tmp_path)) == told
