"""What an MJCF of the robot must say: the robot's facts in MuJoCo's structure.

Massless links between joints are no bodies there, fixed joints no joints, a planar joint is three,
and a torque motor stands for every drive whose law acts outside of the simulator.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from assetbuild.facts.mjcf_opaque import attributes_of, mjcf_names, source_commands
from assetbuild.facts.mjcf_words import SURFACE
from assetbuild.facts.reference import Reference, filtered_pairs, pose_value, robot_table
from assetbuild.facts.table import Key, Table, Value, pair_name, pair_of
from assetbuild.robot.chains import axis_in_body, find_chains
from assetbuild.robot.contact_filter import ContactFilter
from assetbuild.robot.loops import site_names
from assetbuild.robot.model import Actuator, Joint, Tree
from assetbuild.robot.pose import IDENTITY, quat_between, rotation_of

MOTORS = ("ideal_pd", "dc_motor", "motor")
AT_SITE = ("accelerometer", "gyro", "velocimeter", "magnetometer", "force", "torque", "touch",
           "rangefinder")  # fmt: skip
"""Sensors that MuJoCo has on a site alone."""
DEFAULT_PRM = (1.0, *(0.0,) * 9)


def mjcf_table(reference: Reference) -> Table:
    """Facts of `<robot>.xml`, without the words that only MJCF has."""
    reference = replace(reference, control=reference.control.in_mjcf)
    facts = dict(robot_table(reference).facts)
    tree = reference.tree
    facts |= _structure(reference, facts)
    for actuator in reference.control.actuators:
        joint = tree.by_joint.get(actuator.joint)
        if joint is not None:
            _drive(actuator, joint, facts)
    facts = {key: value for key, value in facts.items() if key.quantity != "drive name"}
    for joint_name, name in _drive_names(reference).items():
        facts[Key("joint", joint_name, "drive name")] = name
    _limits(tree, facts)
    _shapes(reference, facts)
    _senses(reference, facts)
    facts |= dict(_redundant_excludes(reference))
    sites = site_names(tree, reference.control.loops)
    for loop in reference.control.loops:  # by sites, which are frames to every reader
        for site, end in zip(sites[loop.name], loop.ends, strict=True):
            facts[Key("frame", site, "body")] = end.body
            facts[Key("frame", site, "pose")] = pose_value(end.X_body_end)
    return Table(_renamed(facts, mjcf_names(tree)))


def _structure(reference: Reference, facts: dict[Key, Value]) -> dict[Key, Value]:
    """Bodies and joints as MuJoCo has them; removes from `facts` what it has not."""
    tree = reference.tree
    made: dict[Key, Value] = {}
    chains = find_chains(tree, {shape.link for shape in reference.shapes.shapes})
    hidden = {link for chain in chains for link in chain.between}
    carried = {j.name for j in tree.joints if j.kind not in ("revolute", "continuous", "prismatic")}
    for key in [k for k in facts if k.kind == "body" and k.name in hidden]:
        del facts[key]
    for key in [k for k in facts if k.kind == "joint" and k.name in carried]:
        del facts[key]
    for chain in chains:
        made[Key("body", chain.body, "parent")] = chain.parent
        made[Key("body", chain.body, "pose")] = pose_value(chain.pose_in_parent)
        for joint, X_body_joint in zip(chain.joints, chain.joint_poses, strict=True):
            place: dict[str, Value] = {
                "body": chain.body,
                "parent": chain.parent,
                "anchor": tuple(X_body_joint.xyz),
                "axis": tuple(axis_in_body(joint, X_body_joint)),
            }
            made |= {
                Key("joint", name, quantity): value
                for name, facts_of in _joints(joint, place)
                for quantity, value in facts_of.items()
            }
    in_chain = {joint.name for chain in chains for joint in chain.joints}
    for joint in tree.joints:
        if joint.kind in ("planar", "ball") and joint.name not in in_chain:
            place = {"body": joint.child, "parent": joint.parent}
            made |= {Key("joint", name, quantity): value
                     for name, facts_of in _joints(joint, place)
                     for quantity, value in facts_of.items()}  # fmt: skip
    for body in tree.bodies:
        inertial = body.inertial
        if inertial is None or not (inertial.mass_kg or any(inertial.inertia_com_kg_m2)):
            facts.pop(Key("body", body.name, "centre of mass"), None)
            facts.pop(Key("body", body.name, "inertia"), None)
    if tree.base == "floating":
        made[Key("body", tree.root, "pose")] = _resting_pose(reference)
        facts.pop(Key("robot", "", "base pose"), None)
    return made


def _redundant_excludes(reference: Reference) -> Iterator[tuple[Key, Value]]:
    """Pairs that MuJoCo passes by itself while the base floats, and no longer when it is pinned."""
    tree, control = reference.tree, reference.control
    solid = {shape.link for shape in reference.shapes.shapes}
    rule = ContactFilter.of(tree, reference.shapes, control)
    hidden = {link for chain in find_chains(tree, solid) for link in chain.between}
    for a, b in control.excludes:
        redundant = rule.passes(a, b) and not rule.holds_without(tree.root, a, b)
        if redundant and not {a, b} & hidden:
            yield Key("pair", pair_name(a, b), "mjcf:excludes"), 1.0


def _joints(joint: Joint, place: Mapping[str, Value]) -> Iterator[tuple[str, dict[str, Value]]]:
    """(name in MJCF, facts): a planar joint is two slides across its normal and a hinge."""
    if joint.kind == "ball":
        yield joint.name, {q: v for q, v in place.items() if q != "axis"} | {"type": "ball"}
        return
    if joint.kind != "planar":
        yield joint.name, dict(place)
        return
    turn = rotation_of(quat_between((0.0, 0.0, 1.0), joint.axis))
    for column, suffix in enumerate(("x", "y", "yaw")):
        axis = tuple(float(v) for v in turn[:, column])
        kind = "rotary" if suffix == "yaw" else "linear"
        yield f"{joint.name}_{suffix}", {**place, "axis": axis, "type": kind}


def _resting_pose(reference: Reference) -> Value:
    """Return where a floating root rests before any keyframe: at the height of the initial one."""
    for item in reference.control.mjcf_only:
        if item.place == "root":
            said = attributes_of(item.element)
            xyz = tuple(float(v) for v in said.get("pos", "0 0 0").split())
            quat = tuple(float(v) for v in said.get("quat", "1 0 0 0").split())
            return (*xyz, *quat)
    first = reference.control.initial_keyframe
    height = first.base.xyz[2] if first is not None and first.base is not None else 0.0
    return (0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0)


def _drive(actuator: Actuator, joint: Joint, facts: dict[Key, Value]) -> None:
    """As MuJoCo drives it: limits of the command, and what acts outside of the simulator."""

    def put(quantity: str, value: Value) -> None:
        facts[Key("joint", joint.name, quantity)] = value

    limits, gear, ctrl = joint.limits, actuator.gear, _command_range(actuator)
    opens = joint.kind != "continuous" and _opens(joint) and gear == 1.0
    match actuator.model:
        case "passive":
            put("effort", None)
            return
        case "pd":
            reach = (limits.lower, limits.upper) if opens else None
            put("command range", ctrl or reach)  # type: ignore[arg-type] # both stated
        case "velocity":
            speed = actuator.velocity
            put("command range", ctrl or ((-speed, speed) if speed else None))
        case "general":
            kind, kp, kd = _law(actuator)
            put("model", kind)
            if kind == "general" or (kind == "motor" and kp != 1.0):
                put("drive parameters", _general(actuator))
            else:
                facts.pop(Key("joint", joint.name, "drive parameters"), None)
            put("command range", ctrl)
            put("kp", kp * gear * gear if kind == "pd" else 0.0)
            put("kd", kd * gear * gear if kind in ("pd", "velocity") else 0.0)
            if reached := _reached(actuator):
                put("effort", max(-reached[0], reached[1]))
                put("mjcf:effort range", reached if reached[0] != -reached[1] else None)
        case _:
            effort = actuator.effort
            own = effort / abs(gear) if effort else None
            ctrl = ctrl or ((-own, own) if own else None)
            put("model", "motor")
            put("command range", ctrl)
            asked = max(-ctrl[0], ctrl[1]) * abs(gear) if ctrl else effort
            put("effort", min(asked, effort or asked) if asked else None)
            put("kp", 0.0)
            put("kd", 0.0)
    if actuator.model == "velocity":
        put("kp", 0.0)


def _command_range(actuator: Actuator) -> tuple[float, float] | None:
    """Return the command range in MuJoCo's counting, which a gear scales."""
    if actuator.ctrl is None:
        return None
    low, high = sorted(end * actuator.command_gear for end in actuator.ctrl)
    return low, high


