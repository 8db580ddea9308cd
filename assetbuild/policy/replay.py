"""A policy in the loop: what it sees, what it asks for, where the robot goes."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from assetbuild.errors import UsageError
from assetbuild.policy.network import Network
from assetbuild.policy.robot import Bot
from assetbuild.policy.stated import Policy
from assetbuild.policy.terms import Now, Observer, Seen
from assetbuild.robot.pose import Array

if TYPE_CHECKING:
    from assetbuild.policy.in_mujoco import InMujoco
    from assetbuild.policy.in_stages import InStages

    World = InMujoco | InStages
    """A robot on a floor in some engine, at its start pose when it is made."""

FALLEN_RAD = 1.0
"""Tilt of the base against the vertical from which on it has fallen."""
UPRIGHT_RAD = 0.5
"""Tilt up to which it does what it was asked to do."""
FALLEN_SHARE = 0.5
"""Share of its first height, likewise."""
FOLLOWS, STILL = 0.35, 0.1
"""A mean velocity follows a command within this share of it and this many m/s or rad/s."""
SETTLES = 0.3
"""Share of the time that is left out of the mean velocity."""
BEST = 2.0
"""The score of a robot that never falls and follows its command exactly."""
MOMENTS = 6
"""States that are kept for a picture, the first and the last among them."""


def whole_steps(step_s: float, timestep_s: float) -> bool:
    """Whether a simulation comes to the end of a policy's step."""
    return abs(step_s / timestep_s - max(1, round(step_s / timestep_s))) < 1e-6


@dataclass(frozen=True)
class Replay:
    """What became of it. command, velocity: forward, left, turn to the left; m/s and rad/s.

    seconds: until it fell or the end; moved: (forward, left) of its start, m. tilt: the largest,
    rad. saturated: share of drives at their limit, mean; slip: speed of feet on the floor, m/s;
    None where the engine does not report them. is_broken: the network's answer was not finite.
    moments: states on the way, for pictures.
    """

    command: tuple[float, ...]
    asked_s: float
    seconds: float
    moved: tuple[float, float]
    velocity: tuple[float, float, float]
    tilt: float
    height: float
    saturated: float | None
    slip: float | None
    is_broken: bool = False
    moments: tuple[Seen, ...] = field(default=(), compare=False, repr=False)

    @property
    def fell(self) -> bool:
        """Whether it ended before its time."""
        return self.seconds < self.asked_s - 1e-9

    @property
    def error(self) -> float:
        """Distance of the mean velocity from the command."""
        return math.dist(self.velocity, self.command)

    @property
    def follows(self) -> bool:
        """Whether it did what it was asked to do."""
        is_near = self.error <= STILL + FOLLOWS * math.hypot(*self.command)
        return not self.fell and self.tilt <= UPRIGHT_RAD and is_near

    @property
    def score(self) -> float:
        """Between 0 and `BEST`: the time that it stood, then how well it followed."""
        stood = min(1.0, self.seconds / self.asked_s)
        return stood if self.fell else 1.0 + 1.0 / (1.0 + 4.0 * self.error)

    @property
    def verdict(self) -> str:
        """How it went, in words."""
        if self.is_broken:
            return f"the network answers with NaN or inf after {self.seconds:.2f} s"
        if self.fell:
            return f"falls after {self.seconds:.2f} s"
        if self.tilt > UPRIGHT_RAD:
            return "stays up, and tilts far"
        if not self.follows:
            return "stays up and does not follow the command"
        return "walks" if math.hypot(*self.command) > STILL else "stands"


