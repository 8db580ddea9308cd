"""The recipe as text: each choice with its reason beside it."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from assetbuild.init.anatomy import Anatomy, Leg
from assetbuild.init.drives import (
    DAMPING_RATIO,
    FASTEST_HZ,
    FASTEST_LEG_HZ,
    FULL_ERROR,
    SAG,
    SLOWEST_HZ,
    STEP_S,
    DriveRow,
    drive_rows,
)
from assetbuild.init.home import home_pose
from assetbuild.init.joint_range import resting
from assetbuild.init.look import InspectedRobot
from assetbuild.init.patterns import pattern_of, patterns_of
from assetbuild.init.repairs import repairs
from assetbuild.init.source import UrdfSource
from assetbuild.init.targets import targets
from assetbuild.init.trial import Trial, tables, try_to_stand
from assetbuild.init.up_axis import turned
from assetbuild.init.words import flow, inline, plain, quoted, some, source_section, written
from assetbuild.recipe.loader import shown_path
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.model import Tree
from assetbuild.robot.shapes import MeshFile
from assetbuild.robot.tree import forward_kinematics

COMPOUND = 0.15
"""Joints closer than this share of the robot's size make one compound joint (a hip, a wrist)."""
LIGHT_KG = 5.0
SHORT_STEP_S = 0.002
MANY_LEGS = 4
"""Robots on as many legs usually stand."""
DROPPED = {"damping": "it would creep for minutes", "friction": "it takes most of the effort"}


def recipe_name(name: str) -> str:
    """The robot's name as a recipe may spell it."""
    plain = re.sub(r"[^A-Za-z0-9_.-]", "_", name)
    return (plain if plain[:1].isalpha() else f"robot_{plain}")[:64]


def recipe_text(robot: InspectedRobot, anatomy: Anatomy, source: UrdfSource, path: Path) -> str:
    """The whole recipe, as it will lie at `path`."""
    pose = home_pose(robot.tree, anatomy.legs)
    drives = drive_rows(robot.tree, pose, anatomy.legs)
    more = (*_arguments(source), *_packages(source), *turned(source, robot))
    return written(
        head(robot, anatomy, path),
        source_section(source.root, path, source.key, source.file, *more),
        [f"base: {anatomy.base}   # {plain(anatomy.base_reason, 200)}"],
        _fixed_joints(robot),
        repairs(robot, source.root),
        ["visual:", "  max_faces: 20000   # finer meshes are thinned, each with a finding"],
        _collision(robot, anatomy),
        _actuators(robot.tree, drives),
        home(robot, anatomy, pose),
        _simulation(robot, anatomy, drives, lambda: _tried(robot, anatomy, source, pose, drives)),
        _variants(robot, anatomy),
    )


# --- where from -----------------------------------------------------------------------------


def head(robot: InspectedRobot, anatomy: Anatomy, path: Path) -> Iterator[str]:
    """What the robot is, in a comment, and its name."""
    tree, name = robot.tree, robot.links.name
    mass, moving = total_mass(tree), len(tree.moving_joints)
    yield f"# {plain(name)}: {mass:.4g} kg, {len(tree.bodies)} bodies, {moving} moving joints"
    yield "# Written by `assetbuild init`: read it, correct it, it is yours. Build it with"
    yield f"#   assetbuild build {plain(shown_path(path))}"
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
    if source.absent:
        yield "    # Packages that the xacro asks for and reads nothing of (controllers, Gazebo)."
        yield f"    packages: {inline(source.absent)}"


def _fixed_joints(robot: InspectedRobot) -> Iterator[str]:
    links, bodies = len(robot.links.bodies), len(robot.tree.bodies)
    merged = f"{links} links become {bodies} bodies; the others survive as frames"
    yield "fixed_joints:"
    yield f"  merge: true   # {merged if bodies < links else 'every link moves, so none is merged'}"


# --- geometry -------------------------------------------------------------------------------


def _collision(robot: InspectedRobot, anatomy: Anatomy) -> Iterator[str]:
    origin, why = "visual", "the source has no collision shapes"
    if robot.shapes.of("collision"):
        seen = {shape.link for shape in robot.shapes.of("visual")}
        idle = len(seen - robot.solid_links)
        why = f"{idle} links are drawn but hit nothing, as in the source" if idle else "all have it"
        origin = "collision"
    yield "collision:"
    yield "  preset: locomotion   # coarse and fast; `manipulation` stays close to the mesh"
    yield (
        "  # auto: a primitive stays as it is, a mesh becomes few convex pieces within tolerances"
    )
    yield f"  default: {{method: auto, from: {origin}}}   # {why}"
    balls = _ball_feet(robot, anatomy)
    if balls:
        yield "  links:"
        yield "    # A foot that meets the ground in a point rolls best as a sphere."
        yield from (f"    {quoted(p)}: {{method: primitive, shape: sphere}}" for p in balls)
    yield "  exclude:"
    yield "    adjacent: true   # bodies that a joint connects never collide"
    pairs = _compound_pairs(robot.tree, anatomy.size_m)
    if pairs:
        yield "    # Joints close together make one (a hip, a wrist): hulls overlap there."
        yield from flow("    pairs: [", [inline(pair) for pair in pairs], "]")


