"""What is asked of every simulator, and what comes back: plain values, no engine.

A simulator answers as these types, so that a check can lay two answers side by side.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from assetbuild.findings import Finding, Rule
from assetbuild.quantities import Model, Positive
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Control, Joint, Tree
from assetbuild.robot.pose import Array

SWING_RAD = 0.3
SWING_M = 0.05
SHARE_OF_RANGE = 0.2
"""Largest swing as a share of the joint's range, so that narrow joints stay off their stops."""
SHARE_OF_SPEED = 0.6
"""Largest speed as a share of the joint's limit, which PhysX keeps and MuJoCo does not know."""


class Fall(Model):
    """Dropped without contact and drives; null = do not run it."""

    seconds: Positive = Field(0.4, description="s")
    tolerance: Positive = Field(
        0.003, description="relative, against the integrator's formula, warning"
    )
    broken: Positive = Field(0.05, description="the same, error")


class Swing(Model):
    """Every joint follows a sine, base held, in MuJoCo and in PhysX; null = do not run it."""

    frequency: Positive = Field(1.0, description="Hz")
    seconds: Positive = Field(3.0, description="s; the first third is left out")
    tolerance: Positive = Field(
        0.01, description="of the swing, RMS between the engines without friction, warning"
    )
    tolerance_as_is: Positive = Field(
        0.05, description="the same with contacts, friction and limits, warning"
    )
    broken: Positive = Field(0.2, description="of the swing, either way, error")


@dataclass(frozen=True)
class FreeFall:
    """How the whole robot's centre of mass fell. drop: along gravity; sideways: across it; m."""

    seconds: float
    drop_m: float
    expected_m: float
    sideways_m: float
    finite: bool

    @property
    def relative_error(self) -> float:
        """The error of the drop, relative to the expected one; infinite without a finite result."""
        if not self.finite:
            return math.inf
        return abs(self.drop_m - self.expected_m) / max(self.expected_m, 1e-12)


def fall_of(
    moved: Array, seconds: float, gravity: Array, extra_s: float, *, finite: bool = True
) -> FreeFall:
    """The fall by `moved` (3,) m from rest against g/2 t (t + extra), m; gravity: (3,) m/s2.

    extra_s: what the integrator of an engine adds to the exact law.
    """
    g = float(np.linalg.norm(gravity))
    down = gravity / g if g else np.array([0.0, 0.0, -1.0])
    drop = float(moved @ down)
    sideways = float(np.linalg.norm(moved - drop * down))
    return FreeFall(seconds, drop, g / 2 * seconds * (seconds + extra_s), sideways, finite)


def fall_figures(fall: FreeFall) -> dict[str, object]:
    """For the report."""
    if not fall.finite:
        return {"finite": False}
    return {
        "seconds": fall.seconds,
        "drop_m": fall.drop_m,
        "expected_m": fall.expected_m,
        "relative_error": fall.relative_error,
        "sideways_m": fall.sideways_m,
    }


def judge_fall(fall: FreeFall, drop: Fall, rule: Rule, rounding: float) -> Iterator[Finding]:
    """A finding where it fell otherwise than the integrator must.

    Compared as lengths, so that without gravity nothing may move at all. rounding: m, of an engine.
    """
    error = max(abs(fall.drop_m - fall.expected_m), fall.sideways_m)
    if error > drop.tolerance * fall.expected_m + rounding:
        yield rule(
            "robot",
            f"fell {fall.drop_m:.6g} m and {fall.sideways_m:.3g} m sideways in "
            f"{fall.seconds:g} s, expected {fall.expected_m:.6g} m",
            severity="error" if error > drop.broken * fall.expected_m else "warning",
            hint="is a part fixed to the world, damped, or free of gravity?",
            data={
                "drop_m": fall.drop_m,
                "expected_m": fall.expected_m,
                "sideways_m": fall.sideways_m,
                "tolerance": drop.tolerance,
            },
        )


@dataclass(frozen=True)
class Sine:
    """Every joint's target at once: middle + swing sin(2 pi f t). rad or m, by joint name.

    speeds: joints whose drive takes a speed; it is asked for that of the same motion.
    """

    middle: Mapping[str, float]
    swing: Mapping[str, float]
    frequency_hz: float = 1.0
    seconds: float = 3.0
    speeds: frozenset[str] = frozenset()

    def target(self, joint: str, time: float) -> float:
        """What the drive is asked for at `time`: rad or m, of `speeds` rad/s or m/s."""
        omega = 2.0 * math.pi * self.frequency_hz
        if joint in self.speeds:
            return self.swing[joint] * omega * math.cos(omega * time)
        return self.middle[joint] + self.swing[joint] * math.sin(omega * time)


