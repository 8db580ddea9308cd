"""The sections of a recipe: each choice with its reason beside it."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from assetbuild.body.lint import MIMIC_LIMITS, invented
from assetbuild.errors import counted
from assetbuild.init.anatomy import Anatomy, Leg
from assetbuild.init.collision import (
    compound_pairs,
    hand_of,
    note_loops,
    put_collision,
    put_pads,
    soles_of,
)
from assetbuild.init.draft import Draft, Proposal, inline, patterns_of, plain, some, with_remedy
from assetbuild.init.drives import GAINS, STEP_S, DriveRow
from assetbuild.init.home import Pair, made_so
from assetbuild.init.licence import stated_licence
from assetbuild.init.look import InspectedRobot, put_up_axis, turned, usual_targets
from assetbuild.init.packages import lacking
from assetbuild.init.repairs import mended, put_repairs, repairs
from assetbuild.init.source import UrdfSource
from assetbuild.init.strength import MARGIN, ROTOR_RULE, resting
from assetbuild.init.trial import LIGHT_KG, Trial, Tuning, staged, tune
from assetbuild.recipe.loader import shown_path
from assetbuild.robot.contact import Exclude
from assetbuild.robot.contradictions import contradictions
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.model import Tree
from assetbuild.targets.mjcf.files import SCENES

TURNED = "not 0: joints whose drives could not hold the pose, or that lay in the floor or the robot"
SHOWN = 8
"""Most overlaps that are named."""
MANY_LEGS = 4
"""Robots on as many legs usually stand."""
DROPPED = {
    "damping": "the joints would take minutes to reach their targets",
    "friction": "it would take most of their effort",
}
GUESSED = (
    f"`guessed`: the source states no plausible effort. The guess is {MARGIN:g} times or more what",
    "gravity needs in the worst pose. Every build warns until you replace it.",
)
ROTORS = (f"armature: of the rotors; a guess where the source states none: {ROTOR_RULE}.",)
HOPS = (
    f"At {1e3 * STEP_S:g} ms these legs hop if their rotors are lighter than guessed.",
    "State them (`armature`, or `rotor_inertia` and `gear`), then try the longer step.",
)
NAMES = {
    "packages": "package:// roots; nothing is searched in a build",
    "relative_to": "where relative names start",
    "absolute": "what absolute names of the author's machine begin with, and what lies there",
}
"""Keys that say what file names mean, and why they are stated."""
BALANCE = (
    "Its feet touch the floor in points that span no area: only a controller that balances it",
    "keeps it up, so nothing asks it to stand still.",
)


def recipe_name(name: str) -> str:
    """The robot's name as a recipe may spell it; many an MJCF is called `scene`, as ours are."""
    spelled = re.sub(r"[^A-Za-z0-9_.-]", "_", name)
    return (spelled if spelled[:1].isalpha() and spelled not in SCENES else f"robot_{spelled}")[:64]


def urdf_recipe(
    robot: InspectedRobot, anatomy: Anatomy, source: UrdfSource, path: Path
) -> Proposal:
    """The whole recipe, as it will lie at `path`; its drives and pose are tried before."""
    edits, turn = repairs(robot), turned(robot)
    whole = mended(replace(robot, turned=turn), edits)
    tree = whole.tree
    soles = soles_of(whole, anatomy)
    exclude = Exclude(adjacent=True, pairs=tuple(compound_pairs(robot.tree, anatomy.size_m)))
    with staged(whole, soles, exclude) as stage:
        depths = stage.depths()
        tuning = tune(stage, anatomy, {}, depths=depths)
        left, inside = depths(tuning.pose), made_so(tree, depths, tuning.pose)
    trial = tuning.trial
    guessed = tuple(re.escape(edit.on) for edit in edits if edit.keys.get("guessed"))
    unknown = [f"{f.message} ({f.hint})" for f in invented(whole.links, guessed)]
    opposed = (f for f in robot.link_findings if f.rule == MIMIC_LIMITS.id and f.blocks)
    contradicted = map(with_remedy, contradictions(tree, whole.extents(tree)))
    unrepaired = (*_locked(tree), *map(with_remedy, opposed), *unknown, *contradicted)
    unmended = (*unrepaired, *trial.unmended)
    draft = Draft()
    put_head(draft, whole, anatomy, path, unmended)
    _put_source(draft, source, path)
    put_up_axis(draft, robot, turn)
    draft.put(anatomy.base, "base", beside=plain(anatomy.base_reason, 200))
    _put_fixed_joints(draft, robot)
    put_repairs(draft, robot, edits)
    note_loops(draft, robot.links)
    draft.put(20000, "visual", "max_faces", beside="finer meshes are thinned, each with a finding")
    hand = hand_of(robot, anatomy, tuning.driven)
    put_collision(draft, robot, anatomy, exclude.pairs, trial.overlaps, inside, hand)
    put_actuators(draft, tuning)
    put_home(draft, robot, anatomy, tuning.pose)
    _note_left(draft, left, {*trial.overlaps, *inside})
    _put_simulation(draft, whole, anatomy, tuning, hand)
    _put_variants(draft, robot, anatomy)
    return Proposal(path, draft.text, unmended, anatomy.doubt)


