"""The robot is stored in canonical bytes, and read from the files of a folder."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from random_robots import robots
from tiny import TinyRobot, pendulum, tiny_quadruped

from assetbuild.robot.codec import decode, encode
from assetbuild.robot.files import RobotFiles, SourceControl
from assetbuild.robot.model import Body, Control, Inertial, Tree
from assetbuild.robot.shapes import Shapes


@given(robots())
def test_random_robots_round_trip(robot: TinyRobot):
    assert decode(Tree, encode(robot.tree)) == robot.tree
    assert decode(Control, encode(robot.control)) == robot.control


@pytest.mark.parametrize("robot", [tiny_quadruped(), pendulum()])
def test_shapes_round_trip(robot: TinyRobot):
    assert decode(Shapes, encode(robot.shapes)) == robot.shapes


def test_floats_keep_every_bit():
    body = Body("a", Inertial(0.1 + 0.2, (5e-324, 1e308, 1 / 3), (1.0,) * 6))
    assert decode(Body, encode(body)) == body


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_what_is_not_a_number_is_not_stored(value: float):
    with pytest.raises(ValueError, match="JSON"):
        encode(Inertial(value, (0.0, 0.0, 0.0), (1.0,) * 6))


def test_a_robot_of_an_earlier_version_lacks_fields_that_came_later():
    control = json.loads(encode(tiny_quadruped().control))
    for actuator in control["actuators"]:
        del actuator["stall"]
    assert decode(Control, json.dumps(control).encode()) == tiny_quadruped().control


@pytest.mark.parametrize(
    "data",
    [b"", b"[]", b"null", b'{"name": 3, "inertial": null}', b'{"name": "a"}', b'{"name": true}'],
)
def test_foreign_bytes_are_refused(data: bytes):
    with pytest.raises(ValueError, match="not a stored Body"):
        decode(Body, data)


TREE = Tree("tiny", "fixed", (Body("base"),), ())


def test_only_what_is_asked_for_must_be_there(tmp_path: Path):
    (tmp_path / "tree.json").write_bytes(encode(TREE))
    robot = RobotFiles(tmp_path)
    assert robot.tree == TREE
    with pytest.raises(FileNotFoundError):
        _ = robot.control


def test_a_source_may_say_nothing_of_drives(tmp_path: Path):
    assert RobotFiles(tmp_path).source_control is None
    said = SourceControl(Control(), ("base",))
    (tmp_path / "source_control.json").write_bytes(encode(said))
    assert RobotFiles(tmp_path).source_control == said
