"""Why PhysX lost its numbers: the experiment again, with one suspect taken away at a time."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from assetbuild.robot.model import Control, Tree
from assetbuild.simulators import physx
from assetbuild.simulators.experiments import Experiment

PAIRS_SHOWN = 8


def cause_of(
    main: Path, experiment: Experiment, tree: Tree, control: Control
) -> tuple[str, str] | None:
    """(what it is, what to write) where taking one thing away keeps the numbers; else None.

    Speed limits of followers: PhysX brakes a joint that mimics another and pulls it along its
    leader in the same step; where both weigh next to nothing, the two pulls grow without end.
    """
    fast = {actuator.joint for actuator in control.actuators if actuator.velocity is not None}
    limited = [j.name for j in tree.moving_joints if j.mimic is not None and j.name in fast]
    if not limited:
        return None
    calmer = replace(experiment, setting=replace(experiment.setting, unhurried=tuple(limited)))
    if not physx.perform(main, (calmer,))[experiment.name].finite:
        return None
    names = "|".join(re.escape(name) for name in limited)
    return (
        f"the speed limits of {len(limited)} joints that mimic others (`{limited[0]}`): without "
        "them it keeps its numbers",
        f'their leaders limit them already: add the row `{{joints: "{names}", model: passive, '
        "velocity: unlimited}` to `actuators`",
    )


def overlap_hint(overlaps: Mapping[tuple[str, str], float]) -> str:
    """The exclude to write for bodies that lie in one another at the start; "" without any.

    overlaps: depth (m) by pair of bodies, the deepest first.
    """
    if not overlaps:
        return ""
    pairs = list(overlaps)[:PAIRS_SHOWN]
    listed = ", ".join(f"[{a}, {b}]" for a, b in pairs)
    depths = ", ".join(f"{1e3 * overlaps[pair]:.3g}" for pair in pairs)
    more = f"; {len(overlaps) - len(pairs)} more pairs less deep" if overlaps.keys() - pairs else ""
    return (
        f"bodies lie in one another where it starts ({depths} mm): "
        f"`collision.exclude.pairs: [{listed}]`{more}, or smaller shapes"
    )