def _locked(tree: Tree) -> Iterator[str]:
    """Limits of 0 and 0 are what an exporter writes that knows none."""
    moving = [joint for joint in tree.moving_joints if joint.mimic is None]
    if moving and all(joint.is_locked for joint in moving):
        which = f"all {len(moving)} moving joints" if len(moving) > 1 else "the only moving joint"
        yield (
            f"equal limits lock {which}, so nothing can be driven "
            "(give the ranges by `set_limits` under `edits`, as in the comment below)"
        )


# --- where from -----------------------------------------------------------------------------


def put_head(
    draft: Draft, robot: InspectedRobot, anatomy: Anatomy, path: Path, unmended: Sequence[str]
) -> None:
    """What the robot is and what no recipe can mend, in a comment, and its name."""
    tree, name = robot.tree, robot.links.name
    mass, moving = total_mass(tree), counted(len(tree.moving_joints), "moving joint")
    bodies = counted(len(tree.bodies), "body", "bodies")
    lines = [
        "yaml-language-server: $schema=recipe.schema.json",
        f"{plain(name, 80)}: {mass:.4g} kg, {bodies}, {moving}",
        "Written by `assetbuild init`: read it, correct it, it is yours. Build it with",
        f"assetbuild build {shown_path(path)}",
        *(f"NOT READY: {problem}" for problem in unmended),
        *([f"UNDECIDED: {anatomy.doubt}"] if anatomy.doubt else []),
        *(["Frames that survive as sites under the names of their links:"] * bool(anatomy.sensors)),
        *(f"{kind}: {some(names)}" for kind, names in anatomy.sensors.items()),
    ]
    draft.put("assetbuild/v1", "schema", above=lines)
    draft.put(recipe_name(name), "robot")


def put_source(draft: Draft, root: Path, recipe: Path, key: str, file: str) -> None:
    """The section `source` of a recipe that will lie at `recipe`."""
    relative = os.path.relpath(root, os.path.realpath(recipe.parent))
    draft.put(Path(relative).as_posix(), "source", "path", beside="relative to this file")
    draft.put(file, "source", key)
    put_licence(draft, root, file)


def put_licence(draft: Draft, root: Path, file: str) -> None:
    """The licence where a file states one that has an SPDX name; else a comment."""
    stated, at = stated_licence(root, file), ("source", "license")
    if stated is None:
        draft.note("license: its SPDX name here; no file of the source states a known one", at=at)
        return
    name, words, said_by = stated
    if name:
        carried = "; only a copy below `path` comes into the bundle" * said_by.startswith("..")
        draft.put(name, *at, beside=f"as {said_by} says{carried}")
    else:
        draft.note(f"{said_by} says {words!r}: write the SPDX name of this robot's", at=at)
        draft.note("license:", at=at)


def _put_source(draft: Draft, source: UrdfSource, path: Path) -> None:
    """Where it comes from, what its names mean, what it lacks and what is repaired in its text."""
    stated = source.recipe
    put_source(draft, source.root, path, "xacro" if stated.xacro else "urdf", stated.description)
    others = [(k, v) for k, v in source.defaults.items() if k not in stated.args]
    if stated.args:
        draft.put(stated.args, "source", "args")
    if others:
        defaults = (f"{name}: {json.dumps(value)}" for name, value in others)
        draft.note("`args` may also state (defaults):", *defaults, at=("source", "args"))
    for key, why in NAMES.items():
        if value := getattr(stated, key):
            draft.put(value, "source", key, beside=why)
    visuals, absent = stated.missing.visuals, stated.missing.packages
    if visuals:
        lines = ["Visual meshes that the source lacks: nothing is drawn for them."]
        meant = ((name, lacking(source.root, name)[1]) for name in visuals)
        lines += [f"{name}: {hint}" for name, hint in meant if hint]
        draft.put([*visuals], "source", "missing", "visuals", above=lines)
    if absent:
        lines = ["Packages that the xacro asks for and reads nothing of (controllers, Gazebo)."]
        draft.put([*absent], "source", "missing", "packages", above=lines)
    for patch in stated.patches:
        draft.add(patch.model_dump(exclude_defaults=True), "source", "patches")
        draft.beside["source", "patches"] = "repairs of the text before it is read"