def sine_of(
    tree: Tree, control: Control, home: Mapping[str, float], frequency_hz: float, seconds: float
) -> Sine:
    """A swing about `home` (0 without) that stays inside the limits of every joint, speed too.

    A middle too near to a stop is moved off it: there two engines would compare their stops.
    Joints without a drive for positions or speeds have no swing; those that mimic follow their
    leader.
    """
    middle, swing, speeds = {}, {}, set()
    for joint in tree.moving_joints:
        lower, upper = bounds(joint)
        width = SWING_M if joint.kind == "prismatic" else SWING_RAD
        width = min(width, SHARE_OF_RANGE * (upper - lower))
        room = 1.25 * width  # a small swing too: weight may press its joint against the stop
        actuator = control.by_joint.get(joint.name)
        by_speed = actuator is not None and actuator.model == "velocity" and actuator.kd > 0.0
        limits = [actuator.velocity if actuator else joint.limits.velocity]
        if by_speed and actuator is not None and actuator.ctrl is not None:
            limits += [-actuator.ctrl[0], actuator.ctrl[1]]  # what may be asked of it
        for limit in limits:
            if limit is not None:
                fastest = SHARE_OF_SPEED * max(limit, 0.0)
                width = min(width, fastest / (2.0 * math.pi * frequency_hz))
        middle[joint.name] = min(max(home.get(joint.name, 0.0), lower + room), upper - room)
        driven = by_speed or (actuator is not None and actuator.kp > 0.0)
        swing[joint.name] = width if driven and joint.mimic is None else 0.0
        if by_speed:
            speeds.add(joint.name)
    return Sine(with_mimics(tree, middle), swing, frequency_hz, seconds, frozenset(speeds))


def bounds(joint: Joint) -> tuple[float, float]:
    """(lower, upper) of the coordinate, rad or m; infinite where nothing limits it."""
    if joint.kind == "continuous":
        return -math.inf, math.inf
    lower, upper = joint.limits.lower, joint.limits.upper
    return (-math.inf if lower is None else lower), (math.inf if upper is None else upper)


@dataclass(frozen=True)
class Motion:
    """Trajectories, sampled at `time` (n,), s. joints: rad or m by name, each (n,).

    root: (n, 3) m; turn: (n, 4) wxyz of the root; com: (n, 3) of the whole robot, m.
    touched: something touched something on the way; False where nobody looked. seen: (n, k, 3) of
    an object in the frames of k bodies, m; None without one.
    """

    time: Array
    joints: Mapping[str, Array]
    root: Array
    turn: Array
    com: Array
    touched: bool = False
    seen: Array | None = None

    @property
    def finite(self) -> bool:
        """Nothing went to infinity or to NaN."""
        tracks = (self.root, self.turn, self.com, *self.joints.values())
        return all(bool(np.isfinite(track).all()) for track in tracks)


@dataclass(frozen=True)
class Response:
    """How one joint followed one sine, or one engine another.

    rms: of the difference, as a share of the swing; gain: ratio of the amplitudes at the
    frequency of the sine; lag_rad: phase of the second behind the first.
    """

    rms: float
    gain: float
    lag_rad: float


def compare_response(sine: Sine, joint: str, first: Motion, second: Motion) -> Response:
    """The second motion against the first, the first third left out: there both still settle."""
    start = len(first.time) // 3
    time = first.time[start:]
    a = first.joints[joint][start:]
    b = np.interp(time, second.time, second.joints[joint])
    omega = 2.0 * math.pi * sine.frequency_hz
    one, two = phasor(time, a, omega), phasor(time, b, omega)
    ratio = two / one if abs(one) > 0.0 else complex(math.inf)
    rms = float(np.sqrt(np.mean((b - a) ** 2))) / sine.swing[joint]
    return Response(rms, abs(ratio), -float(np.angle(ratio)))


def phasor(time: Array, values: Array, omega: float) -> complex:
    """Complex amplitude of the part that swings with `omega`: least squares, with an offset."""
    basis = np.stack([np.sin(omega * time), np.cos(omega * time), np.ones_like(time)], axis=1)
    (sine, cosine, _), *_ = np.linalg.lstsq(basis, values, rcond=None)
    return complex(sine, cosine)
