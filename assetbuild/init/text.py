"""The recipe as text: each choice with its reason beside it."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from assetbuild.body.lint import invented
from assetbuild.init.anatomy import Anatomy, Leg
from assetbuild.init.collision import (
    collision,
    compound_pairs,
    driven_by,
    hand_of,
    pads,
    soles_of,
    tried,
)
from assetbuild.init.drives import (
    DAMPING_RATIO,
    FASTEST_HZ,
    FASTEST_LEG_HZ,
    FULL_ERROR,
    LEAST_ERROR,
    SAG,
    SLOWEST_HZ,
    STEP_S,
    DriveRow,
)
from assetbuild.init.home import DEEP_M, Pair, made_so, nothing_deep
from assetbuild.init.licence import source_section
from assetbuild.init.look import InspectedRobot, Weighed, targets
from assetbuild.init.loops import NO_LOOPS, FoundLoops, find_loops
from assetbuild.init.packages import lacking
from assetbuild.init.repairs import guessed_masses, mended, repairs, repairs_text, unmended
from assetbuild.init.source import UrdfSource
from assetbuild.init.strength import MARGIN, ROTOR_RULE, is_locked, resting
from assetbuild.init.trial import Trial, staged, tables
from assetbuild.init.tune import LIGHT_KG, Tuning, tune
from assetbuild.init.up_axis import turned
from assetbuild.init.words import (
    Proposal,
    flow,
    inline,
    pattern_of,
    patterns_of,
    plain,
    quoted,
    some,
    written,
)
from assetbuild.recipe.loader import shown_path
from assetbuild.robot.contact import Exclude
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.model import Tree
from assetbuild.targets.mjcf.files import SCENES

TURNED = "turned: what the drives could not hold, or what lay in the floor or in itself"
SHOWN = 8
"""Most overlaps that are named."""
MANY_LEGS = 4
"""Robots on as many legs usually stand."""
DROPPED = {
    "damping": "the joints would take minutes to reach their targets",
    "friction": "it would take most of their effort",
}


def recipe_name(name: str) -> str:
    """The robot's name as a recipe may spell it; many an MJCF is called `scene`, as ours are."""
    plain = re.sub(r"[^A-Za-z0-9_.-]", "_", name)
    return (plain if plain[:1].isalpha() and plain not in SCENES else f"robot_{plain}")[:64]


def urdf_recipe(
    robot: InspectedRobot, anatomy: Anatomy, source: UrdfSource, path: Path
) -> Proposal:
    """The whole recipe, as it will lie at `path`; its drives and pose are tried before."""
    edits = repairs(robot)
    up_axis, turn = turned(robot)
    whole = mended(replace(robot, turned=turn), edits)
    tree = whole.tree
    soles, loops = soles_of(whole, anatomy), find_loops(whole)

    exclude = Exclude(adjacent=True, pairs=tuple(compound_pairs(robot.tree, anatomy.size_m)))
    with staged(whole, soles) as stage:

        def attempt(tuning: Tuning) -> Trial:
            drives, pose = loops.drives(tuning.drives), loops.pose(tuning.pose)
            step = {"timestep": tuning.timestep}
            return stage.attempt(tables(tree, drives, pose, step, loops.rows, exclude))

        depths = stage.depths(exclude) if not loops.rows else nothing_deep
        tuning, trial = tune(tree, anatomy, attempt, loops=loops, depths=depths)
        left = {p: d for p, d in depths(tuning.pose, True).items() if d > DEEP_M}
        inside = made_so(tree, depths, tuning.pose)
    drives, pose = loops.drives(tuning.drives), loops.pose(tuning.pose)
    tuning = replace(tuning, drives=drives, pose=pose)
    contrary = Weighed(whole).unmended()
    unknown = [f"{f.message} ({f.hint})" for f in invented(whole.links, guessed_masses(edits))]
    unrepaired = (*_locked(tree), *unmended(robot), *unknown, *contrary)
    tuning = replace(tuning, unmended=(*unrepaired, *tuning.unmended))
    more = (*_arguments(source), *_packages(source), *up_axis)
    text = written(
        head(whole, anatomy, path, tuning.unmended),
        source_section(source.root, path, source.key, source.file, *more),
        [f"base: {anatomy.base}   # {plain(anatomy.base_reason, 200)}"],
        _fixed_joints(robot),
        repairs_text(robot, edits),
        loops.text(),
        ["visual:", "  max_faces: 20000   # finer meshes are thinned, each with a finding"],
        collision(robot, anatomy, trial.overlaps, inside),
        actuators(tuning),
        home(robot, anatomy, tuning.pose, loops),
        _left(left, {*trial.overlaps, *inside}),
        _simulation(whole, anatomy, tuning, trial),
        _variants(robot, anatomy),
    )
    return Proposal(path, text, tuning.unmended, anatomy.doubt)