def _put_fixed_joints(draft: Draft, robot: InspectedRobot) -> None:
    links, bodies = len(robot.links.bodies), len(robot.tree.bodies)
    remain = counted(bodies, "body", "bodies")
    merged = f"{links} links become {remain}; the others survive as frames"
    why = merged if bodies < links else "every link moves, so none is merged"
    draft.put(True, "fixed_joints", "merge", beside=why)


# --- drives and poses -----------------------------------------------------------------------


def put_actuators(draft: Draft, tuning: Tuning) -> None:
    """The table of the drives."""
    rows, moving = tuning.drives, tuning.tree.moving_joints
    if not rows:
        return
    guessed = any(row.guess for row in rows)
    rotors = any(row.armature and row.gains for row in rows)
    corrected = (f"Corrected: {note}" for note in tuning.notes)
    lines = (*GAINS, *GUESSED * guessed, *ROTORS * rotors, *corrected)
    mimics = [joint.name for joint in moving if joint.mimic is not None]
    if mimics:
        lines = (*lines, f"These mimic others and need no row: {some(mimics)}")
    draft.note(*lines, at=("actuators",))
    for row in rows:
        above = [_described(row)]
        above += [f"source {word} ignored: {DROPPED[word]}" for word in row.drops]
        for keys in row.table(tuning.tree):
            draft.add(keys, "actuators", above=above)
            above = ["the rest of these joints: one pattern for all would be too long"]


def _described(row: DriveRow) -> str:
    """What a row of the table is of."""
    count = "1 joint" if len(row.joints) == 1 else f"{len(row.joints)} joints"
    if row.locked:
        return f"{count} locked by equal limits: a drive would move nothing"
    if row.role == "caster":
        return f"{count} of casters, which follow where the wheels go"
    if row.effort is None:
        return f"{count} without effort that nothing seems to drive: casters, springs"
    torque, unit = ("N", "kg") if row.unit == "m" else ("N m", "kg m2")
    speed = f"{row.velocity:g} {row.unit}/s" if row.velocity else "no stated speed"
    moved = f"{row.inertia:.3g} {unit}" if row.inertia else "what the edits above give a mass"
    guess = f" (a guess for the {row.role}: {row.guess})" if row.guess else ""
    return f"{count}: {row.effort:g} {torque}{guess}, {speed}, moves {moved}"


def put_home(
    draft: Draft, robot: InspectedRobot, anatomy: Anatomy, pose: Mapping[str, float]
) -> None:
    """The keyframe `home`."""
    tree, keys = robot.tree, ("keyframes", "home", "joints")
    if not pose and tree.base == "fixed":
        return
    legged = {joint.name for leg in anatomy.legs for joint in leg.joints}
    shown = {n: v for n, v in pose.items() if v != 0.0 or (n in legged and any(pose.values()))}
    if robot.links.base == "floating":
        below = "the lowest collision point touches z = 0"
        draft.put("on_ground", "keyframes", "home", "base", beside=below)
    if not shown:
        draft.put({}, *keys, beside="all joints at 0, which the limits allow")
        return
    lines = ["all feet at one height, below their hips"] * bool(legged & shown.keys())
    others = [name for name in pose if name not in legged]
    if any(abs(pose[name] - resting(tree.by_joint[name])) > 1e-3 for name in others):
        lines.append(TURNED)
    lines.append("joints not named here are 0, which their limits allow")
    # Of all joints: a pattern must not state those that loops move.
    known = [joint.name for joint in tree.moving_joints if joint.mimic is None]
    joints = {
        pattern: value
        for value in dict.fromkeys(shown.values())
        for pattern in patterns_of([n for n, v in shown.items() if v == value], known)
    }
    draft.put(joints, *keys, above=lines)


