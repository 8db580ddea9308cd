"""The drives of a compiled MuJoCo model, in the coordinates of the joints that they move.

MuJoCo's law for an actuator with the transmission `joint` of gear `g`, with length = g q:
force = clip(gain(ctrl) + bias(length, velocity), forcerange) and torque = g force. The torques of
all actuators of a joint add up and are clipped to its `actuatorfrcrange`. A fixed tendon over
joints that follow one another drives the one that leads: see `levers`.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Literal, TypeVar

from assetbuild.grouping import grouped
from assetbuild.robot.model import Actuator, Control
from assetbuild.robot.pose import Array
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import Data, Model, mj
from assetbuild.simulators.mujoco.linear_couplings import tendon_lever

Kind = Literal["servo", "velocity", "motor", "general"]
Number = TypeVar("Number", float, Array)
Range = tuple[float, float]
"""(lower, upper); infinite where nothing limits."""
UNLIMITED: Range = (-math.inf, math.inf)
OUTSIDE = frozenset({"ideal_pd", "dc_motor", "motor"})
"""Actuator models whose PD law acts outside of the simulator, by kp and kd of the table."""


@dataclass(frozen=True)
class Drive:
    """One actuator on one hinge or slide; torques are N m or N on the joint, positions rad or m.

    index: of the actuator; ctrl_index: of its command in `data.ctrl`; joint: number of the joint.
    kind: `servo`, `velocity` and `motor` are the laws of MuJoCo's elements `position`, `velocity`
    and `motor`; everything else is `general`.
    gain, constant: torque = gain ctrl + constant - kp q - kd qdot, before limits. kp: N m/rad or
    N/m; kd: N m s/rad or N s/m. For a gain or bias that is not affine in ctrl, q and qdot (a
    muscle, a damper), these are the values at q = qdot = 0, and `is_affine` is False.
    filtered: the command passes through an activation first.
    torque, ctrl: limits; on_joint: the torque within the joint's own `actuatorfrcrange`.
    """

    index: int
    ctrl_index: int
    joint: int
    joint_name: str
    kind: Kind
    gear: float
    gain: float
    constant: float
    kp: float
    kd: float
    is_affine: bool
    filtered: bool
    torque: Range
    on_joint: Range
    ctrl: Range

    @property
    def holds_position(self) -> bool:
        """Whether a constant command pulls the joint to one position; a growing one, further."""
        return self.is_affine and self.kp > 0.0 and self.gain * self.gear > 0.0

    def command(self, position: Number) -> Number:
        """The command at which a drive that holds positions is at rest at `position`."""
        return (self.kp * position - self.constant) / self.gain

    def command_step(self, turn: float) -> float:
        """The change of the command that asks for `turn` more of the position."""
        return self.kp * turn / self.gain

    def target(self, command: float) -> float:
        """The position at which a drive that holds positions is at rest under `command`."""
        return (self.gain * command + self.constant) / self.kp


def read_drives(model: Model) -> tuple[Drive, ...]:
    """The actuators that drive hinges and slides, in order; others are left out."""
    drives = (read_drive(model, index) for index in mujoco.actuators(model))
    return tuple(drive for drive in drives if drive is not None)


def read_drive(model: Model, index: int) -> Drive | None:
    """One actuator; None when its transmission is no hinge or slide, nor joints that one leads."""
    straight = (int(mj.mjtTrn.mjTRN_JOINT), int(mj.mjtTrn.mjTRN_JOINTINPARENT))
    joint = int(model.actuator_trnid[index, 0])
    if int(model.actuator_trntype[index]) in straight and mujoco.turns(model, joint):
        return _drive(model, index, joint, float(model.actuator_gear[index, 0]))
    lever = tendon_lever(model, index)
    return _drive(model, index, *lever) if lever else None


def aim(model: Model, data: Data, joints: Collection[str] | None = None) -> None:
    """Drives that hold positions hold their joints where these are. joints: None = all."""
    for drive in read_drives(model):
        if drive.holds_position and (joints is None or drive.joint_name in joints):
            position = float(data.qpos[model.jnt_qposadr[drive.joint]])
            data.ctrl[drive.ctrl_index] = drive.command(position)


def drive_as(model: Model, gains: Mapping[str, Actuator], *, others: bool = True) -> None:
    """Turn actuators of some joints into position servos inside of the simulator.

    For models whose law runs outside (`ideal_pd`, `motor`, ...). Keyframes, which command such a
    motor no torque, command the servo their own pose. Of several actuators of a joint, the first
    becomes the servo and the others pull no more. others: whether other joints' still pull.
    """
    drives = {drive.index: drive for drive in read_drives(model)}
    free = dict(gains)
    for index in mujoco.actuators(model):
        name = drives[index].joint_name if index in drives else ""
        actuator = free.pop(name, None)
        if actuator is None and (name in gains or not others):
            model.actuator_gear[index] = 0.0
        if actuator is None:
            continue
        joint = drives[index].joint
        model.actuator_trntype[index] = mj.mjtTrn.mjTRN_JOINT
        model.actuator_trnid[index] = (joint, -1)
        model.actuator_gear[index, 0] = 1.0
        model.actuator_gaintype[index] = mj.mjtGain.mjGAIN_FIXED
        model.actuator_biastype[index] = mj.mjtBias.mjBIAS_AFFINE
        model.actuator_gainprm[index, :3] = (actuator.kp, 0.0, 0.0)
        model.actuator_biasprm[index, :3] = (0.0, -actuator.kp, -actuator.kd)
        model.actuator_ctrllimited[index] = 0
        model.key_ctrl[:, index] = model.key_qpos[:, int(model.jnt_qposadr[joint])]
        if actuator.effort is not None:
            model.actuator_forcelimited[index] = 1
            model.actuator_forcerange[index] = (-actuator.effort, actuator.effort)


def servoed(model: Model, control: Control, laws: Collection[str] = OUTSIDE) -> Model:
    """A copy in which servos stand in for the drives whose law (`Actuator.model`) is outside; the
    model itself where there are none.

    How such a law does in steps of its own, `gains.unstable` says.
    """
    outside = {a.joint: a for a in control.actuators if a.model in laws}
    if not outside:
        return model
    changed = copy.copy(model)
    drive_as(changed, outside)
    return changed


def torques(model: Model) -> dict[int, Range]:
    """What all drives of each joint can apply, within its own `actuatorfrcrange`, N m or N."""
    by_joint = grouped(read_drives(model), lambda drive: drive.joint)
    ends = {joint: [drive.torque for drive in drives] for joint, drives in by_joint.items()}
    return {joint: _on_joint(model, joint, (sum(low for low, _ in each), sum(up for _, up in each)))
            for joint, each in ends.items()}  # fmt: skip


def _drive(model: Model, index: int, joint: int, gear: float) -> Drive:
    gain_type, gain = int(model.actuator_gaintype[index]), model.actuator_gainprm[index]
    bias_type, bias = int(model.actuator_biastype[index]), model.actuator_biasprm[index]
    fixed = gain_type == int(mj.mjtGain.mjGAIN_FIXED)
    biased = bias_type == int(mj.mjtBias.mjBIAS_AFFINE)
    unbiased = bias_type == int(mj.mjtBias.mjBIAS_NONE)
    slope = gain_type == int(mj.mjtGain.mjGAIN_AFFINE) and not gain[1:3].any()
    dynamics = int(model.actuator_dyntype[index])
    filters = (mj.mjtDyn.mjDYN_FILTER, mj.mjtDyn.mjDYN_FILTEREXACT)
    filtered = dynamics in (int(kind) for kind in filters)
    # An integrator sums its command up, so no command belongs to a position.
    settles = filtered or dynamics == int(mj.mjtDyn.mjDYN_NONE)
    is_affine = (fixed or slope) and (biased or unbiased) and settles
    constant, stiff, viscous = (float(v) for v in bias[:3]) if biased else (0.0, 0.0, 0.0)
    kind = _kind(float(gain[0]), (constant, stiff, viscous))
    torque = _torque(model, index, gear, plain=is_affine and unbiased)
    return Drive(
        index=index,
        ctrl_index=mujoco.first_command(model, index),
        joint=joint,
        joint_name=mujoco.name_of(model, "joint", joint),
        kind=kind if is_affine else "general",
        gear=gear,
        gain=gear * float(gain[0]),
        constant=gear * constant,
        kp=0.0 - gear * gear * stiff,
        kd=0.0 - gear * gear * viscous,
        is_affine=is_affine,
        filtered=filtered,
        torque=torque,
        on_joint=_on_joint(model, joint, torque),
        ctrl=_range(model.actuator_ctrllimited[index], model.actuator_ctrlrange[index]),
    )


def _kind(gain: float, bias: tuple[float, float, float]) -> Kind:
    if not any(bias):
        return "motor"
    if gain > 0.0 and bias[:2] == (0.0, -gain):
        return "servo"
    if gain > 0.0 and bias == (0.0, 0.0, -gain):
        return "velocity"
    return "general"


def _torque(model: Model, index: int, gear: float, *, plain: bool) -> Range:
    """Limits on the joint, N m or N.

    plain: the force is gain x ctrl, so that limits of the command limit the force as well.
    """
    force = _range(model.actuator_forcelimited[index], model.actuator_forcerange[index])
    if plain and model.actuator_ctrllimited[index]:
        asked = float(model.actuator_gainprm[index, 0]) * model.actuator_ctrlrange[index]
        force = _inside(force, (float(asked.min()), float(asked.max())))
    ends = [gear * end if gear else 0.0 for end in force]
    return min(ends), max(ends)


def _on_joint(model: Model, joint: int, torque: Range) -> Range:
    """Clipped to what the joint takes in all."""
    return _inside(torque, _range(model.jnt_actfrclimited[joint], model.jnt_actfrcrange[joint]))


def _inside(one: Range, other: Range) -> Range:
    """`one` clipped to `other`, as MuJoCo clips forces."""
    low, high = (min(max(end, other[0]), other[1]) for end in one)
    return low, high


def _range(limited: bool, ends: Array) -> Range:
    return (float(ends[0]), float(ends[1])) if limited else UNLIMITED
