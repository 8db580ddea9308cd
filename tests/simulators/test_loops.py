"""Swings of a robot with loops begin where all of these are closed."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import pytest
from tiny import four_bar

from assetbuild.checks.loops import Loops
from assetbuild.robot.closure import close, gaps
from assetbuild.robot.model import Keyframe
from assetbuild.robot.pose import Pose
from assetbuild.simulators.experiments import sine_of
from assetbuild.simulators.loops import LoopSwing, about_closed, trial

BAR = four_bar()


def test_a_middle_that_was_moved_off_a_stop_closes_the_loop_again():
    start = {"crank_joint": 2.9, "coupler_joint": 0.0, "rocker_joint": 0.0}
    found = close(BAR.tree, BAR.control.loops, start, ("coupler_joint", "rocker_joint"))
    made = sine_of(BAR.tree, BAR.control, found.positions, 1.0, 3.0)
    assert gaps(BAR.tree, BAR.control.loops, made.middle)["coupler_loop"] > 1e-3
    swung = about_closed(BAR.tree, BAR.control, made, found.positions)
    assert gaps(BAR.tree, BAR.control.loops, swung.middle)["coupler_loop"] < 1e-9
    assert swung.middle["crank_joint"] == made.middle["crank_joint"] and swung.swing == made.swing


@pytest.mark.parametrize(("kind", "rules"), [("weld", ["loop.rigid"]), ("connect", [])])
def test_a_loop_that_leaves_no_motion_is_tried_under_gravity_alone(
    kind: Literal["weld", "connect"], rules: list[str]
):
    """A weld takes three motions of the plane from three hinges. The rocker stands at 0.1 m: crank,
    ground and what the coupler is longer than the rocker are a triangle, 0.1, 0.1 and 0.05 m."""
    bar = four_bar(kind)
    *others, rocker = bar.tree.joints
    near = replace(rocker, X_parent_joint=Pose((0.1, 0.0, 0.0)))
    tree, loops = replace(bar.tree, joints=(*others, near)), bar.control.loops
    start = {"crank_joint": 2 * math.asin(0.25), "coupler_joint": 1.0, "rocker_joint": 1.5}
    found = close(tree, loops, start, start)
    assert found.closed
    if kind == "weld":
        assert abs(found.positions["crank_joint"]) == pytest.approx(2 * math.asin(0.25))
    home = Keyframe("home", tuple(found.positions.items()))
    asked = trial(tree, replace(bar.control, keyframes=(home,)), LoopSwing())
    assert asked.sine is not None
    told = Loops(robot="r").judged(asked.sine, {"coupler_loop": 0.0})
    assert [finding.rule for finding in told] == rules