def _locked(tree: Tree) -> Iterator[str]:
    """Limits of 0 and 0 are what an exporter writes that knows none."""
    moving = [joint for joint in tree.moving_joints if joint.mimic is None]
    if moving and all(map(is_locked, moving)):
        which = f"all {len(moving)} moving joints" if len(moving) > 1 else "the only moving joint"
        yield (
            f"equal limits lock {which}, so nothing can be driven "
            "(give the ranges by `set_limits` under `edits`, as in the comment below)"
        )


# --- where from -----------------------------------------------------------------------------


def head(
    robot: InspectedRobot, anatomy: Anatomy, path: Path, unmended: Sequence[str] = ()
) -> Iterator[str]:
    """What the robot is and what no recipe can mend, in a comment, and its name."""
    tree, name = robot.tree, robot.links.name
    mass, moving = total_mass(tree), len(tree.moving_joints)
    yield "# yaml-language-server: $schema=recipe.schema.json"
    yield f"# {plain(name)}: {mass:.4g} kg, {len(tree.bodies)} bodies, {moving} moving joints"
    yield "# Written by `assetbuild init`: read it, correct it, it is yours. Build it with"
    yield f"#   assetbuild build {plain(shown_path(path))}"
    for problem in unmended:
        yield f"# NOT READY: {plain(problem, 300)}"
    if anatomy.doubt:
        yield f"# UNDECIDED: {plain(anatomy.doubt, 500)}"
    if anatomy.sensors:
        yield "# Frames that survive as sites under the names of their links:"
    for kind, names in anatomy.sensors.items():
        yield f"# {kind}: {some(names)}"
    yield "schema: assetbuild/v1"
    yield f"robot: {quoted(recipe_name(name))}"


def _arguments(source: UrdfSource) -> Iterator[str]:
    """What was given, and what else the file takes with its default."""
    if source.args:  # the values are texts, whatever they look like
        given = ", ".join(f"{quoted(k)}: {json.dumps(v)}" for k, v in source.args.items())
        yield f"  args: {{{given}}}"
    others = [(k, v) for k, v in source.defaults.items() if k not in source.args]
    if others:
        yield "  # its other arguments and their defaults, for `args`:"
        yield from (f"  #   {plain(name)}: {plain(json.dumps(value))}" for name, value in others)


def _packages(source: UrdfSource) -> Iterator[str]:
    if source.packages:
        folders = inline(source.packages)
        yield f"  packages: {folders}   # package:// roots; nothing is searched in a build"
    if source.relative_to is not None:
        yield f"  relative_to: {quoted(source.relative_to)}   # where relative names start"
    if source.absolute:
        yield "  # What absolute names of the author's machine begin with, and what lies there:"
        yield f"  absolute: {inline(source.absolute)}"
    yield from _missing(source)
    if source.patches:
        yield "  patches:   # repairs of the text before it is read; tell its authors"
    for patch in source.patches:
        yield f"    - {inline(patch.model_dump(exclude_defaults=True))}"


def _missing(source: UrdfSource) -> Iterator[str]:
    """What the source lacks and the robot can do without."""
    if source.missing or source.absent:
        yield "  missing:"
    if source.missing:
        yield "    # Visual meshes that the source lacks: nothing is drawn for them."
        yield from flow("    visuals: [", [quoted(path) for path in source.missing], "]")
        meant = ((path, lacking(source.root, path)[1]) for path in source.missing)
        yield from (f"    # {plain(path)}: {plain(hint)}" for path, hint in meant if hint)
    if source.absent:
        yield "    # Packages that the xacro asks for and reads nothing of (controllers, Gazebo)."
        yield f"    packages: {inline(source.absent)}"


def _fixed_joints(robot: InspectedRobot) -> Iterator[str]:
    links, bodies = len(robot.links.bodies), len(robot.tree.bodies)
    merged = f"{links} links become {bodies} bodies; the others survive as frames"
    yield "fixed_joints:"
    yield f"  merge: true   # {merged if bodies < links else 'every link moves, so none is merged'}"


# --- drives and poses -----------------------------------------------------------------------


