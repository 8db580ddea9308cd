"""What a policy does to a robot before it has learned anything: the first minutes of training."""

from __future__ import annotations

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
from assetbuild.simulators.mujoco_trials import SEED, servo_joint

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
        (a, _scale(model, a, action)) for a in range(model.nu) if servo_joint(model, a) is not None
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
                for actuator, scale in servos:
                    data.ctrl[actuator] = commands[actuator] + scale * random.standard_normal()
            mujoco.mj_step(model, data)
            if not is_finite(data):
                ended = step * model.opt.timestep
                break
            speeds = np.maximum(speeds, np.abs(data.qvel[dofs]))
    name = name_of(model, "joint", joints[int(speeds.argmax())])
    return Shaken(ended, name, float(speeds.max()))


def _scale(model: Model, actuator: int, action: Action) -> float:
    """rad or m for one unit of action."""
    import mujoco

    joint = int(model.actuator_trnid[actuator, 0])
    efforts = [float(model.jnt_actfrcrange[joint, 1])] if model.jnt_actfrclimited[joint] else []
    if model.actuator_forcelimited[actuator]:
        efforts.append(float(model.actuator_forcerange[actuator, 1]))
    kp = -float(model.actuator_biasprm[actuator, 1])
    slides = bool(model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE)
    return action.scale(min(efforts, default=None), kp, slides=slides)
