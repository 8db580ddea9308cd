"""What a compiled model shows: poses and targets in range; its parts, left and right."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from assetbuild.findings import Finding, Rule
from assetbuild.robot.pose import Array
from assetbuild.robot.twins import Motion, Part
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco.drives import Drive, drives_of, read_drives

RANGE_TOLERANCE = 1e-6
"""rad or m; a number that was rounded from the limit itself is inside."""
TARGET_TOLERANCE = 1e-3

KEY_POSITION = Rule(
    "lint.key_position",
    "warning",
    "a keyframe puts a joint outside its range",
    "choose a value inside",
)
KEY_CTRL = Rule(
    "lint.key_ctrl",
    "warning",
    "a keyframe's command is outside the drive's range",
    "choose a value inside",
)
KEY_TARGET = Rule(
    "lint.key_target",
    "warning",
    "a position drive pulls away from the pose of the keyframe",
    "set `ctrl` equal to the positions",
)


def lint(model: mujoco.Model) -> Iterator[Finding]:
    """All that the compiled model shows without a step of simulation."""
    for key in range(model.nkey):
        name = mujoco.name_of(model, "key", key)
        qpos, ctrl = model.key_qpos[key], model.key_ctrl[key]
        for joint in range(model.njnt):
            if model.jnt_limited[joint] and model.jnt_type[joint] >= 2:
                subject = f"joint {mujoco.name_of(model, 'joint', joint)}"
                value, ends = qpos[model.jnt_qposadr[joint]], model.jnt_range[joint]
                yield from _outside(KEY_POSITION, subject, name, value, ends)
        for drive in mujoco.actuators(model):
            if model.actuator_ctrllimited[drive]:
                value = ctrl[mujoco.first_command(model, drive)]
                subject = f"actuator {mujoco.name_of(model, 'actuator', drive)}"
                yield from _outside(KEY_CTRL, subject, name, value, model.actuator_ctrlrange[drive])
        for servo in read_drives(model):
            if servo.kind == "servo":
                yield from _target(model, servo, name, qpos, float(ctrl[servo.ctrl_index]))


def _outside(rule: Rule, subject: str, key: str, value: float, ends: Array) -> Iterator[Finding]:
    low, high = map(float, ends)
    if not low - RANGE_TOLERANCE <= value <= high + RANGE_TOLERANCE:
        yield rule(
            subject,
            f"keyframe `{key}`: {value:g} is outside {low:g}..{high:g}",
            hint="choose a value inside",
            data={"keyframe": key, "value": float(value), "lower": low, "upper": high},
        )


def _target(
    model: mujoco.Model, servo: Drive, key: str, qpos: Array, command: float
) -> Iterator[Finding]:
    """A position drive that pulls away from the pose it starts in."""
    at, target = float(qpos[model.jnt_qposadr[servo.joint]]), servo.target(command)
    if abs(at - target) > TARGET_TOLERANCE:
        yield KEY_TARGET(
            f"actuator {mujoco.name_of(model, 'actuator', servo.index)}",
            f"keyframe `{key}`: its target is {target:g}, the joint stands at {at:g}",
            hint="give the keyframe a `ctrl` that equals its positions",
            data={"keyframe": key, "target": target, "position": at},
        )


# --- left and right -------------------------------------------------------------------------


def parts_of(model: mujoco.Model) -> tuple[Part, ...]:
    """Bodies and joints at qpos0 in the frame of the first body, as `robot.mirror` compares."""
    import mujoco as mj

    if model.nbody < 3:
        return ()
    data = mj.MjData(model)
    mj.mj_kinematics(model, data)
    root, origin = np.array(data.xmat[1]).reshape(3, 3), np.array(data.xpos[1])
    parts = []
    for index in range(1, model.nbody):
        turn = root.T @ np.array(data.ximat[index]).reshape(3, 3)
        first, count = int(model.body_jntadr[index]), int(model.body_jntnum[index])
        joints = [j for j in range(first, first + count) if int(model.jnt_type[j]) >= 2]
        parts.append(
            Part(
                mujoco.name_of(model, "body", index),
                root.T @ (np.array(data.xpos[index]) - origin),
                float(model.body_mass[index]),
                root.T @ (np.array(data.xipos[index]) - origin),
                turn @ np.diag(model.body_inertia[index]) @ turn.T,
                tuple(
                    _motion(model, joint, root.T @ np.array(data.xaxis[joint])) for joint in joints
                ),
                mujoco.name_of(model, "body", int(model.body_parentid[index])),
            )
        )
    return tuple(parts)


def _motion(model: mujoco.Model, joint: int, axis: Array) -> Motion:
    found = drives_of(model, joint)
    dof, at = int(model.jnt_dofadr[joint]), int(model.jnt_qposadr[joint])
    values: dict[str, float | None] = {
        "damping": float(np.ravel(model.dof_damping[dof])[0]),
        "friction": float(model.dof_frictionloss[dof]),
        "armature": float(model.dof_armature[dof]),
    }
    if found.drives:
        values["gain"] = found.kp or sum(drive.gain for drive in found.drives)
        values["effort limit"] = found.effort if math.isfinite(found.effort) else None
    low, high = (float(v) for v in model.jnt_range[joint])
    key = mujoco.initial_key(model)
    return Motion(
        mujoco.name_of(model, "joint", joint),
        int(model.jnt_type[joint]) == 3,
        axis,
        (low, high) if model.jnt_limited[joint] else None,
        None if key is None else float(model.key_qpos[key, at]),
        values,
    )
