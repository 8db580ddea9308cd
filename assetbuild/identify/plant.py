"""The robot on its stand, simulated by MuJoCo under the controller that recorded the log."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from assetbuild.errors import StepError
from assetbuild.identify.record import (
    OF_JOINTS,
    Drive,
    Moving,
    Record,
    commands,
    on_moving_base,
    speeds,
)
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Actuator, Control, Tree
from assetbuild.robot.pose import IDENTITY, Array
from assetbuild.robot.shapes import Shapes
from assetbuild.simulators.mujoco import caught_warnings, mass_matrix, mj
from assetbuild.targets.mjcf.files import robot_element
from assetbuild.targets.mjcf.robot_xml import MjcfOptions, RobotXml
from assetbuild.targets.mjcf.xml import document

LONGEST_S = 0.001
"""Longest steps of the simulation: the fitted numbers are those of continuous time."""
STEPS_S = ((0.3, LONGEST_S), (0.7, LONGEST_S / 2.0), (math.inf, LONGEST_S / 4.0))
"""Shorter ones, by the share of a light joint's speed that its damping takes in the longest."""
CHUNK = 4000
"""Steps that are simulated at once, so that memory is bounded."""
AT_ONCE = 16
"""Variants that are simulated together, for the same reason."""
UNEVEN = 0.02
"""Share by which a period may miss a whole number of steps: clocks of logs are not exact."""
HELD, HELD_RAD_S = 1e3, 100.0
"""Joints that no log holds: their armature, in largest inertias of the others; of their spring."""


