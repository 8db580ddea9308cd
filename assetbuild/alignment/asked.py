"""What both simulators are asked: to load, to fall, to follow sines, to push into stops, to stand,
and to land."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Literal

from assetbuild.robot.initial import initial_pose
from assetbuild.robot.loops import joints_of
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.pose import IDENTITY, Pose
from assetbuild.simulators.experiments import (
    Experiment,
    Setting,
    Sine,
    Swing,
    drop,
    load,
    servos,
    sine_of,
    standing,
    swing,
    widest,
)
from assetbuild.simulators.loops import about_closed

FINE_DT, SAMPLE_S, FALL_S = 0.001, 0.005, 0.4
STAND_S, DROP_S, DROP_M = 2.0, 1.2, 1.0
STOP_HZ, STOP_S = 1.0, 1.0
SHARP = 2.0
"""Into a stop the target goes so many times as far as the joint has room for: beyond the limit by
as much as it stood before it."""
FINER = 8
"""So many times shorter steps tell a difference of integrators from one of the robot."""
End = Literal["lower", "upper"]
ENDS: tuple[End, End] = ("lower", "upper")


def experiments_of(tree: Tree, control: Control, wish: Swing | None) -> dict[str, Experiment]:
    """Name -> experiment, in the order of running. wish: None = no sine and no stops."""
    experiments = [load(control)]
    floats, start = tree.base == "floating", initial_pose(tree, control)
    if floats:
        experiments += [drop(control, FALL_S)]
    if wish is not None:
        home = dict(start.joints)
        held = Setting(
            control.simulation.timestep,
            control.simulation.gravity,
            "held" if floats else "asset",
            drives=servos(control),
        )
        sine = sine_of(tree, control, home, wish.frequency, wish.seconds)
        experiments += _sines(held, about_closed(tree, control, sine, home))
        experiments += _into_stops(tree, control, home, held)
    if floats and start.name:  # a keyframe above a floor
        experiments += _on_floor(standing(tree, control), dict(start.joints))
    return {experiment.name: experiment for experiment in experiments}


def _sines(held: Setting, sine: Sine) -> Iterator[Experiment]:
    """Twice: as it is, and stripped of what simulators model differently, in fine steps."""
    if any(sine.swing.values()):
        bare = replace(held, timestep=FINE_DT, contacts=False, rubbing=False, limited=False)
        yield swing("sine", bare, sine, SAMPLE_S)
        yield swing("sine_as_is", held, sine, SAMPLE_S)


def _into_stops(
    tree: Tree, control: Control, home: Mapping[str, float], held: Setting
) -> Iterator[Experiment]:
    """MuJoCo's limits of commands would clip what asks for more."""
    unclipped = replace(held, contacts=False, clipped=False)
    fine = replace(unclipped, timestep=unclipped.timestep / FINER)
    for end in ENDS:
        if (sine := into_stop(tree, control, home, end)) is not None:
            yield swing(f"past_{end}", unclipped, sine, 0.0)
            yield swing(f"past_{end}_fine", fine, sine, 0.0)


def _on_floor(stand: Setting, start: Mapping[str, float]) -> Iterator[Experiment]:
    base = stand.at or IDENTITY
    x, y, z = base.xyz
    raised = replace(stand, at=Pose((x, y, z + DROP_M), base.quat), raised_m=DROP_M)
    for name, setting, seconds, every in (
        ("stand", stand, STAND_S, 20),
        ("drop", raised, DROP_S, 1),
    ):
        yield Experiment(name, setting, round(seconds / stand.timestep), every, start)


def into_stop(tree: Tree, control: Control, home: Mapping[str, float], end: End) -> Sine | None:
    """Return a sine that starts before the limits and passes them; None where no joint has one.

    Loops stop their joints before the limits do: these stay at home, where all loops are closed. A
    joint that mimics goes with its leader.
    """
    chain = joints_of(tree, control.loops)
    middle, swing = {}, {}
    for joint in tree.moving_joints:
        lower, upper = joint.bounds
        rest = home.get(joint.name, 0.0) if joint.name in chain else 0.0
        middle[joint.name], swing[joint.name] = min(max(rest, lower), upper), 0.0
        stop = upper if end == "upper" else lower
        drive = control.by_joint.get(joint.name)
        if drive is None or not drive.kp > 0.0 or joint.mimic is not None:
            continue
        if joint.name not in chain and math.isfinite(stop) and upper > lower:
            speeds = [drive.velocity] if drive.velocity else ()
            room = widest(joint, speeds, SHARP * STOP_HZ)
            sign = 1.0 if end == "upper" else -1.0
            middle[joint.name], swing[joint.name] = stop - sign * room, sign * SHARP * room
    if not any(swing.values()):
        return None
    return Sine(with_mimics(tree, middle), swing, STOP_HZ, STOP_S)