def _reached(actuator: Actuator) -> tuple[float, float] | None:
    """Least and greatest force where it is the command times a gain, and the command is limited."""
    said, ctrl = actuator.general, actuator.ctrl
    if said is None or ctrl is None or said.gaintype != "fixed":
        return None
    filtered = said.dyntype in ("none", "filter", "filterexact")
    if not filtered or said.biastype != "none":
        return None
    gain = float((*said.gainprm, *DEFAULT_PRM[len(said.gainprm) :])[0])
    low, high = sorted(actuator.gear * gain * end for end in ctrl)
    most = math.inf if actuator.effort is None else actuator.effort
    return max(low, -most), min(high, most)


def _law(actuator: Actuator) -> tuple[str, float, float]:
    """(model, gain, kd): a general actuator may say what a plainer one says too."""
    said = actuator.general
    if said is None or said.dyntype != "none" or said.gaintype != "fixed":
        return "general", 0.0, 0.0
    gain = float((*said.gainprm, *DEFAULT_PRM[len(said.gainprm) :])[0])
    bias = [float(v) for v in (*said.biasprm, 0.0, 0.0, 0.0)[:3]]
    if said.biastype == "none" or not any(bias):
        return "motor", gain, 0.0
    if said.biastype == "affine" and gain > 0.0 and bias[0] == 0.0 and bias[1] in (0.0, -gain):
        kind = "pd" if bias[1] else "velocity"
        if kind == "pd" or bias[2] == -gain:
            return kind, gain, -bias[2]
    return "general", gain, 0.0


