"""MuJoCo moves: the same sine, drop and stand that PhysX is asked for, as trajectories."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from assetbuild.robot.model import Actuator
from assetbuild.robot.pose import Array
from assetbuild.simulators.experiments import Motion, Sine
from assetbuild.simulators.joint_drives import Drive, read_drives
from assetbuild.simulators.mujoco import (
    Data,
    Model,
    caught_warnings,
    name_of,
    raise_base,
    turning,
)

HARD = 0.9999
"""Impedance of hard constraints: a ten thousandth of what loads them moves them."""


def held_model(path: Path, driven: Collection[str] = ()) -> Model:
    """The robot of an MJCF file with its floating base bolted to the origin; no keyframes.

    The joint goes: a huge inertia on it instead would cost the constraints of light fingers the
    solver's digits. driven: joints that get a drive where they have none, for `drive_as`; then
    nothing else of the file pulls.
    """
    import mujoco

    spec = mujoco.MjSpec.from_file(str(path))
    spec.compiler.discardvisual = True
    free = [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    for joint in free:
        joint.parent.pos, joint.parent.quat = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
        # Parent and child never collide, unless the parent stands still: as this one now does.
        still, moving = _held_together(joint.parent, joint)
        for one, other in itertools.product(still, moving):
            spec.add_exclude(bodyname1=one.name, bodyname2=other.name)
    other = [a for a in spec.actuators if driven and not _drives(a, driven)]
    for gone in (*free, *spec.keys, *(_watching(spec, other)), *other):
        spec.delete(gone)
    for joint in driven:
        if not any(_drives(actuator, (joint,)) for actuator in spec.actuators):
            made = spec.add_actuator(name=f"{joint} servo", target=joint)
            made.trntype = mujoco.mjtTrn.mjTRN_JOINT
    with caught_warnings():
        return spec.compile()


def _drives(actuator: Any, joints: Collection[str]) -> bool:  # Any: mujoco.MjsActuator
    import mujoco

    is_joint = actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT
    return is_joint and str(actuator.target) in joints


def _watching(spec: Any, actuators: list[Any]) -> list[Any]:
    """Sensors of actuators. Any: mujoco.MjSpec, its actuators and sensors."""
    import mujoco

    names = {actuator.name for actuator in actuators}
    kind = mujoco.mjtObj.mjOBJ_ACTUATOR
    return [s for s in spec.sensors if s.objtype == kind and s.objname in names]


def _held_together(body: Any, free: Any) -> tuple[list[Any], list[Any]]:
    """(the body and all that is welded to it, the bodies that move on those).

    Any: mujoco.MjsBody, MjsJoint.
    """
    still, moving = [body], []
    for child in body.bodies:
        if any(joint is not free for joint in child.joints):
            moving.append(child)
        else:
            below = _held_together(child, free)
            still, moving = still + below[0], moving + below[1]
    return still, moving


def held_sine(
    model: Model,
    sine: Sine,
    timestep: float,
    *,
    contacts: bool,
    rubbing: bool,
    limited: bool = True,
    hard: bool = False,
    every: int = 1,
) -> Motion:
    """All joints follow `sine`, from its middle. The model is changed: load it anew.

    contacts: False switches them off; rubbing: False takes joint friction and damping; limited:
    False the limits of effort. hard: dry friction and coupled joints give way as little as in a
    textbook, not as the model says.
    """
    import mujoco

    model.opt.timestep = timestep
    if not contacts:
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    if hard:
        for solref, solimp in (
            (model.dof_solref, model.dof_solimp),
            (model.eq_solref, model.eq_solimp),
        ):
            solref[:] = (2.0 * timestep, 1.0)
            solimp[:, :2] = HARD
    if not rubbing:
        model.dof_frictionloss[:] = 0.0
        model.dof_damping[:] = 0.0
    if not limited:
        model.actuator_forcelimited[:] = 0
        model.jnt_actfrclimited[:] = 0
    data = mujoco.MjData(model)
    for name, middle in sine.middle.items():
        data.qpos[int(model.joint(name).qposadr[0])] = middle
    steps = round(sine.seconds / timestep)
    with caught_warnings():
        mujoco.mj_forward(model, data)
        return _track(model, data, steps, every, sine)


def keyframe_motion(
    model: Model,
    keyframe: str,
    steps: int,
    *,
    raised_m: float = 0.0,
    every: int = 1,
    servos: Mapping[str, Actuator] | None = None,
) -> Motion:
    """From a keyframe, lifted by `raised_m`, under its own controls.

    servos: see `drive_as`; the keyframe knows no controls for them, so they hold its positions.
    """
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(keyframe).id)
    raise_base(model, data, raised_m)
    for drive in read_drives(model):
        if drive.joint_name in (servos or {}) and drive.holds_position:
            position = float(data.qpos[int(model.jnt_qposadr[drive.joint])])
            data.ctrl[drive.ctrl_index] = drive.command(position)
    with caught_warnings():
        mujoco.mj_forward(model, data)
        return _track(model, data, steps, every, None)


def drive_as(model: Model, gains: Mapping[str, Actuator]) -> None:
    """Turn actuators of some joints into position servos inside of the simulator.

    For models whose law runs outside (`ideal_pd`, `motor`, ...): both engines then integrate it.
    Keyframes, which command such a motor no torque, command the servo their own pose. Of several
    actuators of a joint, the first becomes the servo and the others pull no more.
    """
    import mujoco

    turned = set()
    for drive in read_drives(model):
        actuator, index = gains.get(drive.joint_name), drive.index
        if actuator is None:
            continue
        if drive.joint in turned:
            model.actuator_gear[index, 0] = 0.0
            continue
        turned.add(drive.joint)
        model.actuator_trntype[index] = mujoco.mjtTrn.mjTRN_JOINT
        model.actuator_trnid[index] = (drive.joint, -1)
        model.actuator_gear[index, 0] = 1.0
        model.actuator_gaintype[index] = mujoco.mjtGain.mjGAIN_FIXED
        model.actuator_biastype[index] = mujoco.mjtBias.mjBIAS_AFFINE
        model.actuator_gainprm[index, :3] = (actuator.kp, 0.0, 0.0)
        model.actuator_biasprm[index, :3] = (0.0, -actuator.kp, -actuator.kd)
        model.actuator_ctrllimited[index] = 0
        model.key_ctrl[:, index] = model.key_qpos[:, int(model.jnt_qposadr[drive.joint])]
        if actuator.effort is not None:
            model.actuator_forcelimited[index] = 1
            model.actuator_forcerange[index] = (-actuator.effort, actuator.effort)


def _track(model: Model, data: Data, steps: int, every: int, sine: Sine | None) -> Motion:
    import mujoco

    times: list[float] = []
    rows: list[Array] = []
    roots: list[Array] = []
    coms: list[Array] = []
    touched = False
    sine = sine or Sine({}, {})
    drives: tuple[Drive, ...] = read_drives(model) if sine.middle else ()
    for step in range(steps + 1):
        if step:
            for drive in drives:
                if drive.joint_name not in sine.middle:
                    continue
                target = sine.target(drive.joint_name, step * model.opt.timestep)
                if drive.joint_name in sine.speeds:
                    data.ctrl[drive.ctrl_index] = drive.kd * target / drive.gain
                elif drive.holds_position:
                    data.ctrl[drive.ctrl_index] = drive.command(target)
            mujoco.mj_step(model, data)
            touched = touched or data.ncon > 0
        if step % every and step != steps:
            continue
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        times.append(step * float(model.opt.timestep))
        rows.append(np.array(data.qpos))
        roots.append(np.concatenate([data.xpos[1], data.xquat[1]]))
        coms.append(np.array(data.subtree_com[0]))
    q, root = np.array(rows), np.array(roots)
    joints = {name_of(model, "joint", j): q[:, int(model.jnt_qposadr[j])] for j in turning(model)}
    return Motion(np.array(times), joints, root[:, :3], root[:, 3:], np.array(coms), touched)
