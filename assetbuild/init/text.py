"""The recipe as text: each choice with its reason beside it."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from assetbuild.init.anatomy import Anatomy
from assetbuild.init.drives import (
    DAMPING_RATIO,
    FASTEST_HZ,
    FASTEST_LEG_HZ,
    FULL_ERROR,
    SAG,
    SLOWEST_HZ,
    STEP_S,
    Row,
    drive_rows,
)
from assetbuild.init.home import home_pose, resting
from assetbuild.init.look import Looked
from assetbuild.init.patterns import patterns_of
from assetbuild.init.repairs import repairs
from assetbuild.init.source import Found
from assetbuild.init.targets import targets
from assetbuild.init.up_axis import turned
from assetbuild.init.words import flow, plain, quoted, some
from assetbuild.recipe.loader import shown_path
from assetbuild.robot.model import MeshFile, Tree
from assetbuild.robot.pose import Pose
from assetbuild.robot.tree import forward_kinematics

COMPOUND = 0.15
"""Joints closer than this share of the robot's size make one compound joint (a hip, a wrist)."""
LIGHT_KG = 5.0


def recipe_name(name: str) -> str:
    """The robot's name as a recipe may spell it."""
    plain = re.sub(r"[^A-Za-z0-9_.-]", "_", name)
    return (plain if plain[:1].isalpha() else f"robot_{plain}")[:64]


def recipe_text(robot: Looked, anatomy: Anatomy, source: Found, path: Path) -> str:
    """The whole recipe, as it will lie at `path`."""
    pose = home_pose(robot.tree, anatomy.legs)
    drives = drive_rows(robot.tree, pose, anatomy.legs)
    sections = (
        head(robot, anatomy, path),
        _source(source, path, turned(source, robot)),
        [f"base: {anatomy.base.kind}   # {plain(anatomy.base.reason, 200)}"],
        _fixed_joints(robot, anatomy),
        repairs(robot, source.root),
        ["visual:", "  max_faces: 20000   # finer meshes are thinned, each with a finding"],
        _collision(robot, anatomy),
        _actuators(robot.tree, drives),
        home(robot, anatomy, pose),
        _simulation(robot, anatomy, drives),
        _variants(robot, anatomy),
    )
    lines: list[str] = []
    for section in sections:
        if section:
            lines += [*section, ""]
    return "\n".join(lines).rstrip() + "\n"


# --- where from -----------------------------------------------------------------------------


def head(robot: Looked, anatomy: Anatomy, path: Path) -> list[str]:
    """What the robot is, in a comment, and its name."""
    tree = robot.tree
    mass = sum(body.inertial.mass_kg for body in tree.bodies if body.inertial)
    moving = len(tree.moving_joints)
    sensors = [f"# {kind}: {some(names)}" for kind, names in anatomy.sensors.items()]
    return [
        f"# {plain(robot.links.name)}: {mass:.4g} kg, {len(tree.bodies)} bodies, "
        f"{moving} moving joints",
        "# Written by `assetbuild init`: read it, correct it, it is yours. Build it with",
        f"#   assetbuild build {plain(shown_path(path))}",
        *(["# Frames that survive as sites under the names of their links:"] if sensors else []),
        *sensors,
        "schema: assetbuild/v1",
        f"robot: {quoted(recipe_name(robot.links.name))}",
    ]


def _source(source: Found, path: Path, turned: list[str]) -> list[str]:
    folder = os.path.realpath(path.parent)
    relative = Path(os.path.relpath(source.root, folder)).as_posix()
    lines = [
        "source:",
        f"  path: {quoted(relative)}   # relative to this file",
        f"  {source.key}: {quoted(source.file)}",
        *_args(source),
    ]
    if source.packages:
        pairs = ", ".join(f"{quoted(k)}: {quoted(v)}" for k, v in source.packages.items())
        lines.append(
            f"  packages: {{{pairs}}}   # package:// roots; nothing is searched in a build"
        )
    lines += turned
    return [*lines, "  # license: MIT   # the SPDX name of the source's licence; please state it"]


def _args(source: Found) -> Iterator[str]:
    """What was given, and what else the file takes with its default."""
    if source.args:
        given = ", ".join(f"{quoted(k)}: {json.dumps(v)}" for k, v in source.args.items())
        yield f"  args: {{{given}}}"
    others = [(k, v) for k, v in source.defaults.items() if k not in source.args]
    if others:
        yield "  # its other arguments and their defaults, for `args`:"
        yield from (f"  #   {plain(name)}: {plain(json.dumps(value))}" for name, value in others)


def _fixed_joints(robot: Looked, anatomy: Anatomy) -> list[str]:
    links, bodies = len(robot.links.bodies), len(robot.tree.bodies)
    lines = ["fixed_joints:"]
    lines.append(
        f"  merge: true   # {links} links become {bodies} bodies; the others survive as frames"
        if bodies < links
        else "  merge: true   # every link moves, so none is merged"
    )
    return lines


