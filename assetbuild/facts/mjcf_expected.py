"""What an MJCF of the robot must say: the robot's facts in MuJoCo's structure.

Massless links between joints are no bodies there, fixed joints no joints, a planar joint is three,
and a torque motor stands for every drive whose law acts outside of the simulator.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from assetbuild.facts.derived import SOLIMP, SOLREF
from assetbuild.facts.reference import Reference, filtered_pairs, pose_value, robot_table
from assetbuild.facts.table import Key, Table, Value, pair_name
from assetbuild.robot.chains import axis_in_body, find_chains
from assetbuild.robot.contact_filter import ContactFilter
from assetbuild.robot.loops import site_names
from assetbuild.robot.model import MOVING, Actuator, Control, General, Joint, Loop, Softness
from assetbuild.robot.pose import IDENTITY, quat_between, rotation_of
from assetbuild.simulators.mujoco import body_names

STRONGEST = (3.0, 2.0, 1.0)
"""Parameters of a contact sensor: it reports `found` and `force` of the strongest contact."""


def mjcf_table(reference: Reference) -> Table:
    """Facts of an MJCF."""
    reference = replace(reference, control=reference.control.in_mjcf)
    facts = dict(robot_table(reference).facts)
    _structure(reference, facts)
    names = _drive_names(reference)
    for joint in reference.tree.moving_joints:
        drive = drive_facts(joint, reference.control, names)
        facts |= {Key("joint", joint.name, quantity): value for quantity, value in drive.items()}
    _shapes(reference, facts)
    _senses(reference, names, facts)
    facts |= {Key("pair", name, "mjcf:excluded"): True for name in _excluded(reference)}
    _poses(reference, facts)
    _softness(reference, facts)
    return Table(_renamed(facts, body_names(reference.tree)))


def _structure(reference: Reference, facts: dict[Key, Value]) -> None:
    """Bodies and joints as MuJoCo has them."""
    tree = reference.tree
    chains = find_chains(tree, {shape.link for shape in reference.shapes.shapes})
    hidden = {link for chain in chains for link in chain.between}
    fixed = {joint.name for joint in tree.joints if joint.kind not in MOVING}
    gone = {"body": hidden, "joint": fixed}
    for key in [key for key in facts if key.name in gone.get(key.kind, ())]:
        del facts[key]
    places: dict[str, dict[str, Value]] = {}
    for joint in tree.joints:
        places[joint.name] = {"body": joint.child, "parent": joint.parent}
    for chain in chains:
        facts[Key("body", chain.body, "parent")] = chain.parent
        facts[Key("body", chain.body, "pose")] = pose_value(chain.pose_in_parent)
        for joint, X in zip(chain.joints, chain.joint_poses, strict=True):
            places[joint.name] = {"body": chain.body, "parent": chain.parent}
            places[joint.name] |= {"anchor": tuple(X.xyz), "axis": axis_in_body(joint, X)}
    for joint in tree.joints:
        for name, values in _joints(joint, places[joint.name]):
            facts |= {Key("joint", name, quantity): value for quantity, value in values.items()}
    for body in tree.bodies:
        if body.inertial is None or body.is_massless:
            facts.pop(Key("body", body.name, "centre of mass"), None)
            facts.pop(Key("body", body.name, "inertia"), None)
    if tree.base == "floating":
        first = reference.control.initial_keyframe
        height = first.base.xyz[2] if first is not None and first.base is not None else 0.0
        facts[Key("body", tree.root, "pose")] = (0.0, 0.0, height, *IDENTITY.quat)
        facts.pop(Key("robot", "", "base pose"), None)


def _joints(joint: Joint, place: Mapping[str, Value]) -> Iterator[tuple[str, dict[str, Value]]]:
    """(name in MJCF, facts): a planar joint is two slides across its normal and a hinge."""
    if joint.kind in MOVING:
        yield joint.name, dict(place)
    elif joint.kind == "ball":
        yield joint.name, {q: v for q, v in place.items() if q != "axis"} | {"type": "ball"}
    elif joint.kind == "planar":
        turn = rotation_of(quat_between((0.0, 0.0, 1.0), joint.axis))
        for column, suffix in enumerate(("x", "y", "yaw")):
            axis = tuple(float(v) for v in turn[:, column])
            kind = "rotary" if suffix == "yaw" else "linear"
            yield f"{joint.name}_{suffix}", {**place, "axis": axis, "type": kind}


def _drive_names(reference: Reference) -> dict[str, str]:
    """Menagerie's: the joint's without `_joint` where that is unique, unless it has its own."""
    rows = [row for row in reference.control.actuators if row.model != "passive"]
    short = [row.name or row.joint.removesuffix("_joint") or row.joint for row in rows]
    return {row.joint: name if short.count(name) == 1 else row.joint
            for row, name in zip(rows, short, strict=True)}  # fmt: skip


def _shapes(reference: Reference, facts: dict[Key, Value]) -> None:
    """Only a PNG is shown; what touches nothing has no surface, and masks keep it apart."""
    contacts, tree = dict(reference.control.contacts), reference.tree
    pictures = {material.name: material.texture or "" for material in reference.shapes.materials}
    touching: set[str] = set()
    for shape in reference.shapes.shapes:
        surface = contacts.get(shape.name, reference.control.contact)
        if shape.role == "visual":
            facts |= {Key("shape", shape.name, q): 0.0 for q in ("contype", "conaffinity")}
            if not pictures.get(shape.material or "", "").lower().endswith(".png"):
                facts.pop(Key("shape", shape.name, "texture"), None)
        elif surface.contype or surface.conaffinity:
            touching.add(tree.placement(shape.link)[0])
        else:
            for quantity in ("friction", "condim", "priority", "solref", "solimp", "margin", "gap"):
                facts.pop(Key("shape", shape.name, quantity), None)
    for pair in filtered_pairs(tree, reference.shapes, reference.control):
        if not set(pair) <= touching:
            del facts[Key("pair", pair_name(*pair), "filtered")]


def _excluded(reference: Reference) -> Iterator[str]:
    """Pairs that MuJoCo does not pass by itself while the base floats, or once it is held."""
    tree, shapes, control = reference.tree, reference.shapes, reference.control
    rule = ContactFilter.of(tree, shapes, control)
    chains = find_chains(tree, {shape.link for shape in shapes.shapes})
    hidden = {link for chain in chains for link in chain.between}
    for a, b in control.excludes:
        if not {a, b} & hidden and not rule.holds_without(tree.root, a, b):
            yield pair_name(a, b)


def _senses(reference: Reference, drives: Mapping[str, str], facts: dict[Key, Value]) -> None:
    """Objects of sensors by MuJoCo's names; loops by sites, which are frames to every reader."""
    tree, control = reference.tree, reference.control
    for sensor in control.sensors:
        word, name = sensor.at.kind, sensor.at.name
        if word == "actuator":
            name = drives.get(name, name)
        if sensor.kind.startswith("subtree"):
            word = "body"
        facts[Key("sensor", sensor.name, "object")] = f"{word} {name}" if name else word
        if sensor.relative_to is not None and sensor.relative_to.kind == "world":
            facts[Key("sensor", sensor.name, "reference")] = ""
        if sensor.kind == "contact":
            facts[Key("sensor", sensor.name, "mjcf:intprm")] = STRONGEST
    sites = site_names(tree, control.loops)
    for loop in control.loops:
        for site, end in zip(sites[loop.name], loop.ends, strict=True):
            facts[Key("frame", site, "body")] = end.body
            facts[Key("frame", site, "pose")] = pose_value(end.X_body_end)


