"""What a policy does to a robot before it has learned anything: the first minutes of training."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from assetbuild.robot.action import Action
from assetbuild.simulators.mujoco import (
    Model,
    at_key,
    caught_warnings,
    is_finite,
    name_of,
    turning,
    without,
)
from assetbuild.simulators.mujoco.drives import Drive, drives_of, read_drives
from assetbuild.simulators.mujoco.trials import SEED

CONTROL_S = 0.02
"""Between two commands."""


@dataclass(frozen=True)
class Shaken:
    """What noise did. seconds: until it went to infinity, None = it did not.

    joint: the fastest of all, and its speed, rad/s or m/s.
    """

    seconds: float | None
    joint: str
    fastest: float


def shake(
    model: Model, action: Action, seconds: float = 5.0, seed: int = SEED, finer: int = 1
) -> Shaken | None:
    """What PPO does at first: each servo gets a new random target 50 times a second.

    Normally distributed about the initial pose with the joint's scale of `action`; falls and lies
    on the floor as it may. finer: steps in place of each. None: nothing is a position servo.
    """
    import mujoco

    servos = [
        (drive.ctrl_index, drive.command_step(_scale(model, drive, action)))
        for drive in read_drives(model)
        if drive.holds_position
    ]
    joints = turning(model)
    if not servos:
        return None
    dofs = np.array([int(model.jnt_dofadr[joint]) for joint in joints])
    random, speeds = np.random.default_rng(seed), np.zeros(len(joints))
    ended = None
    model = without(model)
    with caught_warnings():
        model.opt.timestep = model.opt.timestep / finer
        data = at_key(model)
        commands = np.array(data.ctrl)
        each = max(1, round(CONTROL_S / model.opt.timestep))
        for step in range(each * round(seconds / CONTROL_S)):
            if step % each == 0:
                for index, scale in servos:
                    data.ctrl[index] = commands[index] + scale * random.standard_normal()
            mujoco.mj_step(model, data)
            if not is_finite(data):
                ended = step * model.opt.timestep
                break
            speeds = np.maximum(speeds, np.abs(data.qvel[dofs]))
    name = name_of(model, "joint", joints[int(speeds.argmax())])
    return Shaken(ended, name, float(speeds.max()))


def _scale(model: Model, drive: Drive, action: Action) -> float:
    """rad or m for one unit of action."""
    import mujoco

    effort = drives_of(model, drive.joint).effort
    slides = bool(model.jnt_type[drive.joint] == mujoco.mjtJoint.mjJNT_SLIDE)
    return action.scale(effort if math.isfinite(effort) else None, drive.kp, slides=slides)
