"""Swings of a robot with loops begin where all of these are closed."""

from __future__ import annotations

from tiny import four_bar

from assetbuild.robot.closure import close, gaps
from assetbuild.simulators.experiments import sine_of
from assetbuild.simulators.loop_swing import about_closed

BAR = four_bar()


def test_a_middle_that_was_moved_off_a_stop_closes_the_loop_again():
    start = {"crank_joint": 2.9, "coupler_joint": 0.0, "rocker_joint": 0.0}
    found = close(BAR.tree, BAR.control.loops, start, ("coupler_joint", "rocker_joint"))
    made = sine_of(BAR.tree, BAR.control, found.positions, 1.0, 3.0)
    assert gaps(BAR.tree, BAR.control.loops, made.middle)["coupler_loop"] > 1e-3
    swung = about_closed(BAR.tree, BAR.control, made, found.positions)
    assert gaps(BAR.tree, BAR.control.loops, swung.middle)["coupler_loop"] < 1e-9
    assert swung.middle["crank_joint"] == made.middle["crank_joint"] and swung.swing == made.swing