def _poses(reference: Reference, facts: dict[Key, Value]) -> None:
    """Commands of a keyframe; joints that only MuJoCo counts."""
    for key in reference.control.keyframes:
        for name, value in key.joints:
            row = reference.control.by_joint.get(name)
            if row is not None and row.model != "passive":
                aimed = value * row.gear if row.model == "pd" else 0.0
                facts[Key("keyframe", f"{key.name}/{name}", "target")] = aimed
        turns = dict(key.turns)
        for joint in reference.tree.joints:
            subject = f"{key.name}/{joint.name}"
            if joint.kind == "ball":
                turn = turns.get(joint.name, IDENTITY.quat)
                facts[Key("keyframe", subject, "mjcf:orientation")] = turn
            if joint.kind == "planar":
                for suffix in ("x", "y", "yaw"):
                    facts[Key("keyframe", f"{subject}_{suffix}", "position")] = 0.0


def _softness(reference: Reference, facts: dict[Key, Value]) -> None:
    """How soft limits and couplings are, where they differ from MuJoCo's own."""
    control = reference.control
    rows: list[tuple[str, str, Softness | Loop]] = []
    rows += [("joint", name, soft) for name, soft in control.soft_limits]
    rows += [("equality", name, soft) for name, soft in control.soft_couplings]
    rows += [("equality", loop.name, loop) for loop in control.loops]
    for kind, name, soft in rows:
        for word, value, usual in (
            ("solref", soft.solref, SOLREF),
            ("solimp", soft.solimp, SOLIMP),
        ):
            if tuple(value) != usual:
                facts[Key(kind, name, f"mjcf:{word}")] = tuple(value)


def _renamed(facts: Mapping[Key, Value], names: Mapping[str, str]) -> dict[Key, Value]:
    """With MuJoCo's name for a body called `world`."""
    if names.get("world", "world") == "world":
        return dict(facts)
    pattern, new = re.compile(r"(?<!\S)world(?!\S)"), names["world"]
    renamed: dict[Key, Value] = {}
    for key, value in facts.items():
        if key.kind in ("body", "frame", "pair"):
            key = key._replace(name=pattern.sub(new, key.name))
        of_body = key.quantity in ("body", "parent", "body a", "body b")
        if isinstance(value, str) and (of_body or (key.kind == "sensor" and " " in value)):
            value = pattern.sub(new, value)
        renamed[key] = value
    return renamed


