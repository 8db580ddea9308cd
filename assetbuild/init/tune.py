"""Drives, pose and time step of a recipe, corrected until no check of a build objects.

Corrected, in this order: an effort that is unknown and too weak; a damping ratio that the joints'
own damping exceeds; then, where the simulation outruns its drives, the time step. What the source
states and cannot be is left, and said. A driven joint whose rotor nobody states gets the least that
a motor of its effort has: see `rotor_inertia`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from assetbuild.findings import Finding
from assetbuild.init.anatomy import Anatomy
from assetbuild.init.drives import FIRM, FIRMER, STEP_S, TABLE, DriveRow, drive_rows
from assetbuild.init.home import UPRIGHT, Depths, Shift, home_pose, nothing_deep
from assetbuild.init.strength import (
    Guess,
    rotor_inertia,
    rounded_up,
    strengthened,
    with_efforts,
)
from assetbuild.init.trial import Trial
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.model import Tree

LIGHT_KG = 5.0
SHORT_STEP_S, SHORTEST_STEP_S = 0.002, 0.001
ROUNDS = 8
"""Corrections at most: each needs a trial, of a second or two for a humanoid."""
WEAK = ("gains.torque", "trials.dead")
"""Rules that a stronger drive satisfies."""
STRONGER = 2.0
LEANS_RAD = 0.03
"""Tilt beyond which a robot is brought upright: the soles of a build may be smaller than hulls."""
LESS = 0.75
"""Share of a lean that a remedy may leave of a robot that stands without it."""
BALANCED_M = 0.003
"""Nearer to the middle of its feet, along x or y, the centre of mass is not brought."""

Try = Callable[["Tuning"], Trial]


@dataclass(frozen=True)
class Tuning:
    """A choice of drives, and what made it. tree: with the guessed efforts.

    notes: what was corrected and why. rotors: inertias that the source states, by joint, kg m2 or
    kg.
    """

    tree: Tree
    anatomy: Anatomy
    pose: Mapping[str, float]
    drives: tuple[DriveRow, ...]
    timestep: float
    guesses: Mapping[str, Guess]
    rotors: Mapping[str, float]
    notes: tuple[str, ...] = ()
    shift: Shift = UPRIGHT
    firmness: float = FIRM
    depths: Depths = nothing_deep


def tune(
    tree: Tree,
    anatomy: Anatomy,
    attempt: Try,
    rotors: Mapping[str, float] = MappingProxyType({}),
    longest_step: float = STEP_S,
    depths: Depths = nothing_deep,
) -> tuple[Tuning, Trial]:
    """The first choice of drives that the trial has nothing against, else the last.

    tree: as the source states it. rotors: inertias that it states, by joint, kg m2 or kg;
    longest_step: s.
    """
    strong, guesses = strengthened(tree, anatomy)
    start = Tuning(strong, anatomy, {}, (), 0.0, guesses, rotors, depths=depths)
    tuning = _chosen(start, longest_step)
    trial = attempt(tuning)
    for _ in range(ROUNDS):
        better = _corrected(tuning, trial) if trial.unmended else None
        if better is None:
            break
        tuning, trial = better, attempt(better)
    askew = trial.stands is False or trial.lean > LEANS_RAD
    if askew and not trial.unmended and not trial.points:
        tuning, trial = _standing(tuning, trial, attempt)
    return tuning, trial


def _chosen(tuning: Tuning, step: float) -> Tuning:
    """The same with pose, drives and time step chosen anew; step: no longer than this, s."""
    tree, legs, turning = tuning.tree, tuning.anatomy.legs, tuning.anatomy.turning
    pose = home_pose(tree, legs, tuning.shift, tuning.depths)
    alone = [joint for joint in tree.moving_joints if joint.mimic is None]
    rotors = {joint.name: rotor_inertia(joint) for joint in alone}
    rotors |= {name: inertia for name, inertia in tuning.rotors.items() if inertia}
    drives = drive_rows(tree, pose, legs, tuning.guesses, rotors, turning, tuning.firmness)
    hops = any(row.outruns(STEP_S) for row in drives)
    needed = SHORT_STEP_S if hops or total_mass(tree) < LIGHT_KG else STEP_S
    return replace(tuning, pose=pose, drives=drives, timestep=min(needed, step))


# --- corrections ----------------------------------------------------------------------------


def _corrected(tuning: Tuning, trial: Trial) -> Tuning | None:
    """Efforts that are guesses grow; else a step of 2 ms, then of 1 ms; None: nothing is left."""
    stronger = _stronger(tuning, [error for error in trial.errors if error.rule in WEAK])
    other = next((error for error in trial.errors if error.rule not in WEAK), None)
    step = next((s for s in (SHORT_STEP_S, SHORTEST_STEP_S) if s < tuning.timestep), None)
    if stronger is not None or other is None or step is None:
        return stronger
    note = f"a time step of {1e3 * step:g} ms: at {1e3 * tuning.timestep:g} ms "
    note += f"{other.subject} {other.message}"
    return _chosen(replace(tuning, notes=(*tuning.notes, note)), step)


def _stronger(tuning: Tuning, weak: list[Finding]) -> Tuning | None:
    """Efforts that are guesses grow."""
    grown = {}
    for error in weak:
        name = error.subject.partition(" ")[2]
        effort = tuning.tree.by_joint[name].limits.effort or 0.0
        if name in tuning.guesses:
            load = max(float(str(error.data.get("load", 1.0))), 1.0)
            grown[name] = rounded_up(load * STRONGER * effort)
    if not grown:
        return None
    tree = with_efforts(tuning.tree, grown)
    return _chosen(replace(tuning, tree=tree), tuning.timestep)


def _standing(tuning: Tuning, trial: Trial, attempt: Try) -> tuple[Tuning, Trial]:
    """The first remedy that makes the robot stand upright, else the most upright of those with
    which one that fell stands, or one that leans does so less; else as it was, with what was tried.
    """
    now, seen = tuning, trial
    stood: list[tuple[Tuning, Trial]] = []
    tried: list[str] = []
    kept: list[str] = []
    failed = f"leans by {trial.lean:.2g} rad" if trial.stands else trial.sentence
    for remedy in REMEDIES if tuning.anatomy.legs else ():
        again = _remedied(remedy, now, seen)
        if again is None:
            continue
        after = attempt(again)
        tried.append(f"{remedy} (it {after.sentence})")
        if after.stands and not after.unmended:
            note = f"{', '.join(dict.fromkeys((*kept, remedy)))}: otherwise it {failed}"
            stood.append((replace(again, notes=(*tuning.notes, note)), after))
            if after.lean <= LEANS_RAD:
                return stood[-1]
        nearer = math.hypot(*after.off) < math.hypot(*seen.off) + BALANCED_M
        if nearer and not after.unmended:
            now, seen = again, after
            kept.append(remedy)
    better = [it for it in stood if not trial.stands or it[1].lean < LESS * trial.lean]
    same = trial if trial.stands else replace(trial, tried=tuple(dict.fromkeys(tried)))
    return min(better, key=lambda it: it[1].lean, default=(tuning, same))


BALANCED = "feet under the centre of mass"
HASTY = f"a time step of {1e3 * SHORT_STEP_S:g} ms"
FIRM_LEGS = f"legs {FIRMER:g} times as stiff as would let it tip over"
REMEDIES = (BALANCED, BALANCED, HASTY, FIRM_LEGS, BALANCED)
"""What may make a robot stand, in the order in which it is tried; what brings its feet under its
centre of mass is kept for the next."""


def _remedied(remedy: str, tuning: Tuning, trial: Trial) -> Tuning | None:
    """Choose anew with one of the remedies; None where it would change nothing."""
    (ahead, aside), firmness, step = tuning.shift, tuning.firmness, tuning.timestep
    if remedy == BALANCED:
        x, y = (way if abs(way) >= BALANCED_M else 0.0 for way in trial.off)
        ahead, aside = ahead + x, aside + y
    elif remedy == HASTY:
        step = min(step, SHORT_STEP_S)
    elif len(tuning.anatomy.legs) < TABLE:
        firmness = FIRMER
    change = replace(tuning, shift=(ahead, aside), firmness=firmness, timestep=step)
    return None if change == tuning else _chosen(change, step)