# --- geometry -------------------------------------------------------------------------------


def _collision(robot: Looked, anatomy: Anatomy) -> list[str]:
    solid = {shape.link for shape in robot.shapes.of("collision")}
    seen = {shape.link for shape in robot.shapes.of("visual")}
    lines = [
        "collision:",
        "  preset: locomotion   # coarse and fast; `manipulation` stays close to the mesh",
        "  # auto: a primitive stays as it is, a mesh becomes few convex pieces within tolerances",
    ]
    if solid:
        idle = len(seen - solid)
        why = f"{idle} links are drawn but hit nothing, as in the source" if idle else "all have it"
        lines.append(f"  default: {{method: auto, from: collision}}   # {why}")
    else:
        lines.append(
            "  default: {method: auto, from: visual}   # the source has no collision shapes"
        )
    balls = _ball_feet(robot, anatomy)
    if balls:
        lines.append("  links:")
        lines.append("    # A foot that meets the ground in a point rolls best as a sphere.")
        lines += [f"    {quoted(p)}: {{method: primitive, shape: sphere}}" for p in balls]
    lines += ["  exclude:", "    adjacent: true   # bodies that a joint connects never collide"]
    pairs = _compound_pairs(robot.tree, anatomy.size_m)
    if pairs:
        lines.append("    # Joints close together make one (a hip, a wrist): hulls overlap there.")
        lines += flow("    pairs: [", [f"[{quoted(a)}, {quoted(b)}]" for a, b in pairs], "]")
    return lines


def _ball_feet(robot: Looked, anatomy: Anatomy) -> tuple[str, ...]:
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
    return patterns_of(balls, [body.name for body in robot.links.bodies]) if balls else ()


def _compound_pairs(tree: Tree, size: float) -> list[tuple[str, str]]:
    """A body and the one two joints further, where the two joints are close together."""
    poses = forward_kinematics(tree, {})
    pairs = []
    for joint in tree.joints:
        above = tree.joint_above.get(joint.parent)
        if above is None:
            continue
        if _distance(poses[joint.child], poses[above.child]) < COMPOUND * size:
            pairs.append((above.parent, joint.child))
    return pairs


def _distance(a: Pose, b: Pose) -> float:
    return float(sum((x - y) ** 2 for x, y in zip(a.xyz, b.xyz, strict=True)) ** 0.5)


# --- drives and poses -----------------------------------------------------------------------


def _actuators(tree: Tree, rows: Sequence[Row]) -> list[str]:
    if not rows:
        return []
    everything = [joint.name for joint in tree.moving_joints]
    lines = [
        "# Effort and velocity limits are the source's; joints with equal limits share a row.",
        f"# kp gives all the effort at an error of {FULL_ERROR['rad']:g} rad "
        f"({1e3 * FULL_ERROR['m']:g} mm for slides), but keeps the natural",
        f"# frequency with what the joint moves at home between {SLOWEST_HZ:g} and "
        f"{FASTEST_HZ:g} Hz (legs: {FASTEST_LEG_HZ:g}) and the sag by its own",
        f"# weight below {SAG['rad']:g} rad; kd: damping ratio {DAMPING_RATIO:g} or more. Joints",
        "# too unlike for one kp get a frequency and a damping ratio. A first guess: put the",
        "# motor's data here when you know it.",
        "actuators:",
    ]
    for row in rows:
        for pattern in patterns_of(row.joints, everything):
            lines.extend(_row(pattern, row))
    mimics = [joint.name for joint in tree.moving_joints if joint.mimic is not None]
    if mimics:
        lines.append(f"  # mimic others and need no row: {some(mimics)}")
    return lines


def _row(pattern: str, row: Row) -> Iterator[str]:
    torque = "N" if row.unit == "m" else "N m"
    if row.locked:
        yield f"  # {_joints(row)} locked by equal limits: a drive would move nothing"
        yield f"  - {{joints: {quoted(pattern)}, model: passive}}"
        return
    if row.effort is None:
        yield f"  # {_joints(row)} without effort in the source: state `effort`, kp, kd to drive"
        yield f"  - {{joints: {quoted(pattern)}, model: passive}}"
        return
    speed = f"{row.velocity:g} {row.unit}/s" if row.velocity else "no stated speed"
    unit = "kg" if row.unit == "m" else "kg m2"
    moved = f"{row.inertia:.3g} {unit}" if row.inertia else "what the edits above give a mass"
    yield f"  # {_joints(row)}: {row.effort:g} {torque}, {speed}, moves {moved}"
    gains = f"kp: {row.kp!r}, kd: {row.kd!r}"
    if row.frequency is not None:
        gains = f"frequency: {row.frequency!r}, damping_ratio: {row.damping_ratio!r}"
    for drops, word, why in (
        (row.drops_damping, "damping", "it would creep for minutes"),
        (row.drops_friction, "friction", "it takes most of the effort"),
    ):
        if drops:
            yield f"  # the source's {word} of these joints cannot be meant: {why}"
            gains += f", {word}: 0"
    yield f"  - {{joints: {quoted(pattern)}, model: pd, {gains}}}"