def _note_left(draft: Draft, depths: Mapping[Pair, float], excluded: Collection[Pair]) -> None:
    """What no pose that was tried frees, and who must act."""
    left = [(pair, depth) for pair, depth in depths.items() if pair not in excluded]
    for (a, b), depth in sorted(left, key=lambda item: -item[1])[:SHOWN]:
        where = f"{b} below z = 0" if not a else f"{a} in {b}"
        draft.note(f"No home was found without {where}: {1e3 * depth:.3g} mm", at=("keyframes",))
    if left:
        more = "Another `home` may free them, or `collision.exclude.pairs` let them pass."
        draft.note(more, at=("keyframes",))


# --- trying it out --------------------------------------------------------------------------


def _soles(robot: InspectedRobot, legs: Sequence[Leg]) -> str:
    """One pattern for the links that the robot stands on."""
    soles = [sole for leg in legs for sole in leg.soles]
    first, *others = patterns_of(soles, list(robot.links.by_body))
    return f"({'|'.join((first, *others))})" if others else first


def _put_simulation(
    draft: Draft, robot: InspectedRobot, anatomy: Anatomy, tuning: Tuning, hand: Sequence[str]
) -> None:
    legs, tree = anatomy.legs, tuning.tree
    draft.put([0.8, 0.02, 0.01], "contact", "friction", beside="" if hand else "rubber on a floor")
    draft.put(3, "contact", "condim")
    put_pads(draft, robot, hand, tuning.timestep)
    _put_steps(draft, tuning)
    formats, why = usual_targets(robot)
    draft.put(formats, "targets", beside=why)
    efforts = [tree.by_joint[j.name].limits.effort for leg in legs for j in leg.joints]
    walks = bool(legs) and all(efforts)
    put_validation(draft, robot, legs if walks else (), tuning.trial, hand)
    if walks and "mjcf" in formats:
        feet, imu = inline({"links": _soles(robot, legs)}), inline({"link": robot.tree.root})
        draft.note("To train in mjlab: add `mjlab` to the targets, and", at=("training",))
        draft.note(f"feet: {feet}", f"imu: {imu}   # or the link of its IMU", at=("training",))


def put_validation(
    draft: Draft,
    robot: InspectedRobot,
    legs: Sequence[Leg],
    trial: Trial | None,
    hand: Sequence[str] = (),
) -> None:
    """The section `validate`: a robot that stands by its drives must go on to do so.

    trial: None where nothing asks it to stand. hand: links that grip.
    """
    at = ("validate", "stand")
    if legs and trial is not None:
        row = {"keyframe": "home", "seconds": 2, "feet": _soles(robot, legs)}
        did = plain(trial.sentence, 200)
        if trial.stands:
            seen = [f"In MuJoCo, with the hulls of its links, it {did}."]
            draft.put(row, *at, beside="a fall is an error", above=seen)
        elif trial.stands is None and len(legs) >= MANY_LEGS:
            draft.put(row, *at, above=[f"Judged by its legs to stand, but not tried: {did}."])
        else:
            how = "In MuJoCo it" if trial.stands is not None else "Not tried:"
            draft.note(f"{how} {did}.", *(f"Tried besides: {it}." for it in trial.tried), at=at)
            later = "Once its gains and pose are balanced, ask it to stand:"
            proposal = (later, f"stand: {inline(row)}")
            draft.note(*(BALANCE if trial.points else proposal), at=at)
            draft.put({}, "validate", "free_fall")
    if hand:
        draft.put({}, "validate", "grip", beside="holds a cube, a cylinder and a sphere")


def _put_steps(draft: Draft, tuning: Tuning) -> None:
    step = tuning.timestep
    hops = any(row.outruns(STEP_S) for row in tuning.drives)
    light = step < STEP_S and not hops and total_mass(tuning.tree) < LIGHT_KG
    rate = f"{1.0 / step:.0f} Hz physics{', as it is light;' if light else ','} 50 Hz control"
    steps = {"timestep": step, "decimation": round(0.02 / step)}
    draft.put(steps, "simulation", beside=rate, above=HOPS if hops else ())


def _put_variants(draft: Draft, robot: InspectedRobot, anatomy: Anatomy) -> None:
    weak = {f.subject for f in robot.link_findings if f.rule == "inertia.positive"}
    feet = [leg.foot for leg in anatomy.legs if leg.foot not in robot.tree.by_body]
    if feet and weak.isdisjoint(f"link {foot}" for foot in feet):
        kept = {"fixed_joints": {"keep_bodies": patterns_of(feet, list(robot.links.by_body))}}
        why = ["Feet as bodies of their own, for contact sensors that are bound to bodies."]
        draft.put(kept, "variants", "foot_bodies", above=why)
