"""Stretches of a log, and the drives of its joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from assetbuild.robot.pose import Array

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
    """Without what is faster than the joints move; no lag."""
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
    """(N, 6) smoothed poses of the root, see `base`; None = it stood still."""

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
        """Without a beginning in which the joints speed up: its state could not be read off."""
        rate = 1.0 / self.period_s
        within = max(1, min(int(QUIET_S * rate), len(self.position) // 4))
        q = smooth(self.position[: within + 2 * self.lead + int(0.5 * rate)], rate)
        speed = np.gradient(q, self.period_s, axis=0)
        change = np.gradient(speed, self.period_s, axis=0)
        scale = np.std(change, axis=0) + 1e-9
        loud = np.max(np.abs(change) / scale, axis=1)
        width = 2 * self.lead + 1
        loudest = np.array([loud[n : n + width].max() for n in range(within)])
        return self.after(int(np.argmin(loudest)))

    def after(self, sample: int) -> Record:
        """The record from a sample on."""
        return self._part(slice(sample, None))

    def until(self, sample: int) -> Record:
        """The record before a sample."""
        return self._part(slice(0, sample))

    def _part(self, part: slice) -> Record:
        others = [None if all_ is None else all_[part] for all_ in (self.torque, self.base)]
        return Record(self.period_s, self.position[part], self.target[part], *others)