def _joints(row: Row) -> str:
    return "1 joint" if len(row.joints) == 1 else f"{len(row.joints)} joints"


def home(robot: Looked, anatomy: Anatomy, pose: dict[str, float]) -> list[str]:
    """The keyframe `home`."""
    tree = robot.tree
    if not pose and tree.base == "fixed":
        return []
    legged = {joint.name for leg in anatomy.legs for joint in leg.joints}
    shown = {n: v for n, v in pose.items() if v != 0.0 or (n in legged and any(pose.values()))}
    lines = ["keyframes:", "  home:"]
    if robot.links.base == "floating":
        lines.append("    base: on_ground   # the lowest collision point touches z = 0")
    if not shown:
        return [*lines, "    joints: {}   # all joints at 0, which the limits allow"]
    if legged & shown.keys():
        lines.append("    # each foot below its hip, all at one height")
    others = {n: value for n, value in pose.items() if n not in legged}
    if any(abs(value - resting(tree.by_joint[n])) > 1e-3 for n, value in others.items()):
        lines.append("    # what the drives could not hold against gravity is turned")
    lines.append("    # joints not named here are 0, which their limits allow")
    lines.append("    joints:")
    for value in sorted(set(shown.values()), key=list(shown.values()).index):
        names = [name for name, v in shown.items() if v == value]
        patterns = patterns_of(names, list(pose))
        lines.extend(f"      {quoted(pattern)}: {value!r}" for pattern in patterns)
    return lines


def _simulation(robot: Looked, anatomy: Anatomy, drives: Sequence[Row]) -> list[str]:
    lines = [
        "contact: {friction: [0.8, 0.02, 0.01], condim: 3}   # rubber on a floor",
        *_steps(robot, drives),
        targets(robot),
    ]
    driven = all(joint.limits.effort for leg in anatomy.legs for joint in leg.joints)
    if anatomy.legs and driven:
        feet = patterns_of(
            [sole for leg in anatomy.legs for sole in leg.soles],
            [body.name for body in robot.links.bodies],
        )
        pattern = feet[0] if len(feet) == 1 else f"({'|'.join(feet)})"
        stand = f"stand: {{keyframe: home, seconds: 2, feet: {quoted(pattern)}}}"
        lines.append("validate:")
        if len(anatomy.legs) >= 4:
            lines.append(f"  {stand}   # must not fall or sink")
        else:
            lines.append(f"  # {stand}")
            lines.append(
                "  # Two legs stand only with balanced gains: switch this on once they are."
            )
            lines.append("  free_fall: {}")
        if targets(robot).startswith("targets: [urdf, mjcf"):
            lines += [
                "# To train in mjlab: add `mjlab` to the targets, and",
                f"# feet: {{links: {quoted(pattern)}}}",
                f"# imu: {{link: {quoted(robot.tree.root)}}}   # or the link of its IMU",
            ]
    return lines


def _steps(robot: Looked, drives: Sequence[Row]) -> Iterator[str]:
    """Contacts of a light robot need short steps, as stiff legs without rotors do."""
    mass = sum(body.inertial.mass_kg for body in robot.tree.bodies if body.inertial)
    hops = any(row.outruns(STEP_S) for row in drives)
    if hops:
        yield f"# At {1e3 * STEP_S:g} ms these legs would hop, for they lack their rotors' inertia."
        yield "# State it (`armature`, or `rotor_inertia` and `gear`), then try the longer step."
    if hops or mass < LIGHT_KG:
        why = "" if hops else ", as it is light"
        yield (
            "simulation: {timestep: 0.002, decimation: 10}   "
            f"# 500 Hz physics{why}; 50 Hz control"
        )
    else:
        yield f"simulation: {{timestep: {STEP_S}, decimation: 4}}   # 200 Hz physics, 50 Hz control"


def _variants(robot: Looked, anatomy: Anatomy) -> list[str]:
    feet = [leg.foot for leg in anatomy.legs if leg.foot not in robot.tree.by_body]
    if not feet:
        return []
    patterns = patterns_of(feet, [body.name for body in robot.links.bodies])
    listed = ", ".join(map(quoted, patterns))
    return [
        "variants:",
        "  # Feet as bodies of their own, for contact sensors that are bound to bodies.",
        f"  foot_bodies: {{fixed_joints: {{keep_bodies: [{listed}]}}}}",
    ]