def _ball_feet(robot: InspectedRobot, anatomy: Anatomy) -> tuple[str, ...]:
    """Feet of walkers on four legs or more that are meshes and nothing else."""
    if len(anatomy.legs) < 4:
        return ()
    solid = robot.shapes.of("collision") or robot.shapes.of("visual")
    balls = []
    for leg in anatomy.legs:
        own = [s for s in solid if s.link == leg.foot]
        separate = leg.foot != leg.tip or len(leg.joints) >= 4
        if own and separate and all(isinstance(s.geometry, MeshFile) for s in own):
            balls.append(leg.foot)
    return patterns_of(balls, list(robot.links.by_body)) if balls else ()


def _compound_pairs(tree: Tree, size: float) -> list[tuple[str, str]]:
    """A body and the one two joints further, where the two joints are close together."""
    poses = forward_kinematics(tree, {})
    pairs = []
    for joint in tree.joints:
        above = tree.joint_above.get(joint.parent)
        if above is not None:
            apart = math.dist(poses[joint.child].xyz, poses[above.child].xyz)
            if apart < COMPOUND * size:
                pairs.append((above.parent, joint.child))
    return pairs


# --- drives and poses -----------------------------------------------------------------------


def _actuators(tree: Tree, rows: Sequence[DriveRow]) -> Iterator[str]:
    if not rows:
        return
    yield "# Effort and velocity limits are the source's; joints with equal limits share a row."
    yield (
        f"# kp gives all the effort at an error of {FULL_ERROR['rad']:g} rad "
        f"({1e3 * FULL_ERROR['m']:g} mm for slides), but keeps the natural"
    )
    yield (
        f"# frequency with what the joint moves at home between {SLOWEST_HZ:g} and "
        f"{FASTEST_HZ:g} Hz (legs: {FASTEST_LEG_HZ:g}) and the sag by its own"
    )
    yield f"# weight below {SAG['rad']:g} rad; kd: damping ratio {DAMPING_RATIO:g} or more. Joints"
    yield "# too unlike for one kp get a frequency and a damping ratio. A first guess: put the"
    yield "# motor's data here when you know it."
    yield "actuators:"
    everything = [joint.name for joint in tree.moving_joints]
    for row in rows:
        for pattern in patterns_of(row.joints, everything):
            yield from _row(pattern, row)
    mimics = [joint.name for joint in tree.moving_joints if joint.mimic is not None]
    if mimics:
        yield f"  # mimic others and need no row: {some(mimics)}"


def _row(pattern: str, row: DriveRow) -> Iterator[str]:
    count = "1 joint" if len(row.joints) == 1 else f"{len(row.joints)} joints"
    passive = inline({"joints": pattern, "model": "passive"})
    if row.locked:
        yield f"  # {count} locked by equal limits: a drive would move nothing"
        yield f"  - {passive}"
        return
    if row.effort is None:
        yield f"  # {count} without effort in the source: state `effort`, kp, kd to drive"
        yield f"  - {passive}"
        return
    torque, unit = ("N", "kg") if row.unit == "m" else ("N m", "kg m2")
    speed = f"{row.velocity:g} {row.unit}/s" if row.velocity else "no stated speed"
    moved = f"{row.inertia:.3g} {unit}" if row.inertia else "what the edits above give a mass"
    yield f"  # {count}: {row.effort:g} {torque}, {speed}, moves {moved}"
    for word in row.drops:
        yield f"  # the source's {word} of these joints cannot be meant: {DROPPED[word]}"
    keys = {"joints": pattern, "model": "pd", **row.gains, **dict.fromkeys(row.drops, 0)}
    yield f"  - {inline(keys)}"


def home(robot: InspectedRobot, anatomy: Anatomy, pose: dict[str, float]) -> Iterator[str]:
    """The keyframe `home`."""
    tree = robot.tree
    if not pose and tree.base == "fixed":
        return
    legged = {joint.name for leg in anatomy.legs for joint in leg.joints}
    shown = {n: v for n, v in pose.items() if v != 0.0 or (n in legged and any(pose.values()))}
    yield "keyframes:"
    yield "  home:"
    if robot.links.base == "floating":
        yield "    base: on_ground   # the lowest collision point touches z = 0"
    if not shown:
        yield "    joints: {}   # all joints at 0, which the limits allow"
        return
    if legged & shown.keys():
        yield "    # each foot below its hip, all at one height"
    others = [name for name in pose if name not in legged]
    if any(abs(pose[name] - resting(tree.by_joint[name])) > 1e-3 for name in others):
        yield "    # what the drives could not hold against gravity is turned"
    yield "    # joints not named here are 0, which their limits allow"
    yield "    joints:"
    for value in dict.fromkeys(shown.values()):
        names = [name for name, v in shown.items() if v == value]
        patterns = patterns_of(names, list(pose))
        yield from (f"      {quoted(pattern)}: {value!r}" for pattern in patterns)