class Plant:
    """A model whose joints `joints` have drives, and whose other joints are held."""

    def __init__(
        self,
        tree: Tree,
        control: Control,
        joints: Sequence[str],
        gravity: tuple[float, float, float],
        simulator_step: float | None = None,
        moving: bool = False,
    ) -> None:
        """simulator_step: s, of the simulator that recorded the logs; None = the real robot.

        moving: the root moves as the records say.
        """
        self.joints = tuple(joints)
        self.simulator_step = simulator_step
        self.model, self.base = _compiled(tree, control, joints, moving)
        model = self.model
        model.opt.gravity[:] = gravity
        model.opt.disableflags |= int(mj.mjtDisableBit.mjDSBL_CONTACT)
        model.opt.integrator = mj.mjtIntegrator.mjINT_IMPLICITFAST
        model.actuator_ctrllimited[:] = 0
        model.actuator_forcelimited[:] = 1
        model.actuator_forcelimited[list(self.base.drive)] = 0
        views = [model.joint(name) for name in joints]
        self.dof = np.array([int(joint.dofadr[0]) for joint in views])
        self.at = np.array([int(joint.qposadr[0]) for joint in views])
        drives = {int(model.actuator_trnid[a][0]): a for a in range(len(model.actuator_trntype))}
        self.drive = np.array([drives[joint.id] for joint in views])
        self.rest = _rest(model, tree, control)
        self.moved = _moved(model, self.dof)
        self.inertia = self._inertia()
        self._hold_others()
        self.longest_s = LONGEST_S

    def in_steps(self, longest_s: float) -> Plant:
        """The same in steps of so many seconds at most; of a simulator's log they stay."""
        plant = copy.copy(self)
        plant.longest_s = longest_s
        return plant

    def longest_for(self, drives: Sequence[Drive]) -> float:
        """s: the steps that these drives need."""
        armature = np.array([drive.armature for drive in drives])
        damped = np.array([drive.damping + drive.kd for drive in drives])
        taken = float(np.max(LONGEST_S * damped / (self.inertia + armature)))
        return next(step for share, step in STEPS_S if taken <= share)

    def changed(self, drives: Sequence[Drive], dt: float) -> Any:  # Any: mujoco.MjModel
        """A copy of the model with these drives, in the order of `joints`, and a timestep.

        MuJoCo takes damping at the end of each step, which acts as dt/2 of it more inertia. Where
        the log is the real robot's, as much is taken off, and the step is of second order.
        """
        model = copy.copy(self.model)
        model.opt.timestep = dt
        table = np.array([[d.armature, d.damping, d.friction] for d in drives])
        late = np.zeros(len(drives))
        if self.simulator_step is None:
            late = dt / 2.0 * (table[:, 1] + np.array([d.kd for d in drives]))
            # No more than leaves all inertias positive.
            late = np.minimum(late, 0.25 * (self.inertia + table[:, 0]))
        model.dof_armature[self.dof], model.dof_damping[self.dof] = table[:, 0], table[:, 1]
        model.dof_frictionloss[self.dof] = table[:, 2]
        for actuator, drive in zip(self.drive, drives, strict=True):
            model.actuator_gainprm[actuator, 0] = drive.kp
            model.actuator_biasprm[actuator, :3] = drive.offset, -drive.kp, -drive.kd
            model.actuator_forcerange[actuator] = -drive.effort, drive.effort
        # MuJoCo's friction creeps by an amount that depends on the inertia of the joints.
        mj.mj_setConst(model, mj.MjData(model))
        model.dof_armature[self.dof] -= late
        # The solver stops by it, and held joints would make it stop at once.
        model.stat.meaninertia = float(np.mean(self.inertia + table[:, 0]))
        return model

    def simulate(self, record: Record, variants: Sequence[Sequence[Drive]]) -> tuple[Array, Array]:
        """Position and drive torque at the samples, (variants, N, J) each.

        The first samples, from which the simulation begins, are the measured ones.
        """
        parts = [
            self._simulate(record, variants[first : first + AT_ONCE])
            for first in range(0, len(variants), AT_ONCE)
        ]
        q, torque = (np.concatenate(part) for part in zip(*parts, strict=True))
        return q, torque

    def _simulate(self, record: Record, variants: Sequence[Sequence[Drive]]) -> tuple[Array, Array]:
        from mujoco import rollout

        if self.simulator_step is None:
            stride = math.ceil(record.period_s / self.longest_s - 1e-6)
        else:
            stride = _whole_steps(record, self.simulator_step)
        dt = record.period_s / stride
        models = [self.changed(drives, dt) for drives in variants]
        lead, (q0, v0) = record.lead, record.begin()
        targets = np.repeat(record.target[:-1], stride, axis=0)
        data = mj.MjData(models[0])
        data.qpos[:] = self.rest
        data.qpos[self.at] = q0
        data.qvel[self.dof] = v0
        kind = mj.mjtState.mjSTATE_FULLPHYSICS
        if record.base is not None:
            data.qpos[list(self.base.at)] = record.base[lead]
            data.qvel[list(self.base.dof)] = speeds(record.base, record.period_s)[0][lead]
        state = np.zeros(mj.mj_stateSize(models[0], kind))
        mj.mj_getState(models[0], data, state, kind)
        states = np.repeat(state[None], len(models), axis=0)
        held = np.zeros((len(models), len(targets), models[0].nu))
        # A step of MuJoCo is a kick in its middle: a command that holds from t on acts from t on
        # only if it comes half a step later.
        half = 0.5 if self.simulator_step is None else 0.0
        sent = [
            np.stack(
                [_delayed(targets[:, j], d.delay / dt + half) for j, d in enumerate(drives)], axis=1
            )
            for drives in variants
        ]
        held[:, :, self.drive] = np.array(sent)
        if record.base is not None:
            at = np.arange(len(targets)) / stride
            held[:, :, list(self.base.drive)] = commands(record.base, record.period_s, at)
        chunk = max(1, CHUNK // stride) * stride
        known, count = record.position[None, : lead + 1], len(models)
        q = [np.repeat(known, count, axis=0)]
        v = [np.repeat(v0[None, None], count, axis=0).repeat(lead + 1, axis=1)]
        datas, first = [data], 1 + models[0].nq
        for start in range(lead * stride, len(targets), chunk):
            with caught_warnings():  # one that is unstable does not fit, which is enough
                part, _ = rollout.rollout(models, datas, states, held[:, start : start + chunk])
            states = part[:, -1].copy()
            sampled = part[:, stride - 1 :: stride]
            q.append(sampled[:, :, 1 + self.at])
            v.append(sampled[:, :, first + self.dof])
        position, velocity = np.concatenate(q, axis=1), np.concatenate(v, axis=1)
        return position, _torque(position, velocity, variants, record)

    def _hold_others(self) -> None:
        """Joints that no log holds stay where they are: heavy, on a spring without swing.

        Not heavier than needed: beside 1e9 kg m2 the solver lost the friction of the others.
        """
        model = self.model
        heavy = HELD * float(np.max(self.inertia))
        coupled = model.eq_type == int(mj.mjtEq.mjEQ_JOINT)
        followers = [int(joint) for joint in model.eq_obj1id[coupled]]
        for joint in range(model.njnt):
            dof, at = int(model.jnt_dofadr[joint]), int(model.jnt_qposadr[joint])
            if dof in self.dof or dof in self.base.dof or joint in followers:
                continue
            model.dof_armature[dof] = heavy
            model.dof_damping[dof] = 2.0 * HELD_RAD_S * heavy
            model.jnt_stiffness[joint] = 0.0
            model.jnt_stiffness.reshape(model.njnt, -1)[joint, 0] = HELD_RAD_S**2 * heavy
            model.qpos_spring[at] = self.rest[at]

    def _inertia(self) -> Array:
        """(J,) what a torque at each joint moves at rest, without armatures, kg m2 or kg."""
        data = mj.MjData(self.model)
        data.qpos[:] = self.rest
        mj.mj_forward(self.model, data)
        inverse = np.linalg.pinv(mass_matrix(self.model, data)[np.ix_(self.dof, self.dof)])
        felt: Array = 1.0 / np.maximum(np.diag(inverse), 1e-12)
        return felt

    def rigid_torque(
        self, q: Array, v: Array, a: Array, base: tuple[Array, Array, Array] | None = None
    ) -> Array:
        """(N, J) torque that the links alone need for a motion, by inverse dynamics.

        q, v, a: (N, J); base: the same of the root, (N, 6). Without armature, damping, friction
        and limits.
        """
        model = copy.copy(self.model)
        model.opt.disableflags |= int(mj.mjtDisableBit.mjDSBL_CONSTRAINT)
        model.opt.disableflags |= int(mj.mjtDisableBit.mjDSBL_ACTUATION)
        model.dof_armature[:], model.dof_damping[:] = 0.0, 0.0
        data = mj.MjData(model)
        data.qpos[:] = self.rest
        torque = np.zeros_like(q)
        for n in range(len(q)):
            data.qpos[self.at], data.qvel[self.dof], data.qacc[self.dof] = q[n], v[n], a[n]
            if base is not None:
                at, dof = list(self.base.at), list(self.base.dof)
                data.qpos[at], data.qvel[dof], data.qacc[dof] = (part[n] for part in base)
            mj.mj_inverse(model, data)
            torque[n] = data.qfrc_inverse[self.dof]
        return torque


def _compiled(
    tree: Tree, control: Control, joints: Sequence[str], moving: bool
) -> tuple[Any, Moving]:  # Any: as above
    stand = replace(tree, base="fixed", X_world_root=IDENTITY)
    rows = []
    for joint in tree.moving_joints:
        driven = Actuator(joint.name, "pd", kp=1.0, effort=1.0)
        rows.append(driven if joint.name in joints else Actuator(joint.name, "passive"))
    opaque = tuple(item for item in control.mjcf_only if item.place in OF_JOINTS)
    stand_control = Control(actuators=tuple(rows), loops=control.loops)
    xml = RobotXml("stand", MjcfOptions(), stand, Shapes(), stand_control)
    root = robot_element(xml, opaque, bare=True)
    text = document(root, "")
    if moving:
        return on_moving_base(text)
    return mj.MjModel.from_xml_string(text), Moving((), (), ())


def _rest(model: Any, tree: Tree, control: Control) -> Array:  # Any: as above
    """Where joints are that no log holds: in the robot's initial pose."""
    rest = np.array(model.qpos0, float)
    pose: Mapping[str, float] = dict(initial_pose(tree, control).joints)
    for joint in range(model.njnt):
        name = str(model.joint(joint).name)
        if name in pose:
            rest[int(model.jnt_qposadr[joint])] = pose[name]
    return rest


def _moved(model: Any, dof: Array) -> tuple[frozenset[int], ...]:  # Any: as above
    """List for each joint those that feel it: joints beyond it, and before it up to where the
    branch forks. An arm also shakes the torso and by that the other arm, but that is little."""
    if model.neq or model.ntendon:
        return (frozenset(range(len(dof))),) * len(dof)
    parent = [int(p) for p in model.dof_parentid]
    children = [sum(p == d for p in parent) for d in range(len(parent))]
    numbers = {int(d): j for j, d in enumerate(dof)}

    def chain(address: int, forks: bool) -> Iterator[int]:
        while address >= 0:
            yield address
            address = parent[address]
            if not forks and address >= 0 and children[address] > 1:
                return

    affected = [{numbers[d] for d in chain(int(a), False) if d in numbers} for a in dof]
    for j, address in enumerate(dof):
        for d in chain(int(address), True):
            if d in numbers:
                affected[numbers[d]].add(j)
    return tuple(map(frozenset, affected))


def _delayed(target: Array, steps: float) -> Array:
    """The command that arrives: `steps` later, between two steps their mean by weight."""
    whole = int(np.floor(steps))
    share = steps - whole
    padded = np.concatenate([np.full(whole + 1, target[0]), target])
    late = padded[1 : len(target) + 1]
    later = padded[: len(target)]
    mixed: Array = (1.0 - share) * late + share * later
    return mixed


def _torque(
    q: Array,
    v: Array,
    variants: Sequence[Sequence[Drive]],
    record: Record,
) -> Array:
    """What the drives make at the samples."""
    gains = np.array([[[d.kp, d.kd, d.offset, d.effort] for d in one] for one in variants])
    kp, kd, offset, effort = (gains[:, None, :, i] for i in range(4))
    n = np.arange(len(record.target))
    u = np.empty_like(q)
    for one, drives in zip(u, variants, strict=True):
        for j, drive in enumerate(drives):
            late = (drive.delay + drive.lag) / record.period_s
            one[:, j] = np.interp(n - late, n, record.target[:, j])
    force: Array = np.clip(offset + kp * (u - q) - kd * v, -effort, effort)
    return force


def _whole_steps(record: Record, step_s: float) -> int:
    """Steps of the simulator between two samples. StepError where they do not fit."""
    steps = record.period_s / step_s
    if round(steps) < 1 or abs(steps - round(steps)) > UNEVEN * round(steps):
        raise StepError(
            f"`simulator_step` {step_s:g} s does not go into the {record.period_s:g} s between the "
            "samples of a log",
            hint="state the step with which the simulator ran; leave it out for a real robot",
        )
    return round(steps)
