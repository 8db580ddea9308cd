"""A gripper that closes on an object, lifts it and is shaken, in engines that read USD.

Where the object lies and how the hand closes is what MuJoCo's model says. All but the fingers is
locked, and the object alone is shaken.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from assetbuild.engine.step import Limits
from assetbuild.robot.pose import Array, Pose, quat_of, vec3
from assetbuild.simulators.experiments import Course, Experiment, Gripped, Outcome, Setting
from assetbuild.simulators.gripping import GripCheck
from assetbuild.simulators.mujoco import Model, contact_solver, floats, name_of, turning
from assetbuild.simulators.mujoco.grip import (
    CLOSE_S,
    FRICTION,
    LIFT_M,
    LIFT_S,
    TOTAL_S,
    G,
    Grip,
    Place,
    Try,
    closing,
    half_size,
    inertia_of,
    shaking,
    table_at,
)
from assetbuild.simulators.mujoco.hands import Hand, at_pose

SAMPLE_S = 0.1


class StageGripping(GripCheck):
    """Does what `grip` does in MuJoCo, whose model says where the objects lie."""

    usual_s = 60.0
    needs: ClassVar[tuple[str, ...]] = ("mjcf", "usd")
    limits: ClassVar[Limits] = Limits(wall_s=1200.0, memory_mb=16384)

    def grips(self, inputs: Path, model: Model, hand: Hand, tries: Sequence[Try]) -> Sequence[Grip]:
        """All in one process. Of a side, it is seen from the body against which it moved least."""
        experiments = [
            _experiment(str(index), model, hand, place, mass)
            for index, (place, mass) in enumerate(tries)
        ]
        done = self.perform(inputs, experiments)
        return [
            _grip(done[experiment.name], hand, place, mass)
            for experiment, (place, mass) in zip(experiments, tries, strict=True)
        ]


def _experiment(name: str, model: Model, hand: Hand, place: Place, mass: float) -> Experiment:
    pose, step = hand.poses[place.start], float(model.opt.timestep)
    R, at = _to_world(model, pose)
    times: Array = step * np.arange(round(TOTAL_S / step) + 1.0)

    table = table_at(place, times) @ R.T + at
    quat = quat_of(R @ place.R)
    positions = {
        name_of(model, "joint", joint): float(pose[model.jnt_qposadr[joint]])
        for joint in turning(model)
    }
    fingers = {name_of(model, "joint", joint) for joint in hand.fingers}
    gripped = Gripped(
        place.shape,
        vec3(2.0 * half_size(place.shape, place.width_m)),
        mass,
        vec3(inertia_of(place.shape, place.width_m, mass)),
        FRICTION,
        Pose(vec3(R @ place.xyz + at), quat),
        Pose(vec3(table[0]), quat),
    )
    setting = Setting(
        step,
        vec3(G * R @ place.down),
        "held" if floats(model) else "asset",
        locked={joint: at for joint, at in positions.items() if joint not in fingers},
        gripped=gripped,
        solver=contact_solver(model),
    )
    targets = closing(hand, place, times)
    course = Course(
        {drive.joint_name: targets[:, i] for i, drive in enumerate(hand.drives)},
        table,
        mass * shaking(place, times) @ R.T,
        tuple(name_of(model, "body", body) for side in hand.sides for body in side),
    )
    every = max(1, round(SAMPLE_S / step))
    return Experiment(name, setting, len(times) - 1, every, positions, course=course)


def _to_world(model: Model, pose: Array) -> tuple[Array, Array]:
    """(3, 3) and (3,): from MuJoCo's world into that of the stage, which holds a floating base at
    its origin.
    """
    if not floats(model):
        return np.eye(3), np.zeros(3)
    data, root = at_pose(model, pose), 1
    R = data.xmat[root].reshape(3, 3).T
    return R, -R @ data.xpos[root]


def _grip(outcome: Outcome, hand: Hand, place: Place, mass: float) -> Grip:
    motion = outcome.motion
    if motion is None or motion.seen is None or not outcome.finite:
        return Grip(place, mass, np.inf, np.inf, None, held=False, failure=outcome.failure)
    times = (CLOSE_S, CLOSE_S + LIFT_S, motion.time[-1])
    seen = motion.seen[np.searchsorted(motion.time, np.array(times) - SAMPLE_S / 2.0)]
    moved, one = np.linalg.norm(np.diff(seen, axis=0), axis=2), len(hand.sides[0])
    seat, slip = (float(row[:one].min() + row[one:].min()) / 2.0 for row in moved)
    return Grip(place, mass, slip, seat, None, held=seat + slip < LIFT_M / 2.0)