# --- trying it out --------------------------------------------------------------------------


def standing(robot: InspectedRobot, legs: Sequence[Leg]) -> str:
    """The line that has the robot stand on its soles."""
    return f"stand: {{keyframe: home, seconds: 2, feet: {quoted(_soles(robot, legs))}}}"


def _soles(robot: InspectedRobot, legs: Sequence[Leg]) -> str:
    return pattern_of([sole for leg in legs for sole in leg.soles], list(robot.links.by_body))


def _tried(
    robot: InspectedRobot,
    anatomy: Anatomy,
    source: UrdfSource,
    pose: dict[str, float],
    drives: Sequence[DriveRow],
) -> Trial:
    step = {"timestep": timestep(robot.tree, drives)}
    soles = [sole for leg in anatomy.legs for sole in leg.soles]
    return try_to_stand(robot, source.root, soles, tables(drives, pose, step))


def _simulation(
    robot: InspectedRobot,
    anatomy: Anatomy,
    drives: Sequence[DriveRow],
    trial: Callable[[], Trial],
) -> Iterator[str]:
    legs = anatomy.legs
    yield "contact: {friction: [0.8, 0.02, 0.01], condim: 3}   # rubber on a floor"
    yield from _steps(robot.tree, drives)
    yield targets(robot)
    if not legs or not all(joint.limits.effort for leg in legs for joint in leg.joints):
        return
    yield from validation(robot, legs, trial())
    if targets(robot).startswith("targets: [urdf, mjcf"):
        yield "# To train in mjlab: add `mjlab` to the targets, and"
        yield f"# feet: {{links: {quoted(_soles(robot, legs))}}}"
        yield f"# imu: {{link: {quoted(robot.tree.root)}}}   # or the link of its IMU"


def validation(robot: InspectedRobot, legs: Sequence[Leg], trial: Trial) -> Iterator[str]:
    """The section `validate`: a robot that stands by its drives must go on to do so."""
    line, said = standing(robot, legs), plain(trial.sentence, 200)
    yield "validate:"
    if trial.stands:
        yield f"  # In MuJoCo, on its soles, it {said}."
        yield f"  {line}   # a fall is an error"
    elif trial.stands is None and len(legs) >= MANY_LEGS:
        yield f"  # Judged by its legs to stand, but not tried: {said}."
        yield f"  {line}"
    else:
        seen = "In MuJoCo, on its soles, it" if trial.stands is not None else "Not tried:"
        yield f"  # {seen} {said}."
        yield "  # Once its gains and pose are balanced, ask it to stand:"
        yield f"  # {line}"
        yield "  free_fall: {}"


def timestep(tree: Tree, drives: Sequence[DriveRow]) -> float:
    """Contacts of a light robot need short steps, as stiff legs without rotors do; s."""
    hops = any(row.outruns(STEP_S) for row in drives)
    return SHORT_STEP_S if hops or total_mass(tree) < LIGHT_KG else STEP_S


def _steps(tree: Tree, drives: Sequence[DriveRow]) -> Iterator[str]:
    hops = any(row.outruns(STEP_S) for row in drives)
    if hops:
        yield f"# At {1e3 * STEP_S:g} ms these legs would hop, for they lack their rotors' inertia."
        yield "# State it (`armature`, or `rotor_inertia` and `gear`), then try the longer step."
    if timestep(tree, drives) < STEP_S:
        said = f"# 500 Hz physics{'' if hops else ', as it is light'}; 50 Hz control"
        yield f"simulation: {{timestep: {SHORT_STEP_S}, decimation: 10}}   {said}"
    else:
        yield f"simulation: {{timestep: {STEP_S}, decimation: 4}}   # 200 Hz physics, 50 Hz control"


def _variants(robot: InspectedRobot, anatomy: Anatomy) -> Iterator[str]:
    feet = [leg.foot for leg in anatomy.legs if leg.foot not in robot.tree.by_body]
    if feet:
        patterns = patterns_of(feet, list(robot.links.by_body))
        yield "variants:"
        yield "  # Feet as bodies of their own, for contact sensors that are bound to bodies."
        yield f"  foot_bodies: {{fixed_joints: {{keep_bodies: {inline(patterns)}}}}}"
