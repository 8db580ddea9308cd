"""MuJoCo moves: the experiments that other simulators are asked for, on the MJCF."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from assetbuild.errors import StepError
from assetbuild.robot.pose import Array
from assetbuild.simulators import mujoco
from assetbuild.simulators.experiments import Experiment, Motion, Outcome, Setting, SimulatorCheck
from assetbuild.simulators.mujoco import Data, Model, mj
from assetbuild.simulators.mujoco.drives import aim, drive_as, read_drives

HARD = 0.9999
"""Impedance of hard constraints: a ten thousandth of what loads them moves them."""


class MujocoCheck(mujoco.InMujoco, SimulatorCheck):
    """Base of the checks that ask MuJoCo as they ask others."""

    engine: ClassVar[str] = "MuJoCo"

    def label(self, target: str, file: Path) -> tuple[str, str]:
        """The file itself."""
        return target, file.name

    def perform(self, inputs: Path, experiments: Sequence[Experiment]) -> Mapping[str, Outcome]:
        """Run experiments on `mjcf/`."""
        return {asked.name: perform(inputs / "mjcf", self.robot, asked) for asked in experiments}


def perform(folder: Path, robot: str, asked: Experiment) -> Outcome:
    """Run an experiment on the MJCF of a folder."""
    setting, sine = asked.setting, asked.sine
    path = folder / (f"{robot}.xml" if setting.floor_friction is None else "scene.xml")
    servos = dict(setting.drives or {})
    try:
        if not sine.middle:
            model = mujoco.load(path, visuals=False).model
        else:
            model = held_model(path, () if setting.other_drives else servos)
        drive_as(model, servos, others=setting.other_drives)
        _surround(model, setting, drives=bool(sine.middle) or setting.contacts)
        if sine.middle:
            data = mj.MjData(model)
            for name, position in (asked.start or {}).items():
                data.qpos[int(model.joint(name).qposadr[0])] = position
        else:  # in the keyframe, or the initial pose
            key = setting.keyframe
            data = mujoco.at_key(model, model.key(key).id if key else None)
            mujoco.raise_base(model, data, setting.raised_m)
            aim(model, data, servos)  # servos of ours, which it has no controls for, hold it
        return _track(model, data, asked)
    except StepError as error:
        return Outcome(None, None, error.message)


def _surround(model: Model, setting: Setting, *, drives: bool) -> None:
    """drives: False takes drives, constraints and the medium along with the contacts: it falls
    freely, in the semi-implicit steps of every other engine."""
    off = mj.mjtDisableBit
    model.opt.timestep = dt = setting.timestep
    model.opt.gravity[:] = setting.gravity
    if not setting.contacts:
        model.opt.disableflags |= int(off.mjDSBL_CONTACT)
    if not drives:
        model.opt.disableflags |= int(off.mjDSBL_CONSTRAINT) | int(off.mjDSBL_ACTUATION)
        model.opt.density = model.opt.viscosity = 0.0
        model.opt.integrator = mj.mjtIntegrator.mjINT_EULER
    if setting.hard:
        model.dof_solref[:] = model.eq_solref[:] = (2.0 * dt, 1.0)
        model.dof_solimp[:, :2] = model.eq_solimp[:, :2] = HARD
    for is_on, fields in (
        (setting.rubbing, (model.dof_frictionloss, model.dof_damping)),
        (setting.limited, (model.actuator_forcelimited, model.jnt_actfrclimited)),
        (setting.clipped, (model.actuator_ctrllimited,)),
    ):
        for field in () if is_on else fields:
            field[:] = 0


def held_model(path: Path, driven: Collection[str] = ()) -> Model:
    """The robot of an MJCF file with its floating base bolted to the origin; no keyframes.

    The joint goes: a huge inertia on it instead would cost the constraints of light fingers the
    solver's digits. driven: joints that get a drive where they have none, for `drive_as`.
    """

    def hold(spec: Any) -> None:  # Any: MuJoCo's MjSpec
        free = [joint for joint in spec.joints if joint.type == mj.mjtJoint.mjJNT_FREE]
        for joint in free:
            joint.parent.pos, joint.parent.quat = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
            # Parent and child never collide, unless the parent stands still: as this one now does.
            still, moving = _held_together(joint.parent, joint)
            for one, other in itertools.product(still, moving):
                spec.add_exclude(bodyname1=one.name, bodyname2=other.name)
        for gone in (*free, *spec.keys):
            spec.delete(gone)
        of_joints = [a for a in spec.actuators if a.trntype == mj.mjtTrn.mjTRN_JOINT]
        for joint in set(driven) - {str(actuator.target) for actuator in of_joints}:
            made = spec.add_actuator(name=f"{joint} servo", target=joint)
            made.trntype = mj.mjtTrn.mjTRN_JOINT

    return mujoco.load(path, visuals=False, change=hold).model


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


def _track(model: Model, data: Data, asked: Experiment) -> Outcome:
    """The motion from here on, under the commands of a sine."""
    sine, dt, touched = asked.sine, float(model.opt.timestep), False
    rows = list[tuple[Array, ...]]()
    positions, speeds = sine.commands(asked.steps, dt)
    commands = dict[int, Array]()
    for drive in read_drives(model):
        if drive.joint_name in speeds:
            commands[drive.ctrl_index] = drive.kd * speeds[drive.joint_name] / drive.gain
        elif drive.joint_name in positions and drive.holds_position:
            commands[drive.ctrl_index] = drive.command(positions[drive.joint_name])
    with mujoco.caught_warnings():
        mj.mj_forward(model, data)
        for step in range(asked.steps + 1):
            if step:
                for place, row in commands.items():
                    data.ctrl[place] = row[step - 1]
                mj.mj_step(model, data)
                touched = touched or data.ncon > 0
            if step % asked.every == 0 or step == asked.steps:
                mj.mj_kinematics(model, data)
                mj.mj_comPos(model, data)
                seen = step * dt, data.qpos, data.xpos[1], data.xquat[1], data.subtree_com[0]
                rows.append(tuple(np.array(each) for each in seen))
    time, q, root, turn, com = (np.array(column) for column in zip(*rows, strict=True))
    joints = {name: q[:, model.jnt_qposadr[j]] for name, j in mujoco.joints(model).items()}
    failure = "" if mujoco.is_finite(data) else "the simulation became unstable"
    return Outcome(None, Motion(time, joints, root, turn, com, touched), failure)
