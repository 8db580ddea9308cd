"""What moves in MuJoCo and PhysX: a held base, a sine, loops; a lost run ends itself alone."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Literal

import mujoco as engine
import numpy as np
import pytest
from checks.engines import needs_physx
from robot_files import mjcf_inputs, usd_inputs
from tiny import TinyRobot, bolted, box_inertial, four_bar, pendulum, tiny_quadruped, with_drives

from assetbuild.checks._mujoco import Loops
from assetbuild.edits.share_mass import ShareMass
from assetbuild.edits.split_joint import SplitJoint
from assetbuild.engine.step import Files
from assetbuild.robot.closure import close, gaps
from assetbuild.robot.model import Actuator, Body, Control, Joint, Keyframe, Tree
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Shape, Shapes, SourceShapes
from assetbuild.simulators import mujoco, physx
from assetbuild.simulators.experiments import (
    Experiment,
    Motion,
    Outcome,
    Setting,
    Sine,
    compare_response,
    sine_of,
    swing,
)
from assetbuild.simulators.loops import LoopSwing, about_closed, trial
from assetbuild.simulators.mujoco import motion
from assetbuild.simulators.stages import perform_on_stages


def in_physx(
    robot: TinyRobot, folder: Path, runs: list[Experiment], seconds: float = 240.0
) -> dict[str, Outcome]:
    main = usd_inputs(folder, robot) / "usd/robot.usda"
    return perform_on_stages(physx.PhysxCheck.start, main, runs, seconds)


def written(robot: TinyRobot, folder: Path) -> Path:
    """Its MJCF."""
    return mjcf_inputs(folder, robot) / "mjcf/robot.xml"


def swung(path: Path, sine: Sine, step: float) -> Motion:
    asked = swing("swing", Setting(step, (0.0, 0.0, -9.81), contacts=False), sine, 0.0)
    done = motion.perform(path.parent, path.stem, asked)
    assert done.motion is not None and done.finite
    return done.motion


def test_a_held_base_is_the_bolted_robot(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    home = dict(robot.control.keyframes[0].joints)
    sine = sine_of(robot.tree, robot.control, home, 2.0, 0.5)
    tracks = []
    for one in (robot, bolted(robot)):
        path = written(one, tmp_path / one.tree.base)
        assert motion.held_model(path).nv == len(robot.tree.moving_joints)
        tracks.append(swung(path, sine, 0.002))
    held, fixed = tracks
    assert np.abs(held.root).max() == 0.0
    for joint, angles in held.joints.items():
        np.testing.assert_allclose(angles, fixed.joints[joint], rtol=0.0, atol=1e-12)


def test_hips_still_do_not_touch_the_trunk_that_is_held(tmp_path: Path) -> None:
    """MuJoCo lets a body collide with a parent that stands still, not with one that floats."""
    robot = tiny_quadruped()
    fat = Shape("fat", "FR_hip", "collision", Box((1.0, 1.0, 1.0)))
    shapes = replace(robot.shapes, shapes=(*robot.shapes.shapes, fat))
    path = written(replace(robot, shapes=shapes), tmp_path)

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
    robot = with_drives(pendulum(), model="velocity", kp=0.0, kd=500.0, effort=None)
    sine = sine_of(robot.tree, robot.control, {}, 1.0, 1.0)
    assert sine.speeds == {"swing_joint"}
    moved = swung(written(robot, tmp_path), sine, 0.001)
    width = sine.swing["swing_joint"]
    wanted = sine.middle["swing_joint"] + width * np.sin(2.0 * np.pi * moved.time)
    assert width > 0.0
    np.testing.assert_allclose(moved.joints["swing_joint"], wanted, atol=0.05 * width)


def test_a_drive_of_speeds_is_asked_for_no_more_than_its_command_holds() -> None:
    """MuJoCo clips a command beyond `ctrlrange` and PhysX does not: they would part."""
    robot = with_drives(pendulum(), model="velocity", kp=0.0, kd=5.0, ctrl=(-0.5, 0.8))
    sine = sine_of(robot.tree, robot.control, {}, 1.0, 1.0)
    assert 0.0 < 2.0 * np.pi * sine.swing["swing_joint"] < 0.5


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
    told = Loops(robot="r").evaluate(asked.sine, {"coupler_loop": 0.0})
    assert [finding.rule for finding in told] == rules


# --- PhysX through its child process ---


GRAVITY = (0.0, 0.0, -9.81)


def car() -> TinyRobot:
    """A planar base that takes speeds, split into two slides and a hinge that share its mass."""
    body = box_inertial(10.0, (0.6, 0.4, 0.2), (0.1, 0.05, 0.2))
    planar = Joint("base", "planar", "floor", "car", axis=(0.0, 0.0, 1.0))
    tree = Tree("car", "fixed", (Body("floor"), Body("car", body)), (planar,))
    for edit in (SplitJoint(joint="base"), ShareMass(link="base_._link")):
        tree = edit.edit(tree, SourceShapes(), Files(Path(), Path())).tree
    drives = tuple(
        Actuator(joint.name, "velocity", kd=kd)
        for joint, kd in zip(tree.joints, (2000.0, 2000.0, 200.0), strict=True)
    )
    home = Keyframe("home", tuple((joint.name, 0.0) for joint in tree.joints))
    return TinyRobot(tree, tree, Shapes(), Control(drives, (home,)))


@needs_physx
def test_a_planar_base_that_takes_speeds_moves_in_physx_as_in_mujoco(tmp_path: Path) -> None:
    robot = car()
    sine = sine_of(robot.tree, robot.control, {}, 1.0, 1.5)
    setting = Setting(0.001, GRAVITY)
    run = Experiment("m", setting, steps=1500, every=5, start=sine.middle, sine=sine)
    theirs = in_physx(robot, tmp_path / "usd", [run])["m"].motion
    assert theirs is not None
    ours = motion.perform(written(robot, tmp_path / "mjcf").parent, "robot", run).motion
    assert ours is not None
    for name in sine.speeds:
        response = compare_response(sine, name, ours, theirs)
        assert response.rms < 5e-3
        assert response.gain == pytest.approx(1.0, abs=5e-3)


@needs_physx
def test_a_nan_ends_its_own_experiment_only(tmp_path: Path) -> None:
    setting = Setting(0.005, GRAVITY)
    knees = {f"{leg}_calf_joint": 0.5 for leg in ("FR", "FL", "RR", "RL")}  # limit: -0.9
    bad, good = Experiment("bad", setting, 40, start=knees), Experiment("good", setting, 4)
    done = in_physx(tiny_quadruped(), tmp_path, [bad, good])
    assert not done["bad"].finite
    assert done["bad"].failure
    assert done["good"].finite


@needs_physx
def test_a_run_that_takes_too_long_is_stopped(tmp_path: Path) -> None:
    run = Experiment("long", Setting(0.001, GRAVITY), steps=10_000_000)
    done = in_physx(pendulum(), tmp_path, [run], seconds=5.0)["long"]
    assert "5 s" in done.failure
    assert not done.finite


def test_the_sine_stays_off_the_stops_and_a_slow_joint_swings_little() -> None:
    """0.1 rad/s at 1 Hz are 16 mrad of swing at most; PhysX keeps the limit, MuJoCo knows none."""
    robot = tiny_quadruped()
    slowed = with_drives(robot, velocity=0.1).control
    for control, start, times in (
        (robot.control, {"FR_calf_joint": -0.9}, 1.0),
        (slowed, {}, 10.0),
    ):
        sine = sine_of(robot.tree, control, start, 1.0, 3.0)
        for joint in robot.tree.moving_joints:
            lower, upper = joint.limits.lower, joint.limits.upper
            assert lower is not None and upper is not None
            off = min(sine.middle[joint.name] - lower, upper - sine.middle[joint.name])
            assert off > times * sine.swing[joint.name]
            assert control is not slowed or 2.0 * math.pi * sine.swing[joint.name] < 0.1


def test_response_finds_gain_and_lag() -> None:
    time = np.linspace(0.0, 3.0, 601)
    sine = Sine({"a": 0.0}, {"a": 0.3})

    def motion(values: np.ndarray) -> Motion:
        zeros = np.zeros((601, 3))
        return Motion(time, {"a": values}, zeros, np.zeros((601, 4)), zeros)

    first = motion(0.3 * np.sin(2 * math.pi * time))
    second = motion(0.1 + 0.27 * np.sin(2 * math.pi * time - 0.2))
    response = compare_response(sine, "a", first, second)
    assert response.gain == pytest.approx(0.9, abs=1e-9)
    assert response.lag_rad == pytest.approx(0.2, abs=1e-9)
    assert compare_response(sine, "a", first, first).rms == 0.0
