"""What an MJCF of the robot must say: the robot's facts in MuJoCo's structure.

Massless links between joints are no bodies there, fixed joints no joints, a planar joint is three,
and a torque motor stands for every drive whose law acts outside of the simulator.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import Any

from assetbuild.facts.derived import SOLIMP, SOLREF
from assetbuild.facts.reference import Reference, pose_value, robot_table, surface_facts
from assetbuild.facts.table import Table, Value, pair_name, pair_of
from assetbuild.robot.chains import Chain, axis_in_body, is_massless, joint_rows
from assetbuild.robot.contact_filter import ContactFilter
from assetbuild.robot.loops import site_names
from assetbuild.robot.model import MOVING, Actuator, Control, General, Joint, Loop, Softness
from assetbuild.robot.pose import IDENTITY, Pose, quat_between, rotation_of
from assetbuild.simulators.mujoco import body_names

STRONGEST = (3.0, 2.0, 1.0)
"""Parameters of a contact sensor: it reports `found` and `force` of the strongest contact."""


def mjcf_table(reference: Reference) -> Table:
    """Facts of an MJCF."""
    reference = replace(reference, control=reference.control.in_mjcf)
    table, drives = robot_table(reference), _drive_names(reference.control)
    rows = joint_rows(reference.tree, {shape.link for shape in reference.shapes.shapes})
    hidden = {link for row in rows.values() for link in row.between}
    _structure(reference, rows, hidden, table)
    for joint in reference.tree.moving_joints:
        table.put("joint", joint.name, drive_facts(joint, reference.control, drives))
    _shapes(reference, table)
    _senses(reference, drives, table)
    _excluded(reference, hidden, table)
    _poses(reference, table)
    _softness(reference.control, table)
    return _renamed(table, body_names(reference.tree)["world"] if table.of("body", "world") else "")


def _structure(
    reference: Reference, rows: Mapping[str, Chain], hidden: Collection[str], table: Table
) -> None:
    """Bodies and joints as MuJoCo has them. rows: the joints that move each body."""
    tree = reference.tree
    gone = {("body", link) for link in hidden}
    gone |= {("joint", joint.name) for joint in tree.joints if joint.kind not in MOVING}
    for key in [key for key in table.facts if key[:2] in gone]:
        del table.facts[key]
    for body, row in rows.items():
        if body in hidden:
            continue
        table.put("body", body, {"parent": row.parent, "pose": pose_value(row.pose_in_parent)})
        for joint, X in zip(row.joints, row.joint_poses, strict=True):
            for name, facts in _joints(joint, X, {"body": body, "parent": row.parent}):
                table.put("joint", name, facts)
    for link in tree.bodies:
        if is_massless(link):
            table.drop("body", link.name, "centre of mass", "inertia")
    if tree.base == "floating":
        first = reference.control.initial_keyframe
        height = first.base.xyz[2] if first is not None and first.base is not None else 0.0
        table.put("body", tree.root, {"pose": (0.0, 0.0, height, *IDENTITY.quat)})
        table.drop("robot", "", "base pose")


def _joints(
    joint: Joint, X: Pose, ends: dict[str, Value]
) -> Iterator[tuple[str, dict[str, Value]]]:
    """(name in MJCF, facts): a planar joint is two slides across its normal and a hinge.

    X: of the joint's frame in the body that it moves.
    """
    facts: dict[str, Value] = ends | {"anchor": tuple(X.xyz)}
    if joint.kind in MOVING:
        yield joint.name, facts | {"axis": axis_in_body(joint, X)}
    elif joint.kind == "ball":
        yield joint.name, facts | {"type": "ball"}
    elif joint.kind == "planar":
        turn = rotation_of(quat_between((0.0, 0.0, 1.0), joint.axis))
        for column, suffix in enumerate(("x", "y", "yaw")):
            axis = tuple(float(v) for v in turn[:, column])
            kind = "rotary" if suffix == "yaw" else "linear"
            yield f"{joint.name}_{suffix}", {**facts, "axis": axis, "type": kind}


def _drive_names(control: Control) -> dict[str, str]:
    """Menagerie's: the joint's without `_joint` where that is unique, unless it has its own."""
    rows = [row for row in control.actuators if row.model != "passive"]
    short = [row.name or row.joint.removesuffix("_joint") or row.joint for row in rows]
    return {row.joint: name if short.count(name) == 1 else row.joint
            for row, name in zip(rows, short, strict=True)}  # fmt: skip


def _shapes(reference: Reference, table: Table) -> None:
    """Only a PNG is shown; what touches nothing has no surface, and masks keep it apart."""
    contacts, tree = dict(reference.control.contacts), reference.tree
    pictures = {material.name: material.texture or "" for material in reference.shapes.materials}
    touching: set[str] = set()
    for shape in reference.shapes.shapes:
        surface = contacts.get(shape.name, reference.control.contact)
        if shape.role == "visual":
            table.put("shape", shape.name, {"contype": 0.0, "conaffinity": 0.0})
            if not pictures.get(shape.material or "", "").lower().endswith(".png"):
                table.drop("shape", shape.name, "texture")
        elif surface.contype or surface.conaffinity:
            touching.add(tree.placement(shape.link)[0])
        else:
            table.drop(
                "shape", shape.name, *surface_facts(surface).keys() - {"contype", "conaffinity"}
            )
    for pair in table.names("pair"):
        if not {*pair_of(pair)} <= touching:
            table.drop("pair", pair, "filtered")


def _excluded(reference: Reference, hidden: Collection[str], table: Table) -> None:
    """Pairs that MuJoCo does not pass by itself while the base floats, or once it is held."""
    tree, control = reference.tree, reference.control
    rule = ContactFilter.of(tree, reference.shapes, control)
    for a, b in control.excludes:
        if not {a, b} & {*hidden} and not rule.holds_without(tree.root, a, b):
            table.put("pair", pair_name(a, b), {"mjcf:excluded": True})


def _senses(reference: Reference, drives: Mapping[str, str], table: Table) -> None:
    """Objects of sensors by MuJoCo's names; loops by sites, which are frames to every reader."""
    tree, control = reference.tree, reference.control
    for sensor in control.sensors:
        word, name = sensor.at.kind, sensor.at.name
        if word == "actuator":
            name = drives.get(name, name)
        if sensor.kind.startswith("subtree"):
            word = "body"
        table.put("sensor", sensor.name, {"object": f"{word} {name}" if name else word})
        if sensor.relative_to is not None and sensor.relative_to.kind == "world":
            table.put("sensor", sensor.name, {"reference": ""})
        if sensor.kind == "contact":
            table.put("sensor", sensor.name, {"mjcf:intprm": STRONGEST})
    sites = site_names(tree, control.loops)
    for loop in control.loops:
        for site, end in zip(sites[loop.name], loop.ends, strict=True):
            table.put("frame", site, {"body": end.body, "pose": pose_value(end.X_body_end)})


