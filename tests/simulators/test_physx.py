"""PhysX through its child process: mimics couple, a NaN or a crash ends only its own experiment."""

from __future__ import annotations

import math
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from tiny import TinyRobot, box_inertial, check_inputs, pendulum, tiny_quadruped

from assetbuild.edits.share_mass import ShareMass
from assetbuild.edits.split_joint import SplitJoint
from assetbuild.engine.step import Files
from assetbuild.robot.model import Actuator, Body, Control, Joint, Keyframe, Tree
from assetbuild.robot.shapes import Shapes, SourceShapes
from assetbuild.simulators import physx
from assetbuild.simulators.experiments import (
    Experiment,
    Motion,
    Setting,
    Sine,
    compare_response,
    sine_of,
)
from assetbuild.simulators.mujoco.motion import perform as mujoco_perform
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.usd import Usd

needs_physx = pytest.mark.skipif(find_spec("ovphysx") is None, reason="needs the extra `physx`")
GRAVITY = (0.0, 0.0, -9.81)


def built(robot: TinyRobot, folder: Path) -> Path:
    return check_inputs(folder, robot, Usd(robot="robot"), "usd") / "usd/robot.usda"


def car() -> TinyRobot:
    """A planar base on drives, split into two slides and a hinge whose links share its mass."""
    body = box_inertial(10.0, (0.6, 0.4, 0.2), (0.1, 0.05, 0.2))
    planar = Joint("base", "planar", "floor", "car", axis=(0.0, 0.0, 1.0))
    tree = Tree("car", "fixed", (Body("floor"), Body("car", body)), (planar,))
    for edit in (SplitJoint(joint="base"), ShareMass(link="base_._link")):
        tree = edit.edit(tree, SourceShapes(), Files(Path(), Path())).tree
    drives = tuple(
        Actuator(joint.name, "pd", kp=kp, kd=kp / 10.0)
        for joint, kp in zip(tree.joints, (2000.0, 2000.0, 200.0), strict=True)
    )
    home = Keyframe("home", tuple((joint.name, 0.0) for joint in tree.joints))
    return TinyRobot(tree, tree, Shapes(), Control(drives, (home,)))


@needs_physx
def test_a_planar_base_that_takes_speeds_moves_in_physx_as_in_mujoco(tmp_path: Path) -> None:
    robot = car()
    drives = tuple(
        replace(a, model="velocity", kp=0.0, kd=kd)
        for a, kd in zip(robot.control.actuators, (2000.0, 2000.0, 200.0), strict=True)
    )
    robot = replace(robot, control=replace(robot.control, actuators=drives))
    sine = sine_of(robot.tree, robot.control, {}, 1.0, 1.5)
    setting = Setting(0.001, GRAVITY)
    run = Experiment("m", setting, steps=1500, every=5, start=sine.middle, sine=sine)
    theirs = physx.perform(built(robot, tmp_path / "usd"), [run])["m"].motion
    assert theirs is not None
    inputs = check_inputs(tmp_path / "mjcf", robot, Mjcf(robot="robot"), "mjcf")
    ours = mujoco_perform(inputs / "mjcf", "robot", [run])["m"].motion
    assert ours is not None
    for name in sine.speeds:
        response = compare_response(sine, name, ours, theirs)
        assert response.rms < 5e-3
        assert response.gain == pytest.approx(1.0, abs=5e-3)


@needs_physx
def test_a_nan_ends_its_own_experiment_only(tmp_path: Path) -> None:
    setting = Setting(0.005, GRAVITY)
    knees = {f"{leg}_calf_joint": 0.5 for leg in ("FR", "FL", "RR", "RL")}  # limit: -0.9
    runs = [
        Experiment("bad", setting, steps=40, start=knees),
        Experiment("good", setting, steps=4),
    ]
    done = physx.perform(built(tiny_quadruped(), tmp_path), runs)
    assert not done["bad"].finite
    assert done["bad"].failure
    assert done["good"].finite


@needs_physx
def test_a_run_that_takes_too_long_is_stopped(tmp_path: Path) -> None:
    run = Experiment("long", Setting(0.001, GRAVITY), steps=10_000_000)
    done = physx.perform(built(pendulum(), tmp_path), [run], seconds=5.0)["long"]
    assert "5 s" in done.failure
    assert not done.finite


def test_the_sine_stays_off_the_stops_and_a_slow_joint_swings_little() -> None:
    """0.1 rad/s at 1 Hz are 16 mrad of swing at most; PhysX keeps the limit, MuJoCo knows none."""
    robot = tiny_quadruped()
    slow = tuple(replace(a, velocity=0.1) for a in robot.control.actuators)
    slowed = replace(robot.control, actuators=slow)
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
