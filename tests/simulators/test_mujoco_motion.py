"""A floating base that is held does not move, and its joints move as on a bolted one."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Literal

import mujoco as engine
import numpy as np
import pytest
from tiny import four_bar, pendulum, run_step, tiny_quadruped, write_robot_ports

from assetbuild.checks.loops import Loops
from assetbuild.robot.closure import close, gaps
from assetbuild.robot.model import Keyframe
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Shape
from assetbuild.simulators import mujoco
from assetbuild.simulators.experiments import Motion, Setting, Sine, sine_of, swing
from assetbuild.simulators.loops import LoopSwing, about_closed, trial
from assetbuild.simulators.mujoco import motion
from assetbuild.targets.mjcf import Mjcf


def swung(path: Path, sine: Sine, step: float) -> Motion:
    asked = swing("swing", Setting(step, (0.0, 0.0, -9.81), contacts=False), sine, 0.0)
    done = motion.perform(path.parent, path.stem, (asked,))["swing"]
    assert done.motion is not None and done.finite
    return done.motion


def test_a_held_base_is_the_bolted_robot(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    home = dict(robot.control.keyframes[0].joints)
    sine = sine_of(robot.tree, robot.control, home, 2.0, 0.5)
    tracks = []
    for base in ("floating", "fixed"):
        tree = replace(robot.tree, base=base)
        keys = tuple(replace(key, base=None) for key in robot.control.keyframes)
        control = robot.control if base == "floating" else replace(robot.control, keyframes=keys)
        bot = replace(robot, tree=tree, links=replace(robot.links, base=base), control=control)
        folder = tmp_path / base
        run_step(Mjcf(robot="r"), write_robot_ports(folder / "in", bot), folder / "out")
        path = folder / "out/mjcf/r.xml"
        assert motion.held_model(path).nv == len(robot.tree.moving_joints)
        tracks.append(swung(path, sine, 0.002))
    held, bolted = tracks
    assert np.abs(held.root).max() == 0.0
    for joint, angles in held.joints.items():
        np.testing.assert_allclose(angles, bolted.joints[joint], rtol=0.0, atol=1e-12)


def test_hips_still_do_not_touch_the_trunk_that_is_held(tmp_path: Path) -> None:
    """MuJoCo lets a body collide with a parent that stands still, not with one that floats."""
    robot = tiny_quadruped()
    fat = Shape("fat", "FR_hip", "collision", Box((1.0, 1.0, 1.0)))
    shapes = replace(robot.shapes, shapes=(*robot.shapes.shapes, fat))
    bot = replace(robot, shapes=shapes)
    run_step(Mjcf(robot="r"), write_robot_ports(tmp_path / "in", bot), tmp_path / "out")
    path = tmp_path / "out/mjcf/r.xml"
    touching = []
    for model in (mujoco.load(path).model, motion.held_model(path)):
        data = engine.MjData(model)
        engine.mj_forward(model, data)
        bodies = (sorted(int(model.geom_bodyid[g]) for g in c.geom) for c in data.contact)
        touching.append({(model.body(a).name, model.body(b).name) for a, b in bodies})
    assert ("trunk", "FR_hip") not in touching[1]
    assert touching[0] == touching[1] != set()


def test_a_drive_of_speeds_follows_the_speed_of_the_sine(tmp_path: Path) -> None:
    """A stiff drive goes as far as the integral of the speed that it is asked for."""
    robot = pendulum()
    drive = replace(robot.control.actuators[0], model="velocity", kp=0.0, kd=500.0, effort=None)
    robot = replace(robot, control=replace(robot.control, actuators=(drive,)))
    sine = sine_of(robot.tree, robot.control, {}, 1.0, 1.0)
    assert sine.speeds == {drive.joint}
    run_step(Mjcf(robot="r"), write_robot_ports(tmp_path / "in", robot), tmp_path / "out")
    moved = swung(tmp_path / "out/mjcf/r.xml", sine, 0.001)
    width = sine.swing[drive.joint]
    wanted = sine.middle[drive.joint] + width * np.sin(2.0 * np.pi * moved.time)
    assert width > 0.0
    np.testing.assert_allclose(moved.joints[drive.joint], wanted, atol=0.05 * width)


def test_a_drive_of_speeds_is_asked_for_no_more_than_its_command_holds() -> None:
    """MuJoCo clips a command beyond `ctrlrange` and PhysX does not: they would part."""
    robot = pendulum()
    drive = replace(robot.control.actuators[0], model="velocity", kp=0.0, kd=5.0, ctrl=(-0.5, 0.8))
    sine = sine_of(robot.tree, replace(robot.control, actuators=(drive,)), {}, 1.0, 1.0)
    assert 0.0 < 2.0 * np.pi * sine.swing[drive.joint] < 0.5


# --- loops ---------------------------------------------------------------------------------------


BAR = four_bar()


def test_a_middle_that_was_moved_off_a_stop_closes_the_loop_again():
    start = {"crank_joint": 2.9, "coupler_joint": 0.0, "rocker_joint": 0.0}
    found = close(BAR.tree, BAR.control.loops, start, ("coupler_joint", "rocker_joint"))
    made = sine_of(BAR.tree, BAR.control, found.positions, 1.0, 3.0)
    assert gaps(BAR.tree, BAR.control.loops, made.middle)["coupler_loop"] > 1e-3
    swung = about_closed(BAR.tree, BAR.control, made, found.positions)
    assert gaps(BAR.tree, BAR.control.loops, swung.middle)["coupler_loop"] < 1e-9
    assert swung.middle["crank_joint"] == made.middle["crank_joint"] and swung.swing == made.swing


@pytest.mark.parametrize(("kind", "rules"), [("weld", ["loop.no_mobility"]), ("connect", [])])
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
    told = Loops(robot="r").evaluate(asked.sine, {"coupler_loop": 0.0})
    assert [finding.rule for finding in told] == rules
