"""Everything that a format goes without is reported once, and what that is worth."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
from tiny import TinyRobot, pendulum, tiny_quadruped, with_mimic

from assetbuild.facts.reader import Lost, losses
from assetbuild.facts.readers.urdf import UrdfFacts
from assetbuild.facts.readers.usd import UsdReader
from assetbuild.facts.reference import Assets, Reference, robot_table
from assetbuild.facts.table import Table
from assetbuild.robot.model import Camera, Control, Keyframe, Place, Sensor
from assetbuild.robot.pose import IDENTITY
from assetbuild.robot.shapes import Shapes


def table(robot: TinyRobot, control: Control) -> Table:
    """All facts but those of the shapes."""
    return robot_table(Reference(robot.tree, robot.tree, Shapes(), control, Assets(), {}))


SENSING = Control(
    sensors=(
        Sensor("gyro", "gyro", Place("frame", "arm")),
        Sensor("push", "touch", Place("frame", "arm")),
    ),
    cameras=(Camera("eye", "arm", IDENTITY), Camera("chase", None, IDENTITY, tracking="trackcom")),
    keyframes=(Keyframe("home", (("swing_joint", 0.1),)), Keyframe("up", (("swing_joint", 3.0),))),
)


@pytest.mark.parametrize(
    ("control", "urdf", "usd"),
    [
        (Control(), {"simulation": 1}, {}),
        (SENSING, {"sensor": 2, "camera": 2, "keyframe": 2, "simulation": 1},
         {"sensor": 2, "camera": 1}),
        (pendulum().control, {"joint": 1, "keyframe": 1, "simulation": 1}, {}),
    ],
    ids=["nothing beyond the tree", "senses and poses", "a drive and a pose"],
)  # fmt: skip
def test_what_a_format_goes_without_is_counted(
    control: Control, urdf: Mapping[str, int], usd: Mapping[str, int]
):
    """The expected numbers are the robot's own: how many sensors, cameras and poses it states."""
    facts = table(pendulum(), control)
    for reader, expected in ((UrdfFacts, urdf), (UsdReader, usd)):
        found = list(losses(facts, reader.form, "it", reader.lacks, simulated=reader.simulated))
        assert [(f.rule, f.severity, f.data) for f in found] == (
            [(f"lost.{reader.form}", "info", expected)] if expected else []
        )


@pytest.mark.parametrize(
    ("lacks", "simulated", "severity"),
    [
        ({"joint mimics": Lost("none")}, True, "error"),
        ({"joint mimics": Lost("none")}, False, "warning"),
        ({"joint upper": Lost("none")}, True, "error"),
        ({"joint kp": Lost("none")}, True, "info"),
        ({"joint mimics": "in other words"}, True, None),
        ({"joint": Lost("none")}, True, "error"),
        ({}, True, None),
    ],
)
def test_a_lost_motion_is_an_error_where_robots_are_simulated(
    lacks: Mapping[str, str], simulated: bool, severity: str | None
):
    robot = with_mimic(tiny_quadruped(), "FL_hip_joint", "FR_hip_joint", -1.0, 0.1)
    found = list(losses(table(robot, robot.control), "x", "an X", lacks, simulated=simulated))
    assert [(f.rule, f.severity) for f in found] == ([("lost.x", severity)] if severity else [])