def actuators(tuning: Tuning) -> Iterator[str]:
    """The table of the drives."""
    rows, moving = tuning.drives, tuning.tree.moving_joints
    if not rows:
        return
    yield "# Effort and velocity limits are the source's. Joints with equal limits that move about"
    yield "# as much share a row."
    yield (
        f"# kp gives all the effort at an error of {FULL_ERROR['rad']:g} rad "
        f"({1e3 * FULL_ERROR['m']:g} mm for slides), but keeps the natural"
    )
    yield (
        f"# frequency with what the joint moves at home between {SLOWEST_HZ:g} and "
        f"{FASTEST_HZ:g} Hz (legs: {FASTEST_LEG_HZ:g}) and the sag by its own"
    )
    yield (
        f"# weight below {SAG['rad']:g} rad. A weak drive gives all its effort at "
        f"{LEAST_ERROR['rad']:g} rad or more."
    )
    yield f"# kd: damping ratio {DAMPING_RATIO:g} or more. Joints too unlike for one kp get a"
    yield "# frequency and a damping ratio. A first guess: put the motor's data here."
    if any(row.guess for row in rows):
        yield "# `guessed`: the source states no effort that can be meant. The guess holds"
        yield f"# {MARGIN:g} times what gravity asks in the worst pose, and more."
        yield "# Every build warns until you replace them."
    if any(row.armature and row.gains for row in rows):
        yield "# armature: of the rotors; where the source states none, a guess, the least that a"
        yield f"# motor of that size has: {ROTOR_RULE}."
    yield from (f"# Corrected: {plain(note, 400)}" for note in tuning.notes)
    yield "actuators:"
    everything = [joint.name for joint in moving]
    for row in rows:
        for pattern in patterns_of(row.joints, everything):
            yield from _row(pattern, row)
    mimics = [joint.name for joint in moving if joint.mimic is not None]
    if mimics:
        yield f"  # mimic others and need no row: {some(mimics)}"


def _row(pattern: str, row: DriveRow) -> Iterator[str]:
    """A row of the table below what it is of."""
    count = "1 joint" if len(row.joints) == 1 else f"{len(row.joints)} joints"
    if row.locked:
        count += " locked by equal limits: a drive would move nothing"
    elif row.role == "loop":
        count += " that the loops move"
    elif row.role == "caster":
        count += " of casters, which follow where the wheels go"
    elif row.effort is None:
        count += " without effort that nothing seems to drive: casters, springs"
    else:
        torque, unit = ("N", "kg") if row.unit == "m" else ("N m", "kg m2")
        speed = f"{row.velocity:g} {row.unit}/s" if row.velocity else "no stated speed"
        moved = f"{row.inertia:.3g} {unit}" if row.inertia else "what the edits above give a mass"
        guess = f" is a guess for the {row.role}, as {row.guess}" if row.guess else ""
        count += f": {row.effort:g} {torque}{guess}, {speed}, moves {moved}"
    yield f"  # {count}"
    for word in row.drops:
        yield f"  # source {word} ignored: {DROPPED[word]}"
    yield f"  - {inline({'joints': pattern, **row.keys})}"


def home(
    robot: InspectedRobot,
    anatomy: Anatomy,
    pose: Mapping[str, float],
    loops: FoundLoops = NO_LOOPS,
    why: str = TURNED,
) -> Iterator[str]:
    """The keyframe `home`. why: joints other than the legs' are not at rest there."""
    tree = robot.tree
    if not pose and tree.base == "fixed" and not loops.rows:
        return
    legged = {joint.name for leg in anatomy.legs for joint in leg.joints}
    shown = {n: v for n, v in pose.items() if v != 0.0 or (n in legged and any(pose.values()))}
    yield "keyframes:"
    yield "  home:"
    if robot.links.base == "floating":
        yield "    base: on_ground   # the lowest collision point touches z = 0"
    if not shown:
        how = "from where a build closes the loops" if loops.rows else "which the limits allow"
        yield f"    joints: {{}}   # all joints at 0, {how}"
        return
    if legged & shown.keys():
        yield "    # each foot below its hip, all at one height"
    others = [name for name in pose if name not in legged]
    if any(abs(pose[name] - resting(tree.by_joint[name])) > 1e-3 for name in others):
        yield f"    # {why}"
    yield "    # joints not named here are 0, which their limits allow"
    yield "    joints:"
    for value in dict.fromkeys(shown.values()):
        names = [name for name, v in shown.items() if v == value]
        patterns = patterns_of(names, list(pose))
        yield from (f"      {quoted(pattern)}: {value!r}" for pattern in patterns)