def _poses(reference: Reference, table: Table) -> None:
    """Commands of a keyframe; joints that only MuJoCo counts."""
    for key in reference.control.keyframes:
        for name, value in key.joints:
            row = reference.control.by_joint.get(name)
            if row is not None and row.model != "passive":
                aimed = value * row.gear if row.model == "pd" else 0.0
                table.put("keyframe", f"{key.name}/{name}", {"target": aimed})
        turns = dict(key.turns)
        for joint in reference.tree.joints:
            subject = f"{key.name}/{joint.name}"
            if joint.kind == "ball":
                turn = turns.get(joint.name, IDENTITY.quat)
                table.put("keyframe", subject, {"mjcf:orientation": turn})
            for suffix in ("x", "y", "yaw") if joint.kind == "planar" else ():
                table.put("keyframe", f"{subject}_{suffix}", {"position": 0.0})


def _softness(control: Control, table: Table) -> None:
    """How soft limits and couplings are, where they differ from MuJoCo's own."""
    rows: list[tuple[str, str, Softness | Loop]] = []
    rows += [("joint", name, soft) for name, soft in control.soft_limits]
    rows += [("equality", name, soft) for name, soft in control.soft_couplings]
    rows += [("equality", loop.name, loop) for loop in control.loops]
    for kind, name, soft in rows:
        if tuple(soft.solref) != SOLREF:
            table.put(kind, name, {"mjcf:solref": tuple(soft.solref)})
        if tuple(soft.solimp) != SOLIMP:
            table.put(kind, name, {"mjcf:solimp": tuple(soft.solimp)})


def _renamed(table: Table, world: str) -> Table:
    """Replace the name of a body called `world` by MuJoCo's; "" = the robot has no such body."""
    if not world:
        return table
    pattern, renamed = re.compile(r"(?<!\S)world(?!\S)"), Table()
    for key, value in table.facts.items():
        if key.kind in ("body", "frame", "pair"):
            key = key._replace(name=pattern.sub(world, key.name))
        of_body = key.quantity in ("body", "parent", "body a", "body b")
        if isinstance(value, str) and (of_body or (key.kind == "sensor" and " " in value)):
            value = pattern.sub(world, value)
        renamed.facts[key] = value
    return renamed


def solver_facts(reference: Reference, section: str) -> dict[str, Value]:
    """Solver options by the recipe's section."""
    options: Mapping[str, Any] = reference.options.get(section) or {}  # Any: plain JSON
    cone = options.get("cone") or "elliptic"
    return {
        "integrator": options.get("integrator", "implicitfast"),
        "cone": cone,
        "solver": options.get("solver", "Newton"),
        "iterations": float(options.get("iterations") or 100),
        "line search iterations": float(options.get("ls_iterations") or 50),
        "impratio": float(options.get("impratio") or (50.0 if cone == "elliptic" else 1.0)),
        "tolerance": float(options.get("tolerance", 1e-12)),
    }


# --- drives and limits ---------------------------------------------------------------------------


DEFAULT_PRM = (1.0, *(0.0,) * 9)


def drive_facts(joint: Joint, control: Control, names: Mapping[str, str]) -> dict[str, Value]:
    """Facts of drives that differ from the robot's own. names: of the drives, by joint."""
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
