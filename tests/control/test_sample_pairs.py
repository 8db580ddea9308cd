"""Pairs that always or never touch, on a robot where both are plain to see."""

from __future__ import annotations

import json
import math

from tiny import TinyRobot, run_step, write_robot_ports

from assetbuild.control.sample_pairs import SamplePairs
from assetbuild.robot.model import Body, Joint, Limits, Tree
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Shape, Shapes, Sphere

HALF_TURN = Limits(-math.pi, math.pi)


def robot() -> TinyRobot:
    """A base; an arm of 1 m that turns; at its tip a ball of 2 m; a box that slides 50 m away.

    The ball's surface passes the base in every pose. A pin on the base, 1 m aside, is met by the
    arm only when it points there. The box is out of reach.
    """
    bodies = ("base", "arm", "ball", "far", "pin")
    joints = (
        Joint("turn", "revolute", "base", "arm", axis=(0, 0, 1), limits=HALF_TURN),
        Joint("tip", "revolute", "arm", "ball", Pose((1, 0, 0)), (0, 0, 1), HALF_TURN),
        Joint("slide", "prismatic", "base", "far", Pose((50, 0, 0)), limits=Limits(-0.1, 0.1)),
        Joint("nod", "revolute", "far", "pin", Pose((-50, 0.9, 0)), (1, 0, 0), Limits(-0.1, 0.1)),
    )
    shapes = (
        Shape("b", "base", "collision", Box((0.2, 0.2, 0.2))),
        Shape("a", "arm", "collision", Box((0.2, 0.1, 0.1)), Pose((0.9, 0, 0))),
        Shape("s", "ball", "collision", Sphere(2.0)),
        Shape("f", "far", "collision", Box((1.0, 1.0, 1.0))),
        Shape("p", "pin", "collision", Sphere(0.1)),
    )
    tree = Tree("r", "fixed", tuple(Body(name) for name in bodies), joints)
    return TinyRobot(tree, tree, Shapes(shapes))


def pairs(tmp_path, samples: int, run: str = "out"):
    folder = write_robot_ports(tmp_path / "in", robot())
    (finding,) = run_step(SamplePairs(samples=samples), folder, tmp_path / run)
    found = json.loads((tmp_path / run / "sampled_pairs.json").read_text())
    return found["always"], found["never"], finding


def test_what_always_and_what_never_touches_is_found(tmp_path):
    always, never, finding = pairs(tmp_path, 200)
    assert ["ball", "base"] in always
    assert ["ball", "pin"] in always  # the pin is less than 2 m from any point of the circle
    assert ["arm", "far"] in never
    assert ["base", "far"] not in always + never  # a joint connects them
    assert not any({"arm", "pin"} == set(pair) for pair in always + never)  # now and then
    assert finding.rule == "exclude.sampled"
    assert finding.data == {"pairs": 6, "always": len(always), "never": len(never)}


def test_the_same_pairs_again(tmp_path):
    assert pairs(tmp_path, 20, "a")[:2] == pairs(tmp_path, 20, "b")[:2]