def _drive_names(reference: Reference) -> dict[str, str]:
    """Menagerie's: the joint's without `_joint` where that is unique, unless it has its own."""
    rows = [row for row in reference.control.actuators if row.model != "passive"]
    short = [row.name or row.joint.removesuffix("_joint") or row.joint for row in rows]
    named = {row.joint: name if short.count(name) == 1 else row.joint
             for row, name in zip(rows, short, strict=True)}  # fmt: skip
    return {joint: name for joint, name in named.items() if name != joint}


def _general(actuator: Actuator) -> str:
    said = actuator.general
    if said is None:
        return ""
    fill = [(*prm, *usual[len(prm) :]) for prm, usual in (
        (said.dynprm, DEFAULT_PRM), (said.gainprm, DEFAULT_PRM), (said.biasprm, (0.0,) * 10),
    )]  # fmt: skip
    kinds = [said.dyntype, said.gaintype, said.biastype]
    return json.dumps([*kinds, *(tuple(float(v) for v in row) for row in fill)])


def _opens(joint: Joint) -> bool:
    lower, upper = joint.limits.lower, joint.limits.upper
    return lower is not None and upper is not None and lower < upper


def _limits(tree: Tree, facts: dict[Key, Value]) -> None:
    """MJCF has ranges that open; one of no width is an equality, a crossed one is none."""
    for joint in tree.moving_joints:
        lower, upper = joint.limits.lower, joint.limits.upper
        locked = lower is not None and lower == upper and joint.kind != "continuous"
        if not _opens(joint) and not (locked and joint.mimic is None):
            facts[Key("joint", joint.name, "lower")] = None
            facts[Key("joint", joint.name, "upper")] = None


def _touching(reference: Reference) -> set[str]:
    """Bodies of which any shape may touch something."""
    own, tree = dict(reference.control.contacts), reference.tree
    surfaces = [(s, own.get(s.name, reference.control.contact))
                for s in reference.shapes.of("collision")]  # fmt: skip
    return {tree.placement(s.link)[0] for s, said in surfaces if said.mask or said.partners}


def _shapes(reference: Reference, facts: dict[Key, Value]) -> None:
    touching = _touching(reference)
    for pair in filtered_pairs(reference.tree, reference.shapes, reference.control):
        if not set(pair) <= touching:
            del facts[Key("pair", pair_name(*pair), "filtered")]  # masks say it
    pictures = {material.name: material.texture or "" for material in reference.shapes.materials}
    for shape in reference.shapes.shapes:
        meets = [facts.get(Key("shape", shape.name, bits)) for bits in ("mask", "partners")]
        if shape.role == "collision" and not any(meets):
            for quantity in SURFACE:  # of what touches nothing
                facts.pop(Key("shape", shape.name, quantity), None)
        if shape.role == "visual":
            facts[Key("shape", shape.name, "mask")] = 0.0
            facts[Key("shape", shape.name, "partners")] = 0.0
            if not pictures.get(shape.material or "", "").lower().endswith(".png"):
                facts.pop(Key("shape", shape.name, "texture"), None)


