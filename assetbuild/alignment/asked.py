"""What both simulators are asked: to load, to fall, to follow sines, to push into stops, to stand,
and to land."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

from assetbuild.robot.initial import initial_pose
from assetbuild.robot.loops import path_of
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.pose import IDENTITY, Pose
from assetbuild.simulators.experiments import (
    Experiment,
    Sine,
    Swing,
    drop,
    load,
    plain,
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
        held = replace(plain(control), drives=servos(control))
        held = replace(held, base="held") if floats else held
        bare = replace(held, timestep=FINE_DT, contacts=False, rubbing=False, limited=False)
        # MuJoCo's limits of commands would clip what asks for more than a limit allows.
        unclipped = replace(held, contacts=False, clipped=False)
        fine = replace(unclipped, timestep=unclipped.timestep / FINER)
        sine = sine_of(tree, control, home, wish.frequency, wish.seconds)
        sine = about_closed(tree, control, sine, home)
        # Twice: stripped of what simulators model differently, in fine steps, and as it is.
        asked = [("sine", bare, sine, SAMPLE_S), ("sine_as_is", held, sine, SAMPLE_S)]
        for end in ENDS:
            stop = into_stop(tree, control, home, end)
            asked += [(f"past_{end}", unclipped, stop, 0.0), (f"past_{end}_fine", fine, stop, 0.0)]
        experiments += [swing(*one) for one in asked if any(one[2].swing.values())]
    if floats and start.name:  # a keyframe above a floor
        stand, joints = standing(tree, control), dict(start.joints)
        base = stand.at or IDENTITY
        x, y, z = base.xyz
        raised = replace(stand, at=Pose((x, y, z + DROP_M), base.quat), raised_m=DROP_M)
        steps = [round(seconds / stand.timestep) for seconds in (STAND_S, DROP_S)]
        experiments += [
            Experiment("stand", stand, steps[0], every=20, start=joints),
            Experiment("drop", raised, steps[1], start=joints),
        ]
    return {experiment.name: experiment for experiment in experiments}


def into_stop(tree: Tree, control: Control, home: Mapping[str, float], end: End) -> Sine:
    """Return a sine that starts before the limits and passes them, of the joints that have one.

    Loops stop their joints before the limits do: these stay at home, where all loops are closed. A
    joint that mimics goes with its leader.
    """
    chain = {joint.name for loop in control.loops for joint in path_of(tree, loop)}
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
    return Sine(with_mimics(tree, middle), swing, STOP_HZ, STOP_S)