def _left(depths: Mapping[Pair, float], excluded: Collection[Pair]) -> Iterator[str]:
    """What no pose that was tried frees, and who must act."""
    left = [(pair, depth) for pair, depth in depths.items() if pair not in excluded]
    for (a, b), depth in sorted(left, key=lambda item: -item[1])[:SHOWN]:
        where = f"{plain(b)} below z = 0" if not a else f"{plain(a)} in {plain(b)}"
        yield f"# No home was found without {where}: {1e3 * depth:.3g} mm"
    if left:
        yield "# Another `home` may free them, or `collision.exclude.pairs` let them pass."


# --- trying it out --------------------------------------------------------------------------


def standing(robot: InspectedRobot, legs: Sequence[Leg]) -> str:
    """The line that has the robot stand on its soles."""
    return f"stand: {{keyframe: home, seconds: 2, feet: {quoted(_soles(robot, legs))}}}"


def _soles(robot: InspectedRobot, legs: Sequence[Leg]) -> str:
    return pattern_of([sole for leg in legs for sole in leg.soles], list(robot.links.by_body))


def _simulation(
    robot: InspectedRobot, anatomy: Anatomy, tuning: Tuning, trial: Trial
) -> Iterator[str]:
    legs, tree = anatomy.legs, tuning.tree
    hand = hand_of(robot, anatomy, tree, driven_by(tuning))
    if hand:
        yield from ("contact:", "  friction: [0.8, 0.02, 0.01]", "  condim: 3")
        yield from pads(robot, hand, tuning.timestep)
    else:
        yield "contact: {friction: [0.8, 0.02, 0.01], condim: 3}   # rubber on a floor"
    yield from _steps(tuning)
    yield targets(robot)
    efforts = [tree.by_joint[j.name].limits.effort for leg in legs for j in leg.joints]
    walks = bool(legs) and all(efforts)
    yield from tried(validation(robot, legs, trial) if walks else (), hand)
    if walks and targets(robot).startswith("targets: [urdf, mjcf"):
        yield "# To train in mjlab: add `mjlab` to the targets, and"
        yield f"# feet: {{links: {quoted(_soles(robot, legs))}}}"
        yield f"# imu: {{link: {quoted(robot.tree.root)}}}   # or the link of its IMU"


def validation(robot: InspectedRobot, legs: Sequence[Leg], trial: Trial) -> Iterator[str]:
    """The section `validate`: a robot that stands by its drives must go on to do so."""
    line, said = standing(robot, legs), plain(trial.sentence, 200)
    yield "validate:"
    if trial.stands:
        yield f"  # In MuJoCo, with the hulls of its links, it {said}."
        yield f"  {line}   # a fall is an error"
    elif trial.stands is None and len(legs) >= MANY_LEGS:
        yield f"  # Judged by its legs to stand, but not tried: {said}."
        yield f"  {line}"
    else:
        seen = "In MuJoCo it" if trial.stands is not None else "Not tried:"
        yield f"  # {seen} {said}."
        yield from (f"  # Tried besides: {plain(what, 200)}." for what in trial.tried)
        if trial.points:
            yield "  # Its feet touch the floor in points that span no area: only a controller that"
            yield "  # balances it keeps it up, so nothing asks it to stand still."
        else:
            yield "  # Once its gains and pose are balanced, ask it to stand:"
            yield f"  # {line}"
        yield "  free_fall: {}"


def _steps(tuning: Tuning) -> Iterator[str]:
    step = tuning.timestep
    hops = any(row.outruns(STEP_S) for row in tuning.drives)
    if hops:
        yield f"# At {1e3 * STEP_S:g} ms these legs hop if their rotors are lighter than guessed."
        yield "# State them (`armature`, or `rotor_inertia` and `gear`), then try the longer step."
    light = ", as it is light" if not hops and total_mass(tuning.tree) < LIGHT_KG else ""
    rate = f"{1.0 / step:.0f} Hz physics{light if step < STEP_S else ''}"
    tail = f"# {rate}{';' if light and step < STEP_S else ','} 50 Hz control"
    yield f"simulation: {{timestep: {step!r}, decimation: {round(0.02 / step)}}}   {tail}"


def _variants(robot: InspectedRobot, anatomy: Anatomy) -> Iterator[str]:
    feet = [leg.foot for leg in anatomy.legs if leg.foot not in robot.tree.by_body]
    if feet:
        patterns = patterns_of(feet, list(robot.links.by_body))
        yield "variants:"
        yield "  # Feet as bodies of their own, for contact sensors that are bound to bodies."
        yield f"  foot_bodies: {{fixed_joints: {{keep_bodies: {inline(patterns)}}}}}"