def shown_pictures(reference: Reference) -> set[str]:
    """Files of the pictures that visual shapes wear and MuJoCo can read."""
    pictures = {material.name: material.texture or "" for material in reference.shapes.materials}
    worn = {pictures.get(shape.material or "", "") for shape in reference.shapes.of("visual")}
    known = dict(reference.assets.pixels)
    return {file for file in worn if file.lower().endswith(".png") and file in known}


def _senses(reference: Reference, facts: dict[Key, Value]) -> None:
    """Objects of sensors by MuJoCo's names; a body whose frame is a sensor's place has a site."""
    tree, control = reference.tree, reference.control
    drives = _drive_names(reference)
    for sensor in control.sensors:
        place, kind = sensor.at, sensor.kind
        word, name = place.kind, place.name
        if word == "actuator":
            name = drives.get(name, name)
        if kind.startswith("subtree"):
            word = "body"
        seen = f"{word} {name}".strip() if word != "world" else "world"
        facts[Key("sensor", sensor.name, "object")] = seen
        relative = sensor.relative_to
        if relative is not None and relative.kind == "world":
            facts[Key("sensor", sensor.name, "reference")] = ""
        if kind in AT_SITE and place.kind == "frame" and place.name in tree.by_body:
            put_site(place.name, facts)
    known = {row.joint: row for row in control.actuators}
    commands = dict(source_commands(control.mjcf_only))
    for key in control.keyframes:
        for joint, value in key.joints:
            row = known.get(joint)
            if row is not None and row.model != "passive":
                aimed = value * row.gear if row.model == "pd" else 0.0
                aimed = commands.get((key.name, drives.get(joint, joint)), aimed)
                facts[Key("keyframe", f"{key.name}/{joint}", "target")] = aimed
        turns = dict(key.turns)
        for joint_ in tree.joints:
            if joint_.kind == "ball":
                turn = turns.get(joint_.name, IDENTITY.quat)
                facts[Key("keyframe", f"{key.name}/{joint_.name}", "mjcf:orientation")] = turn
            if joint_.kind == "planar":
                for suffix in ("x", "y", "yaw"):
                    facts[Key("keyframe", f"{key.name}/{joint_.name}_{suffix}", "position")] = 0.0


def put_site(body: str, facts: dict[Key, Value]) -> None:
    """A site in the origin of a body."""
    facts[Key("frame", body, "body")] = body
    facts[Key("frame", body, "pose")] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def _renamed(facts: Mapping[Key, Value], names: Mapping[str, str]) -> dict[Key, Value]:
    """With MuJoCo's names of bodies, where these differ."""
    changed = {old: new for old, new in names.items() if old != new}
    if not changed:
        return dict(facts)
    found: dict[Key, Value] = {}
    for key, value in facts.items():
        if key.kind == "body" or (key.kind == "frame" and key.name in changed):
            key = key._replace(name=changed.get(key.name, key.name))
        if key.quantity in ("body", "parent", "body a", "body b") and isinstance(value, str):
            value = changed.get(value, value)
        if key.kind == "sensor" and isinstance(value, str) and " " in value:
            kind, name = value.split(" ", 1)
            value = f"{kind} {changed.get(name, name)}"
        if key.kind == "pair":
            one, other = (changed.get(name, name) for name in pair_of(key.name))
            key = key._replace(name=pair_name(one, other))
        found[key] = value
    return found


def solver_facts(reference: Reference, section: str) -> dict[str, Value]:
    """Solver options by the recipe's section, and by what the source's MJCF says besides."""
    said: Mapping[str, Any] = reference.options.get(section) or {}  # Any: plain JSON
    cone = said.get("cone") or "elliptic"
    impratio = said.get("impratio") or (50.0 if cone == "elliptic" else 1.0)
    found: dict[str, Value] = {
        "integrator": said.get("integrator", "implicitfast"),
        "cone": cone,
        "solver": said.get("solver", "Newton"),
        "iterations": float(said.get("iterations") or 100),
        "line search iterations": float(said.get("ls_iterations") or 50),
        "impratio": float(impratio),
    }
    return found
