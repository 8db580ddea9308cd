"""How both simulators moved the robot, as rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from assetbuild.alignment.asked import DROP_M, End
from assetbuild.alignment.row import Row
from assetbuild.quantities import Model, Positive
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.pose import Array
from assetbuild.simulators.experiments import (
    Experiment,
    Motion,
    Outcome,
    Sine,
    Swing,
    bounds,
    compare_response,
    phasor,
)
from assetbuild.simulators.free_fall import Fall, fall_of

NEVER = math.inf
FALLEN_RAD = math.radians(20.0)
RAD, METRE = 0.01, 0.001
"""How much further past a limit than in MuJoCo is a warning."""


class FloorLimits(Model):
    """Where two engines may part on a floor: a warning, and an error."""

    stand_height: tuple[Positive, Positive] = Field(
        (0.005, 0.01), description="m, between the roots after standing"
    )
    landing: tuple[Positive, Positive] = Field(
        (0.03, 0.1), description="share of the time that a fall from 1 m takes, of either engine"
    )


@dataclass(frozen=True)
class Compared:
    """The robot, the limits, and both simulators: MuJoCo is asked for what the other has done.

    iterations: how often the other applies gravity in a step.
    """

    tree: Tree
    control: Control
    swing: Swing
    fall: Fall
    floor: FloorLimits
    iterations: int
    mujoco: Callable[[Experiment], Outcome]
    asked: Mapping[str, Experiment]
    theirs: Mapping[str, Outcome]

    def rows(self) -> Iterator[Row]:
        """A row for each joint or robot of each experiment that both brought to its end."""
        for name, of in ROWS.items():
            done = self.theirs.get(name)
            if done is None or not done.finite or done.motion is None:
                continue
            ours = self.mujoco(self.asked[name])
            if ours.motion is not None:
                yield from of(self, self.asked[name], ours.motion, done.motion)


Rows = Callable[[Compared, Experiment, Motion, Motion], Iterator[Row]]


def fall_rows(both: Compared, asked: Experiment, ours: Motion, theirs: Motion) -> Iterator[Row]:
    """The drop of each against the law of its own integrator."""
    one = fall_of(asked, Outcome(None, ours))
    two = fall_of(asked, Outcome(None, theirs), both.iterations)
    if one is not None and two is not None:
        yield Row(
            "free_fall",
            "HIGH",
            "robot",
            f"{one.drop_m:.6g} m of {one.expected_m:.6g}",
            f"{two.drop_m:.6g} m of {two.expected_m:.6g}",
            max(one.relative_error, two.relative_error),
            both.fall.tolerance,
            both.fall.broken,
            "of the drop",
        )


# --- sines --------------------------------------------------------------------------------------


def sine_rows(both: Compared, asked: Experiment, ours: Motion, theirs: Motion) -> Iterator[Row]:
    """How each joint follows its sine.

    An engine has its own model of dry friction, couplings and limits of speed: with them a
    difference is a warning at most, and after a touch it is not judged.
    """
    assert asked.sine is not None  # noqa: S101 # made so
    is_pure, wish = not asked.setting.rubbing, both.swing
    limits = (wish.tolerance, wish.broken) if is_pure else (wish.tolerance_as_is, NEVER)
    if ours.touched:
        limits = NEVER, NEVER
    unit = f"of the swing, RMS{'; the robot touches itself' if ours.touched else ''}"
    for joint, width in asked.sine.swing.items():
        if width > 0.0:
            response = compare_response(asked.sine, joint, ours, theirs)
            yield Row(
                asked.name,
                "HIGH",
                f"joint {joint}",
                f"swing {_swung(asked.sine, joint, ours):.5g}",
                f"swing x {response.gain:.5f}, {response.lag_rad:+.4f} rad later",
                response.rms,
                *limits,
                unit,
            )


def _swung(sine: Sine, joint: str, motion: Motion) -> float:
    """Amplitude at the frequency of the sine, rad or m, once it has settled."""
    start = len(motion.time) // 3
    omega = 2.0 * math.pi * sine.frequency_hz
    return abs(phasor(motion.time[start:], motion.joints[joint][start:], omega))


# --- stops --------------------------------------------------------------------------------------


def stop_rows(both: Compared, asked: Experiment, ours: Motion, theirs: Motion) -> Iterator[Row]:
    """How far each driven joint runs past its limit, rad or m, the largest of the run.

    Integrators differ where a joint is stopped, so that a difference is a warning at most.
    """
    assert asked.sine is not None  # noqa: S101 # made so
    end: End = "lower" if asked.name == "past_lower" else "upper"
    for joint in both.tree.moving_joints:
        if not asked.sine.swing[joint.name]:
            continue
        past = [_past(motion.joints[joint.name], bounds(joint), end) for motion in (ours, theirs)]
        linear = joint.kind == "prismatic"
        yield Row(
            f"past_{end}",
            "HIGH",
            f"joint {joint.name}",
            past[0],
            past[1],
            max(0.0, past[1] - max(0.0, past[0])),
            METRE if linear else RAD,
            NEVER,
            "m further" if linear else "rad further",
        )


def _past(track: Array, ends: tuple[float, float], end: End) -> float:
    """Negative where the joint stays before its limit."""
    return float(track.max()) - ends[1] if end == "upper" else ends[0] - float(track.min())


# --- on the floor -------------------------------------------------------------------------------


def stand_rows(both: Compared, _: Experiment, ours: Motion, theirs: Motion) -> Iterator[Row]:
    """Where the root stands at the end; two falls have nothing to do with one another."""
    one, two = float(ours.root[-1, 2]), float(theirs.root[-1, 2])
    _, x, y, _ = ours.turn[-1]
    tilt = math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * float(x * x + y * y))))
    falls = tilt > FALLEN_RAD
    limits = (NEVER, NEVER) if falls else both.floor.stand_height
    unit = "m; it falls over in MuJoCo, as the check `stand` would say" if falls else "m"
    yield Row("stand_height", "MEDIUM", "robot", one, two, abs(one - two), *limits, unit)


def landing_rows(both: Compared, _: Experiment, ours: Motion, theirs: Motion) -> Iterator[Row]:
    """When each lands, against the law of falling."""
    down = abs(both.control.simulation.gravity[2])
    if down == 0.0:
        return
    ideal = math.sqrt(2.0 * DROP_M / down)
    one, two = _landing_time(ours), _landing_time(theirs)
    off = max(abs(time - ideal) / ideal for time in (one, two))
    yield Row("landing_s", "MEDIUM", "robot", one, two, off, *both.floor.landing, "of the time")


def _landing_time(motion: Motion) -> float:
    """When the centre of mass has fallen as far as the soles had to go; inf when it never did."""
    fallen = motion.com[0, 2] - motion.com[:, 2]
    reached = np.flatnonzero(fallen >= DROP_M)
    if not len(reached):
        return math.inf
    last = int(reached[0])
    return float(np.interp(DROP_M, fallen[last - 1 : last + 1], motion.time[last - 1 : last + 1]))


ROWS: Mapping[str, Rows] = {
    "fall": fall_rows,
    "sine": sine_rows,
    "sine_as_is": sine_rows,
    "past_lower": stop_rows,
    "past_upper": stop_rows,
    "stand": stand_rows,
    "drop": landing_rows,
}
"""What is compared of each experiment."""