def replay(
    policy: Policy,
    bot: Bot,
    network: Network,
    world: World,
    command: tuple[float, ...],
    seconds: float,
) -> Replay:
    """Let a policy drive until the time is over or the robot has fallen. Errors: of `Network`."""
    step_s, timestep_s = policy.step_s or bot.step_s, bot.control.simulation.timestep
    if not whole_steps(step_s, timestep_s):
        raise UsageError(
            f"it acts every {1e3 * step_s:.4g} ms, the bundle simulates steps of "
            f"{1e3 * timestep_s:.4g} ms",
            hint="build the bundle with a `simulation.timestep` that divides the policy's",
        )
    observer, imu = Observer(policy), bot.imu_in_base
    action = np.zeros(len(policy.acts_on))
    network.reset()
    first, track = world.seen(), list[tuple[Seen, tuple[float, float]]]()
    seen = first
    while not (is_over := seen.time >= seconds - step_s / 2.0) and not _fallen(seen, first):
        now = Now(seen, np.asarray(command, dtype=float), action, policy.position, imu)
        action = network.act(observer.look(now))
        if not np.isfinite(action).all():
            break
        world.drive(_targets(policy, action), step_s)
        seen = replace(world.seen(), time=seen.time + step_s)
        if _is_finite(seen):
            track.append((seen, world.strain()))
    ended = seconds if is_over and not _fallen(seen, first) else seen.time
    played = _replayed(track, first, tuple(command), seconds, ended)
    return replace(played, is_broken=not np.isfinite(action).all())


def _targets(policy: Policy, action: Array) -> dict[str, float]:
    """rad or m by joint; those that the policy does not move keep their place."""
    targets = {name: policy.position[name] for name in policy.joints}
    for name, value in zip(policy.acts_on, action.tolist(), strict=True):
        target = policy.offset[name] + policy.scale[name] * value
        low, high = policy.action_clip.get(name, (-math.inf, math.inf))
        targets[name] = min(max(target, low), high)
    return targets


def _is_finite(seen: Seen) -> bool:
    return bool(np.isfinite((*seen.place, *seen.quat, *seen.q.values())).all())


def _fallen(seen: Seen, first: Seen) -> bool:
    is_low = seen.place[2] < FALLEN_SHARE * first.place[2]
    return not _is_finite(seen) or is_low or _tilt(seen) > FALLEN_RAD


def _tilt(seen: Seen) -> float:
    return math.acos(min(1.0, max(-1.0, -float(seen.gravity[2]))))


def _yaw(seen: Seen) -> float:
    w, x, y, z = (float(v) for v in seen.quat)
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _replayed(
    track: list[tuple[Seen, tuple[float, float]]],
    first: Seen,
    command: tuple[float, ...],
    asked_s: float,
    ended_s: float,
) -> Replay:
    states = [first, *(seen for seen, _ in track)]
    forward = np.array((math.cos(_yaw(first)), math.sin(_yaw(first))))
    left = np.array((-forward[1], forward[0]))
    shift = states[-1].place[:2] - first.place[:2]
    kept = states[int(SETTLES * len(states)) :]
    strain = np.array([pair for _, pair in track]) if track else np.zeros((1, 2))
    rub, slip = (float(v) if np.isfinite(v) else None for v in strain.mean(axis=0))
    return Replay(
        command=command,
        asked_s=asked_s,
        seconds=ended_s,
        moved=(float(shift @ forward), float(shift @ left)),
        velocity=_velocity(kept),
        tilt=max(map(_tilt, states)),
        height=float(states[-1].place[2]),
        saturated=rub,
        slip=slip,
        moments=tuple(states[at] for at in np.linspace(0, len(states) - 1, MOMENTS, dtype=int)),
    )


def _velocity(states: list[Seen]) -> tuple[float, float, float]:
    """Mean forward, left and turning velocity, in the base's own heading."""
    span = states[-1].time - states[0].time
    if not span > 0.0:
        return (0.0, 0.0, 0.0)
    total = np.zeros(3)
    for before, after in itertools.pairwise(states):
        yaw, shift = _yaw(before), after.place - before.place
        turn = math.remainder(_yaw(after) - yaw, 2.0 * math.pi)
        c, s = math.cos(yaw), math.sin(yaw)
        total += (c * shift[0] + s * shift[1], c * shift[1] - s * shift[0], turn)
    x, y, z = (total / span).tolist()
    return (x, y, z)
