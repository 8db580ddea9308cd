"""How far every driven joint runs past its limits: its drive pushes it against each."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Literal

from assetbuild.alignment.row import Row
from assetbuild.robot.loops import path_of
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Control, Tree
from assetbuild.simulators.experiments import (
    SHARE_OF_RANGE,
    SHARE_OF_SPEED,
    SWING_M,
    SWING_RAD,
    Motion,
    Sine,
    bounds,
)

FREQUENCY_HZ, SECONDS = 1.0, 1.0
SHARP = 2.0
"""The target goes so many times as far as the joint has room for: beyond the limit by as much as
it stood before it."""
RAD, METRE = (0.01, 0.1), (0.001, 0.01)
"""How much further than in MuJoCo: a warning, an error."""
FINER = 8
"""So many times shorter steps tell a difference of integrators from one of the robot."""
SHORTER = "a shorter `simulation.timestep` brings them together"
End = Literal["lower", "upper"]
ENDS: tuple[End, End] = ("lower", "upper")


def into_stop(tree: Tree, control: Control, home: Mapping[str, float], end: End) -> Sine | None:
    """Return a sine that starts before the limits and passes them; None where no joint has one.

    Loops stop their joints before the limits do: these stay at home, where all loops are closed. A
    joint that mimics goes with its leader.
    """
    chain = {joint.name for loop in control.loops for joint in path_of(tree, loop)}
    middle, swing = {}, {}
    for joint in tree.moving_joints:
        lower, upper = bounds(joint)
        stop = upper if end == "upper" else lower
        drive = control.by_joint.get(joint.name)
        driven = drive is not None and drive.kp > 0.0 and joint.mimic is None
        rest = home.get(joint.name, 0.0) if joint.name in chain else 0.0
        middle[joint.name], swing[joint.name] = min(max(rest, lower), upper), 0.0
        if not driven or not math.isfinite(stop) or upper <= lower or joint.name in chain:
            continue
        room = min(SWING_M if joint.kind == "prismatic" else SWING_RAD,
                   SHARE_OF_RANGE * (upper - lower))  # fmt: skip
        if drive is not None and drive.velocity:
            fastest = SHARE_OF_SPEED * drive.velocity / (2.0 * math.pi * FREQUENCY_HZ)
            room = min(room, fastest / SHARP)
        sign = 1.0 if end == "upper" else -1.0
        middle[joint.name], swing[joint.name] = stop - sign * room, sign * SHARP * room
    if not any(swing.values()):
        return None
    return Sine(with_mimics(tree, middle), swing, FREQUENCY_HZ, SECONDS)


def stop_rows(tree: Tree, sine: Sine, end: End, ours: Motion, theirs: Motion) -> Iterator[Row]:
    """A row for each joint that was driven: beyond its limit, rad or m, the largest of the run."""
    for joint in tree.moving_joints:
        if not sine.swing[joint.name]:
            continue
        past = [_past(motion, joint.name, bounds(joint), end) for motion in (ours, theirs)]
        linear = joint.kind == "prismatic"
        yield Row(
            f"past_{end}",
            "HIGH",
            f"joint {joint.name}",
            past[0],
            past[1],
            max(0.0, past[1] - max(0.0, past[0])),
            *(METRE if linear else RAD),
            "m further" if linear else "rad further",
        )


def explained(rows: Sequence[Row], fine: Sequence[Row], dt: float) -> list[Row]:
    """The rows, with the integrator as the reason where steps of dt s bring both together."""
    apart = {row.subject: row for row in fine}
    return [
        replace(row, because=f"the integrators part: in steps of {dt:g} s, {known.off:.2g} apart",
                advice=SHORTER)
        if row.verdict in ("warning", "error")
        and (known := apart.get(row.subject)) is not None
        and known.verdict == "ok"
        else row
        for row in rows
    ]  # fmt: skip


def _past(motion: Motion, joint: str, ends: tuple[float, float], end: End) -> float:
    """Negative where the joint stays before its limit."""
    track = motion.joints[joint]
    return float(track.max()) - ends[1] if end == "upper" else ends[0] - float(track.min())
