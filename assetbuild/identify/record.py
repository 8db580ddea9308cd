"""Stretches of a log, the drives of its joints, and a root that moves as the log says.

The root hangs on six heavy joints whose drives follow the measured pose. A pose is (x, y, z, yaw,
pitch, roll), m and rad: R = Rz(yaw) Ry(pitch) Rx(roll).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from assetbuild.errors import StepError
from assetbuild.robot.pose import Array
from assetbuild.simulators.mujoco import mj

HEAVY, RAD_S = 1e3, 100.0
"""Inertia of the driven joints, in those of the robot; of their drives."""
LIGHT = 1e-3
"""kg and kg m2 of a root without mass."""
STEEPEST = 1.4
"""rad of pitch, beyond which yaw and roll are one."""
AXES = (((1, 0, 0), (0, 1, 0), (0, 0, 1)), ((0, 0, 1), (0, 1, 0), (1, 0, 0)))
"""Axes of the three slides, then of the three hinges, in the order in which they move the root."""


def poses(quaternions: Array, positions: Array | None, file: str) -> Array:
    """(N, 6) of (N, 4) wxyz and (N, 3). StepError where they are no orientations."""
    norm = np.linalg.norm(quaternions, axis=1)
    wrong = np.flatnonzero(np.abs(norm - 1.0) > 0.05)
    if len(wrong):
        raise StepError(
            f"{file}: the orientation of the base in row {wrong[0] + 1} has the norm "
            f"{norm[wrong[0]]:.3g}, that of a unit quaternion is 1",
            hint="`base_orientation` names four columns; `{axis}` stands for w, x, y and z",
        )
    w, x, y, z = (quaternions / norm[:, None]).T
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    if np.max(np.abs(pitch)) > STEEPEST:
        raise StepError(
            f"{file}: the base pitches by {np.max(np.abs(pitch)):.3g} rad, at most {STEEPEST:g} "
            "can be followed",
            hint="choose an `interval` in which it stands less steep",
        )
    yaw = np.unwrap(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
    roll = np.unwrap(np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)))
    place = np.zeros((len(yaw), 3)) if positions is None else positions
    return np.concatenate([place, np.stack([yaw, pitch, roll], axis=1)], axis=1)


@dataclass(frozen=True)
class Moving:
    """Addresses of the six joints in a model."""

    at: tuple[int, ...]
    dof: tuple[int, ...]
    drive: tuple[int, ...]


def on_moving_base(text: str) -> tuple[Any, Moving]:  # Any: mujoco.MjModel
    """The MJCF of a robot on a fixed root, on six driven joints instead."""
    spec = mj.MjSpec.from_string(text)
    root = spec.worldbody.first_body()
    if not root.explicitinertial:  # the drives carry it, whatever it weighs
        root.explicitinertial, root.mass, root.inertia = True, LIGHT, (LIGHT, LIGHT, LIGHT)
    kinds = (mj.mjtJoint.mjJNT_SLIDE, mj.mjtJoint.mjJNT_HINGE)
    names: list[str] = []
    for kind, axes in zip(kinds, AXES, strict=True):
        for axis in axes:
            names.append(f"assetbuild_base_{len(names)}")
            root.add_joint(name=names[-1], type=kind, axis=axis)
            spec.add_actuator(name=names[-1], target=names[-1], trntype=mj.mjtTrn.mjTRN_JOINT)
    model = spec.compile()
    joints = [model.joint(name) for name in names]
    moving = Moving(
        tuple(int(joint.qposadr[0]) for joint in joints),
        tuple(int(joint.dofadr[0]) for joint in joints),
        tuple(int(model.actuator(name).id) for name in names),
    )
    _drive(model, moving)
    return model, moving


def _drive(model: Any, moving: Moving) -> None:  # Any: as above
    mass = float(np.sum(model.body_mass))
    reach = max(1.0, float(np.max(np.abs(model.body_pos))) * 3.0)
    heavy = HEAVY * mass * reach**2
    for dof, drive in zip(moving.dof, moving.drive, strict=True):
        model.dof_armature[dof] = heavy
        model.dof_damping[dof] = model.dof_frictionloss[dof] = 0.0
        model.actuator_gaintype[drive] = int(mj.mjtGain.mjGAIN_FIXED)
        model.actuator_biastype[drive] = int(mj.mjtBias.mjBIAS_AFFINE)
        model.actuator_gainprm[drive, 0] = heavy * RAD_S**2
        model.actuator_biasprm[drive, :3] = 0.0, -heavy * RAD_S**2, -2.0 * heavy * RAD_S
        model.actuator_forcelimited[drive] = 0


def speeds(values: Array, period_s: float) -> tuple[Array, Array]:
    """First and second derivative of samples, in the first dimension."""
    first: Array = np.gradient(values, period_s, axis=0)
    second: Array = np.gradient(first, period_s, axis=0)
    return first, second


def commands(pose: Array, period_s: float, at: Sequence[float] | Array) -> Array:
    """(len(at), 6) what makes the drives be at the pose, at these samples, which need not be whole.

    u = q + 2 v / w + a / w^2 undoes the lag of a heavy joint on a spring without swing.
    """
    first, second = speeds(pose, period_s)
    ahead = pose + 2.0 * first / RAD_S + second / RAD_S**2
    n = np.arange(len(pose))
    return np.stack([np.interp(at, n, column) for column in ahead.T], axis=1)


CUTOFF_HZ = 20.0
LEAD_S = 0.03
QUIET_S = 1.5
"""A calm moment is looked for in so much of the beginning of a record."""
OF_JOINTS = ("joint", "equality", "tendon", "mimic")
"""Places of `MjcfOnly` that move joints; the others need shapes, or are drives."""


def cutoff_hz(rate_hz: float) -> float:
    """Where `smooth` cuts a record of so many samples in a second."""
    return min(CUTOFF_HZ, 0.2 * rate_hz)


def smooth(values: Array, rate_hz: float) -> Array:
    """Remove what is faster than the joints move; no lag."""
    from scipy import signal

    cutoff = cutoff_hz(rate_hz)
    sections = signal.butter(4, cutoff, fs=rate_hz, output="sos")
    short = min(len(values) - 1, int(3 * rate_hz / cutoff))
    filtered: Array = signal.sosfiltfilt(sections, values, axis=0, padlen=short)
    return filtered


@dataclass(frozen=True)
class Drive:
    """A joint of the log: gains of the controller, what the joint itself has, delay in s.

    offset: constant torque, which stands for a zero that is off, a cable, a sensor's bias.
    lag: s, by which the command in a measured torque is older than the position of the same row.
    """

    kp: float
    kd: float
    armature: float
    damping: float
    friction: float
    effort: float
    delay: float = 0.0
    offset: float = 0.0
    lag: float = 0.0


@dataclass(frozen=True)
class Record:
    """A stretch of a log without a gap, on a uniform grid. J: joints of the log.

    period_s: of the samples. position, target, torque: (N, J); target[n] holds from sample n on.
    """

    period_s: float
    position: Array
    target: Array
    torque: Array | None = None
    base: Array | None = None
    """(N, 6) smoothed poses of the root; None = it stood still."""

    @property
    def lead(self) -> int:
        """Samples before the simulation begins: what it begins with is read off around there."""
        return max(2, round(LEAD_S / self.period_s))

    def begin(self) -> tuple[Array, Array]:
        """(J,) position and velocity at sample `lead`, of the parabola through its neighbours.

        A joint that sticks remembers where it began, so the state must be right.
        """
        n = np.arange(-self.lead, self.lead + 1)
        terms = np.stack([np.ones(len(n)), n * self.period_s, (n * self.period_s) ** 2], axis=1)
        x, *_ = np.linalg.lstsq(terms, self.position[: len(n)], rcond=None)
        return x[0], x[1]

    def from_rest(self) -> Record:
        """Cut off a beginning in which the joints speed up: its state could not be read off."""
        rate = 1.0 / self.period_s
        within = max(1, min(int(QUIET_S * rate), len(self.position) // 4))
        q = smooth(self.position[: within + 2 * self.lead + int(0.5 * rate)], rate)
        _, change = speeds(q, self.period_s)
        scale = np.std(change, axis=0) + 1e-9
        loud = np.max(np.abs(change) / scale, axis=1)
        width = 2 * self.lead + 1
        loudest = np.array([loud[n : n + width].max() for n in range(within)])
        return self[int(np.argmin(loudest)) :]

    def __getitem__(self, part: slice) -> Record:
        """The record between two samples."""
        others = [None if all_ is None else all_[part] for all_ in (self.torque, self.base)]
        return Record(self.period_s, self.position[part], self.target[part], *others)
