"""What both simulators are asked: to load, to fall, to follow sines, to push into stops, to stand,
to land, and to stand on a slope."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from assetbuild.robot.initial import initial_pose
from assetbuild.robot.loops import path_of
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Control, Joint, Tree
from assetbuild.robot.pose import Pose
from assetbuild.simulators.experiments import (
    SHARE_OF_RANGE,
    SHARE_OF_SPEED,
    SWING_M,
    SWING_RAD,
    Experiment,
    Setting,
    Sine,
    Swing,
    bounds,
    drop,
    load,
    servos,
    sine_of,
    standing,
    swing,
)
from assetbuild.simulators.loops import about_closed

FINE_DT, SAMPLE_S, FALL_S = 0.001, 0.005, 0.4
STAND_S, DROP_S, DROP_M, SLOPE = 2.0, 1.2, 1.0, 0.5
"""SLOPE: tangent of the slope, as a share of the friction."""
STOP_HZ, STOP_S = 1.0, 1.0
SHARP = 2.0
"""Into a stop the target goes so many times as far as the joint has room for: beyond the limit by
as much as it stood before it."""
FINER = 8
"""So many times shorter steps tell a difference of integrators from one of the robot."""
End = Literal["lower", "upper"]
ENDS: tuple[End, End] = ("lower", "upper")


@dataclass(frozen=True)
class Asked:
    """The robot and the wish. wish: None = no sine and no stops."""

    tree: Tree
    control: Control
    wish: Swing | None

    def experiments(self) -> Mapping[str, Experiment]:
        """Name -> experiment, in the order of running."""
        return {experiment.name: experiment for experiment in self._experiments()}

    def _experiments(self) -> Iterator[Experiment]:
        yield load(self.control)
        if self.tree.base == "floating":
            yield drop(self.control, FALL_S)
        if self.wish is not None:
            yield from self._sines(self.wish)
            yield from self._into_stops()
        start = initial_pose(self.tree, self.control)
        if self.tree.base == "floating" and start.name:  # a keyframe above a floor
            yield from self._on_floor()

    @property
    def _held(self) -> Setting:
        """The robot as it is, its base held, with servos for laws outside of the simulator."""
        simulation = self.control.simulation
        return Setting(
            simulation.timestep,
            simulation.gravity,
            "held" if self.tree.base == "floating" else "asset",
            drives=servos(self.control),
        )

    def _sines(self, wish: Swing) -> Iterator[Experiment]:
        """Twice: as it is, and stripped of what simulators model differently, in fine steps."""
        home = dict(initial_pose(self.tree, self.control).joints)
        sine = sine_of(self.tree, self.control, home, wish.frequency, wish.seconds)
        sine = about_closed(self.tree, self.control, sine, home)
        if any(sine.swing.values()):
            bare = replace(
                self._held, timestep=FINE_DT, contacts=False, rubbing=False, limited=False
            )
            yield swing("sine", bare, sine, SAMPLE_S)
            yield swing("sine_as_is", self._held, sine, SAMPLE_S)

    def _into_stops(self) -> Iterator[Experiment]:
        """MuJoCo's limits of commands would clip what asks for more."""
        home = dict(initial_pose(self.tree, self.control).joints)
        own = replace(self._held, contacts=False, clipped=False)
        fine = replace(own, timestep=own.timestep / FINER)
        for end in ENDS:
            if (sine := into_stop(self.tree, self.control, home, end)) is not None:
                yield swing(f"past_{end}", own, sine, 0.0)
                yield swing(f"past_{end}_fine", fine, sine, 0.0)

    def _on_floor(self) -> Iterator[Experiment]:
        stand, start = standing(self.tree, self.control), initial_pose(self.tree, self.control)
        assert stand.at is not None  # noqa: S101 # made so
        x, y, z = stand.at.xyz
        raised = Pose((x, y, z + DROP_M), stand.at.quat)
        for name, setting, seconds, every in (
            ("stand", stand, STAND_S, 20),
            ("drop", replace(stand, at=raised, raised_m=DROP_M), DROP_S, 1),
            ("slope", replace(stand, gravity=tilted(self.control)), STAND_S, 20),
        ):
            steps = round(seconds / stand.timestep)
            yield Experiment(name, setting, steps, every, dict(start.joints))


def tilted(control: Control) -> tuple[float, float, float]:
    """Gravity as on a slope on which half of the friction holds the robot."""
    x, y, z = control.simulation.gravity
    angle = math.atan(SLOPE * control.contact.friction[0])
    return x + abs(z) * math.sin(angle), y, z * math.cos(angle)


def into_stop(tree: Tree, control: Control, home: Mapping[str, float], end: End) -> Sine | None:
    """Return a sine that starts before the limits and passes them; None where no joint has one.

    Loops stop their joints before the limits do: these stay at home, where all loops are closed. A
    joint that mimics goes with its leader.
    """
    chain = {joint.name for loop in control.loops for joint in path_of(tree, loop)}
    middle, swing = {}, {}
    for joint in tree.moving_joints:
        lower, upper = bounds(joint)
        rest = home.get(joint.name, 0.0) if joint.name in chain else 0.0
        middle[joint.name], swing[joint.name] = min(max(rest, lower), upper), 0.0
        stop = upper if end == "upper" else lower
        if joint.name not in chain and math.isfinite(stop) and upper > lower:
            room = _room_before_stop(joint, control)
            sign = 1.0 if end == "upper" else -1.0
            if room is not None:
                middle[joint.name], swing[joint.name] = stop - sign * room, sign * SHARP * room
    if not any(swing.values()):
        return None
    return Sine(with_mimics(tree, middle), swing, STOP_HZ, STOP_S)


def _room_before_stop(joint: Joint, control: Control) -> float | None:
    """rad or m; None where no drive moves the joint to a position."""
    drive = control.by_joint.get(joint.name)
    if drive is None or not drive.kp > 0.0 or joint.mimic is not None:
        return None
    lower, upper = bounds(joint)
    widest = SWING_M if joint.kind == "prismatic" else SWING_RAD
    room = min(widest, SHARE_OF_RANGE * (upper - lower))
    if drive.velocity:
        fastest = SHARE_OF_SPEED * drive.velocity / (2.0 * math.pi * STOP_HZ)
        room = min(room, fastest / SHARP)
    return room
