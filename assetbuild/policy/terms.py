"""Observations by name: what a policy sees of a robot, in any engine."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from assetbuild.policy.stated import Policy, Term
from assetbuild.robot.pose import Array, rotation_of

DOWN = np.array((0.0, 0.0, -1.0))


@dataclass(frozen=True)
class Seen:
    """The state of a robot. q, v: of joints by name, rad, rad/s, m, m/s.

    place: (3,) m; quat: w, x, y, z of the base. linear, angular: (3,) of the base's origin, in the
    base's frame, m/s and rad/s. time: s.
    """

    time: float
    place: Array
    quat: Array
    linear: Array
    angular: Array
    q: Mapping[str, float]
    v: Mapping[str, float]

    @property
    def gravity(self) -> Array:
        """(3,) the direction of gravity in the base's frame."""
        w, x, y, z = (float(v) for v in self.quat)
        return np.asarray(rotation_of((w, x, y, z)).T @ DOWN)


@dataclass(frozen=True)
class Now:
    """What else an observation needs. at: (R, p) of the IMU in the base, its turn and place."""

    seen: Seen
    command: Array
    action: Array
    position: Mapping[str, float]
    imu: tuple[Array, Array]


def _joints(values: Mapping[str, float], term: Term, less: Mapping[str, float]) -> Array:
    return np.array([values[name] - less.get(name, 0.0) for name in term.joints])


def _imu_velocity(now: Now, _: Term) -> Array:
    turn, place = now.imu
    return np.asarray(turn.T @ (now.seen.linear + np.cross(now.seen.angular, place)))


def _phase(now: Now, term: Term) -> Array:
    angle = 2.0 * math.pi * now.seen.time / term.params["period"]
    return np.array((math.sin(angle), math.cos(angle)))


FUNCTIONS: Mapping[str, Callable[[Now, Term], Array]] = {
    "base_lin_vel": lambda now, _: now.seen.linear,
    "base_ang_vel": lambda now, _: now.seen.angular,
    "imu_lin_vel": _imu_velocity,
    "imu_ang_vel": lambda now, _: now.imu[0].T @ now.seen.angular,
    "projected_gravity": lambda now, _: now.seen.gravity,
    "velocity_commands": lambda now, _: now.command,
    "joint_pos": lambda now, term: _joints(now.seen.q, term, {}),
    "joint_pos_rel": lambda now, term: _joints(now.seen.q, term, now.position),
    "joint_vel_rel": lambda now, term: _joints(now.seen.v, term, {}),
    "last_action": lambda now, _: now.action,
    "gait_phase": _phase,
}
"""What every reader's own words are translated into."""


def unknown(term: Term) -> str:
    """Why an observation cannot be computed; "" where it can."""
    if term.function not in FUNCTIONS:
        return f"`{term.function}` is not known; known: {', '.join(FUNCTIONS)}"
    is_short = term.function == "gait_phase" and not term.params.get("period")
    return "the period of its gait is not stated" if is_short else ""


def width(term: Term, policy: Policy) -> int:
    """How many numbers one step of an observation has; 0 of one that is not known."""
    if term.function.startswith("joint_"):
        return len(term.joints)
    if term.function == "gait_phase":
        return 2
    if term.function == "last_action":
        return len(policy.acts_on)
    return 3 if term.function in FUNCTIONS else 0


def sees(policy: Policy) -> int:
    """How many numbers the observations of a policy are."""
    return sum(width(term, policy) * term.history for term in policy.terms)


class Observer:
    """Puts observations together as the policy was trained to see them."""

    def __init__(self, policy: Policy) -> None:
        self.policy = policy
        self._past: list[deque[Array]] = [deque(maxlen=term.history) for term in policy.terms]

    def look(self, now: Now) -> Array:
        """(n,) float32, of this step and, of terms with a history, of those before it."""
        for term, past in zip(self.policy.terms, self._past, strict=True):
            value = self._scaled(term, FUNCTIONS[term.function](now, term))
            # A history begins as if the robot had stood still before.
            past.extend([value] * (1 if past else term.history))
        parts = [row for past in self._past for row in past]
        if self.policy.by_time:
            steps = range(max(len(past) for past in self._past))
            parts = [past[step] for step in steps for past in self._past]
        return np.concatenate(parts).astype(np.float32)

    def _scaled(self, term: Term, value: Array) -> Array:
        """Isaac Lab and mjlab clip first."""
        scale = np.asarray(term.scale)
        if self.policy.scale_first:
            value = value * scale
        if term.clip is not None:
            value = np.clip(value, *term.clip)
        return value if self.policy.scale_first else np.asarray(value * scale)
