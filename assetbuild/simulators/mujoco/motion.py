"""MuJoCo moves: the experiments that other simulators are asked for, on the MJCF."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from assetbuild.errors import StepError
from assetbuild.robot.model import Actuator
from assetbuild.robot.pose import Array
from assetbuild.simulators.experiments import Experiment, Motion, Outcome, SimulatorCheck, Sine
from assetbuild.simulators.mujoco import (
    Data,
    InMujoco,
    Model,
    at_key,
    caught_warnings,
    is_finite,
    load,
    name_of,
    raise_base,
    turning,
    without,
)
from assetbuild.simulators.mujoco.drives import Drive, aim, read_drives

HARD = 0.9999
"""Impedance of hard constraints: a ten thousandth of what loads them moves them."""


class MujocoCheck(InMujoco, SimulatorCheck):
    """Base of the checks that ask MuJoCo as they ask others."""

    engine: ClassVar[str] = "MuJoCo"

    def perform(self, inputs: Path, experiments: Sequence[Experiment]) -> Mapping[str, Outcome]:
        """Run experiments on `mjcf/`."""
        return perform(inputs / "mjcf", self.robot, experiments)


def perform(folder: Path, robot: str, experiments: Sequence[Experiment]) -> Mapping[str, Outcome]:
    """Run experiments on the MJCF of a folder, by name; `held` is MuJoCo's model."""
    return {asked.name: _perform(folder, robot, asked) for asked in experiments}


def _perform(folder: Path, robot: str, asked: Experiment) -> Outcome:
    path = folder / f"{robot}.xml"
    try:
        if not asked.steps:
            return Outcome(load(path).model, None)
        if asked.sine is not None:
            return _swing(path, asked)
        if asked.setting.floor_friction is None:
            return _drop(path, asked)
        return _hold(path.with_name("scene.xml"), asked)
    except StepError as error:
        return Outcome(None, None, error.message)


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


def _swing(path: Path, asked: Experiment) -> Outcome:
    """All joints follow a sine from its middle, a floating base bolted to the world."""
    import mujoco

    setting, sine = asked.setting, asked.sine
    servos, dt = dict(setting.drives or {}), setting.timestep
    model = held_model(path, () if setting.other_drives else servos)
    drive_as(model, servos)
    model.opt.timestep = dt
    if not setting.contacts:
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    if setting.hard:
        for solref, solimp in (
            (model.dof_solref, model.dof_solimp),
            (model.eq_solref, model.eq_solimp),
        ):
            solref[:] = (2.0 * dt, 1.0)
            solimp[:, :2] = HARD
    if not setting.rubbing:
        model.dof_frictionloss[:] = 0.0
        model.dof_damping[:] = 0.0
    if not setting.limited:
        model.actuator_forcelimited[:] = 0
        model.jnt_actfrclimited[:] = 0
    if not setting.clipped:
        model.actuator_ctrllimited[:] = 0
    data = mujoco.MjData(model)
    for name, position in (asked.start or {}).items():
        data.qpos[int(model.joint(name).qposadr[0])] = position
    return _track(model, data, asked.steps, asked.every, sine)


def _drop(path: Path, asked: Experiment) -> Outcome:
    """Fall from the initial pose with contacts, limits and drives off."""
    model = without(load(path, visuals=False).model, "CONSTRAINT", "ACTUATION")
    return _track(model, at_key(model), asked.steps, asked.every)


def _hold(path: Path, asked: Experiment) -> Outcome:
    """Hold a keyframe of the scene, raised, under its own controls.

    The keyframe knows no controls for servos of ours, so they hold its positions.
    """
    import mujoco

    setting = asked.setting
    model, servos = load(path).model, setting.drives or {}
    drive_as(model, servos)
    model.opt.gravity[:] = setting.gravity
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(setting.keyframe).id)
    raise_base(model, data, setting.raised_m)
    aim(model, data, servos)
    return _track(model, data, asked.steps, asked.every)


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


def _track(model: Model, data: Data, steps: int, every: int, sine: Sine | None = None) -> Outcome:
    """The motion from here on, under the commands of a sine."""
    import mujoco

    times, rows, roots, coms = list[float](), list[Array](), list[Array](), list[Array]()
    sine, touched = sine or Sine({}, {}), False
    drives = [drive for drive in read_drives(model) if drive.joint_name in sine.middle]
    with caught_warnings():
        mujoco.mj_forward(model, data)
        for step in range(steps + 1):
            if step:
                _command(data, drives, sine, step * float(model.opt.timestep))
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
    motion = Motion(np.array(times), joints, root[:, :3], root[:, 3:], np.array(coms), touched)
    return Outcome(None, motion, "" if is_finite(data) else "the simulation became unstable")


def _command(data: Data, drives: Sequence[Drive], sine: Sine, time: float) -> None:
    for drive in drives:
        target = sine.target(drive.joint_name, time)
        if drive.joint_name in sine.speeds:
            data.ctrl[drive.ctrl_index] = drive.kd * target / drive.gain
        elif drive.holds_position:
            data.ctrl[drive.ctrl_index] = drive.command(target)