def solver_facts(reference: Reference, section: str) -> dict[Key, Value]:
    """Solver options by the recipe's section."""
    options: Mapping[str, Any] = reference.options.get(section) or {}  # Any: plain JSON
    cone = options.get("cone") or "elliptic"
    quantities: dict[str, Value] = {
        "integrator": options.get("integrator", "implicitfast"),
        "cone": cone,
        "solver": options.get("solver", "Newton"),
        "iterations": float(options.get("iterations") or 100),
        "line search iterations": float(options.get("ls_iterations") or 50),
        "impratio": float(options.get("impratio") or (50.0 if cone == "elliptic" else 1.0)),
        "tolerance": float(options.get("tolerance", 1e-12)),
    }
    return {Key("simulation", "", name): value for name, value in quantities.items()}


# --- drives and limits ---------------------------------------------------------------------------


DEFAULT_PRM = (1.0, *(0.0,) * 9)


def drive_facts(joint: Joint, control: Control, names: Mapping[str, str]) -> dict[str, Value]:
    """Where they differ from the robot's own. names: of the drives, by joint."""
    lower, upper = joint.limits.lower, joint.limits.upper
    opens = lower is not None and upper is not None and lower < upper
    locked = lower is not None and lower == upper and joint.kind != "continuous"
    facts: dict[str, Value] = {}
    if not opens and not (locked and joint.mimic is None):
        facts |= {"lower": None, "upper": None}
    name = names.get(joint.name, joint.name)
    facts["drive name"] = name if name != joint.name else ""
    row = control.by_joint.get(joint.name)
    if row is None or row.model == "passive":
        return facts | {"effort": None, "drive name": ""}
    reach = (lower, upper) if opens and joint.kind != "continuous" and row.gear == 1.0 else None
    return facts | _law(row, reach)  # type: ignore[arg-type] # both stated


def _law(row: Actuator, reach: tuple[float, float] | None) -> dict[str, Value]:
    """Range of the command of one drive, and its gains where its law runs outside of MuJoCo."""
    ends = sorted(end * row.command_gear for end in row.ctrl) if row.ctrl else None
    ctrl = (ends[0], ends[1]) if ends else None
    match row.model:
        case "pd":
            return {"command range": ctrl or reach}
        case "velocity":
            speed = (-row.velocity, row.velocity) if row.velocity else None
            return {"command range": ctrl or speed, "kp": 0.0}
        case "general" if row.general is not None:
            return {"command range": ctrl} | _general(row, row.general, ctrl)
    limit = row.effort / abs(row.gear) if row.effort else None
    ctrl = ctrl or ((-limit, limit) if limit else None)
    asked = max(-ctrl[0], ctrl[1]) * abs(row.gear) if ctrl else row.effort
    effort = min(asked, row.effort or asked) if asked else None
    return {"model": "motor", "command range": ctrl, "effort": effort, "kp": 0.0, "kd": 0.0}


def _general(row: Actuator, general: General, ctrl: tuple[float, float] | None) -> dict[str, Value]:
    """A general actuator may say what a plainer one says too.

    ctrl: the range of the command, which limits a force that is the command times a gain.
    """
    prm = [(*stated, *usual[len(stated) :]) for stated, usual in (
        (general.dynprm, DEFAULT_PRM),
        (general.gainprm, DEFAULT_PRM),
        (general.biasprm, (0.0,) * 10),
    )]  # fmt: skip
    numbers = [tuple(map(float, values)) for values in prm]
    kind, gain, bias = "general", numbers[1][0], list(numbers[2][:3])
    if general.dyntype == "none" and general.gaintype == "fixed":
        if general.biastype == "none" or not any(bias):
            kind = "motor"
        elif general.biastype == "affine" and gain > 0.0 and bias[:2] == [0.0, -gain]:
            kind = "pd"
        elif general.biastype == "affine" and gain > 0.0 and bias == [0.0, 0.0, -gain]:
            kind = "velocity"
    square = row.gear * row.gear
    law = json.dumps([general.dyntype, general.gaintype, general.biastype, *numbers])
    plain = kind in ("pd", "velocity") or (kind == "motor" and gain == 1.0)
    facts: dict[str, Value] = {}
    filtered = general.dyntype in ("none", "filter", "filterexact")
    if ctrl and filtered and general.gaintype == "fixed" and general.biastype == "none":
        low, high = sorted(row.gear * gain * end for end in ctrl)
        most = math.inf if row.effort is None else row.effort
        reached = max(low, -most), min(high, most)
        facts["effort"] = max(-reached[0], reached[1])
        facts["mjcf:effort range"] = reached if reached[0] != -reached[1] else None
    return facts | {
        "model": kind,
        "kp": gain * square if kind == "pd" else 0.0,
        "kd": -bias[2] * square if kind in ("pd", "velocity") else 0.0,
        "drive parameters": "" if plain else law,
    }
