"""A compiled MuJoCo model as facts: what will be simulated, whatever the file looks like."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Collection, Iterator

import numpy as np

from assetbuild.facts.compare import EXACT, Precision
from assetbuild.facts.mjcf_fields import Bodies, body_name, fields, numbers, plain
from assetbuild.facts.mjcf_parts import (
    BALL,
    JOINTS,
    Meshes,
    pose_of,
    read_keyframe,
    read_senses,
    simulation_facts,
)
from assetbuild.facts.table import Table, Value, pair_name
from assetbuild.robot.inertia import tensor_of
from assetbuild.simulators.mujoco import Model, floats, inertia_of, mj, name_of, turning
from assetbuild.simulators.mujoco.drives import Drive, read_drives
from assetbuild.simulators.mujoco.linear_couplings import tendon_coupling
from assetbuild.simulators.mujoco.pairs import touching_geoms

LOOPS = {0: "connect", 1: "weld"}
"""Kinds of loops by MuJoCo's number of the equality's type."""
SURFACE = ("friction", "condim", "priority", "solref", "solimp", "margin", "gap")
"""Quantities of a surface that may touch something, which MuJoCo calls the same."""
GROUPS = {2: "visual", 3: "collision"}
"""Menagerie's groups of geoms."""
MESHES = Precision(
    {**EXACT, "length": 1e-6}, {("shape", "texture corners"): 1e-6, ("shape", "rgba"): 1e-6}
)
"""MuJoCo keeps vertices, texture coordinates and colours as float32."""


def compiled_facts(
    model: Model,
    opaque: Collection[tuple[str, str]] = frozenset(),
    bodies: Bodies | None = None,
    meshes: Meshes | None = None,
) -> Table:
    """A compiled model as facts; the world's own geoms are left out.

    opaque: (kind, name) of what no other format can say; bodies: in whose frames.
    """
    table, elements = read_model(model, opaque, bodies, meshes)
    return Table({**table.facts, **fields(model, elements)})


def read_model(
    model: Model,
    opaque: Collection[tuple[str, str]] = frozenset(),
    bodies: Bodies | None = None,
    meshes: Meshes | None = None,
) -> tuple[Table, frozenset[tuple[str, str]]]:
    """What the vocabulary has of a compiled model, and the equalities and actuators in it."""
    table, meshes = Table(), meshes or Meshes(model)
    bodies = bodies or Bodies(model)
    moving = [*turning(model), *np.flatnonzero(model.jnt_type == BALL).tolist()]
    table.put("robot", "", {"base": "floating" if floats(model) else "fixed"})
    if not floats(model) and model.nbody > 1:
        pose = pose_of(model.body_pos[1], model.body_quat[1])
        table.put("robot", "", {"base pose": (*pose.xyz, *pose.quat)})
    for body in range(1, model.nbody):
        table.put("body", name_of(model, "body", body), _body(model, body))
    for joint in moving:
        table.put("joint", name_of(model, "joint", joint), _joint(model, joint, bodies))
    if floats(model):
        table.put("joint", name_of(model, "joint", 0), _free_joint(model))
    drives = {
        drive.joint_name: drive
        for drive in reversed(read_drives(model))  # the first of several on a joint is its drive
        if ("actuator", name_of(model, "actuator", drive.index)) not in opaque
    }
    elements = {("actuator", name_of(model, "actuator", drive.index)) for drive in drives.values()}
    for drive in drives.values():
        _drive(model, drive, table)
    followers: set[str] = set()
    for equality in range(model.neq):
        subject = ("equality", name_of(model, "equality", equality))
        if subject not in opaque and _equality(bodies, equality, followers, table):
            elements.add(subject)
    for site in range(model.nsite):
        _site(bodies, site, table)
    for geom in range(model.ngeom):
        if int(model.geom_bodyid[geom]):
            table.put("shape", shape_name(model, geom), _geom(bodies, geom, meshes))
    for pair in _filtered(model, opaque):
        table.put("pair", pair_name(*pair), {"filtered": True})
    for signature in model.exclude_signature:  # also where it changes nothing unless a base is held
        ends = (body_name(model, int(signature) >> 16), body_name(model, int(signature) & 0xFFFF))
        table.put("pair", pair_name(*ends), {"mjcf:excluded": True})
    read_senses(bodies, table)
    for key in range(model.nkey):
        read_keyframe(model, key, moving, drives.values(), table)
    table.put("simulation", "", simulation_facts(model.opt))
    return table, frozenset(elements)


def shape_name(model: Model, geom: int) -> str:
    """Its name; else its place in its body, which a geom of another body leaves alone."""
    body = int(model.geom_bodyid[geom])
    place = f"geom {geom - int(model.body_geomadr[body])} of {body_name(model, body)}"
    return str(model.geom(geom).name) or place


# --- bodies and joints ----------------------------------------------------------------------


def _body(model: Model, body: int) -> dict[str, Value]:
    parent = int(model.body_parentid[body])
    facts: dict[str, Value] = {
        "parent": body_name(model, parent),
        "mass": float(model.body_mass[body]),
    }
    if parent or floats(model):
        pose = pose_of(model.body_pos[body], model.body_quat[body])
        facts["pose"] = (*pose.xyz, *pose.quat)
    if facts["mass"] or model.body_inertia[body].any():
        facts["centre of mass"] = numbers(model.body_ipos[body])
        facts["inertia"] = tensor_of(inertia_of(model, body))
    return facts


def _joint(model: Model, joint: int, bodies: Bodies) -> dict[str, Value]:
    body, dof = int(model.jnt_bodyid[joint]), int(model.jnt_dofadr[joint])
    limited = bool(model.jnt_limited[joint])
    facts: dict[str, Value] = {
        "type": JOINTS[int(model.jnt_type[joint])],
        "body": bodies.name(body),
        "parent": bodies.name(int(model.body_parentid[body])),
        "anchor": numbers(bodies.placed(body).apply(model.jnt_pos[joint])),
        "axis": numbers(bodies.placed(body).rotation @ model.jnt_axis[joint]),
        "lower": float(model.jnt_range[joint, 0]) if limited else None,
        "upper": float(model.jnt_range[joint, 1]) if limited else None,
        "damping": float(np.ravel(model.dof_damping[dof])[0]),
        "friction": float(model.dof_frictionloss[dof]),
        "armature": float(model.dof_armature[dof]),
        "stiffness": float(np.ravel(model.jnt_stiffness[joint])[0]),
        "model": "passive",
    }
    rest = float(model.qpos_spring[int(model.jnt_qposadr[joint])])
    if int(model.jnt_type[joint]) == BALL:
        del facts["axis"]
    elif facts["stiffness"]:
        facts["spring reference"] = rest
    if model.jnt_actfrclimited[joint]:
        facts["mjcf:actuatorfrcrange"] = numbers(model.jnt_actfrcrange[joint])
    return facts


def _free_joint(model: Model) -> dict[str, Value]:
    """What a free joint has that it need not have."""
    facts = {"damping": model.dof_damping, "armature": model.dof_armature,
             "friction": model.dof_frictionloss, "stiffness": model.jnt_stiffness}  # fmt: skip
    first = {f"mjcf:{word}": float(np.ravel(values[0])[0]) for word, values in facts.items()}
    return {word: value for word, value in first.items() if value}


def _drive(model: Model, drive: Drive, table: Table) -> None:
    name = name_of(model, "actuator", drive.index)
    kind = "general" if drive.filtered else drive.kind
    plain, most = kind != "general", max(-drive.on_joint[0], drive.on_joint[1])
    facts: dict[str, Value] = {
        "model": {"servo": "pd"}.get(kind, kind),
        "kp": drive.kp if plain else 0.0,
        "kd": drive.kd if plain else 0.0,
        "gear": drive.gear,
        "effort": most if math.isfinite(drive.on_joint[1]) else None,
        "command range": drive.ctrl if math.isfinite(drive.ctrl[1]) else None,
    }
    if name != drive.joint_name:
        facts["drive name"] = name
    if not plain or (kind == "motor" and drive.gain != drive.gear):
        facts["drive parameters"] = general_text(model, drive.index)
    hidden = drive.on_joint != drive.torque and model.actuator_forcelimited[drive.index]
    low, high = drive.torque
    ends = (low, high) if hidden else (max(low, -most), min(high, most))
    if ends[0] != -ends[1] or hidden:
        facts["mjcf:effort range"] = ends
    table.put("joint", drive.joint_name, facts)


def general_text(model: Model, index: int) -> str:
    """The parameters of a general actuator, as JSON."""
    kinds = [
        mj.mjtDyn(int(model.actuator_dyntype[index])).name,
        mj.mjtGain(int(model.actuator_gaintype[index])).name,
        mj.mjtBias(int(model.actuator_biastype[index])).name,
    ]
    rows = (model.actuator_dynprm, model.actuator_gainprm, model.actuator_biasprm)
    return json.dumps(
        [*(k.split("_")[1].lower() for k in kinds), *(numbers(r[index] + 0.0) for r in rows)]
    )


def _equality(bodies: Bodies, index: int, followers: set[str], table: Table) -> bool:
    """A mimic joint, one that is locked, or a loop; False of every other kind, a word of MJCF.

    followers: joints that an equality before this one leads or locks.
    """
    model = bodies.model
    kind = int(model.eq_type[index])
    if kind in LOOPS and model.eq_active0[index]:
        table.put("loop", name_of(model, "equality", index), _loop(bodies, index))
        return True
    follower, leader = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
    data = numbers(model.eq_data[index])
    if kind == 3 and (coupling := tendon_coupling(model, index)):  # mjEQ_TENDON
        follower, leader, multiplier, offset = coupling
        data = (offset, multiplier, 0.0, 0.0, 0.0)
    elif kind != 2:  # mjEQ_JOINT
        return False
    name = name_of(model, "joint", follower)
    if name in followers:
        return False  # a second one acts beside the first
    followers.add(name)
    facts: dict[str, Value] = {"lower": data[0], "upper": data[0]}
    if leader >= 0:
        facts = {
            "mimics": name_of(model, "joint", leader),
            "mimic offset": data[0],
            "mimic multiplier": data[1],
        }
    if any(data[2:5]) or (leader < 0 and data[1]):
        facts["mjcf:polycoef"] = data[:5]
    if not model.eq_active0[index]:
        facts["mjcf:active"] = False
    table.put("joint", name, facts)
    return True


def _loop(bodies: Bodies, index: int) -> dict[str, Value]:
    """Ends at two sites, or in two bodies with an anchor in each, and of a weld their turn."""
    model = bodies.model
    kind = LOOPS[int(model.eq_type[index])]
    data = tuple(float(v) for v in model.eq_data[index])
    by_site = int(model.eq_objtype[index]) == 6  # mjOBJ_SITE
    facts: dict[str, Value] = {"type": kind}
    anchors = (data[3:6], data[:3]) if kind == "weld" else (data[:3], data[3:6])
    turns = (data[6:10] if kind == "weld" else (1.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    for side, which, anchor, turn in zip("ab", (1, 2), anchors, turns, strict=True):
        body = int(getattr(model, f"eq_obj{which}id")[index])
        if by_site:
            pose = pose_of(model.site_pos[body], model.site_quat[body])
            body = int(model.site_bodyid[body])
        else:
            pose = pose_of(anchor, turn)
        pose = bodies.placed(body) @ pose
        turned = pose.quat if kind == "weld" else (1.0, 0.0, 0.0, 0.0)
        facts |= {f"body {side}": bodies.name(body), f"end {side}": (*pose.xyz, *turned)}
    return facts | ({"torque scale": data[10]} if kind == "weld" else {})


def _site(bodies: Bodies, site: int, table: Table) -> None:
    """One that is the frame of its body is no other."""
    model, body = bodies.model, int(bodies.model.site_bodyid[site])
    name, place = name_of(model, "site", site), pose_of(model.site_pos[site], model.site_quat[site])
    if not bodies.is_own_frame(body, name, place):
        pose = bodies.placed(body) @ place
        facts: dict[str, Value] = {"body": bodies.name(body), "pose": (*pose.xyz, *pose.quat)}
        table.put("frame", name, facts)


# --- shapes ---------------------------------------------------------------------------------


def _geom(bodies: Bodies, geom: int, meshes: Meshes) -> dict[str, Value]:
    model, body = bodies.model, int(bodies.model.geom_bodyid[geom])
    group = int(model.geom_group[geom])
    kind = mj.mjtGeom(int(model.geom_type[geom])).name.removeprefix("mjGEOM_").lower()
    role = GROUPS.get(group, f"group {group}")
    pose = bodies.placed(body) @ pose_of(model.geom_pos[geom], model.geom_quat[geom])
    facts: dict[str, Value] = {
        "role": role,
        "body": bodies.name(body),
        "geometry": kind,
        "contype": float(model.geom_contype[geom]),
        "conaffinity": float(model.geom_conaffinity[geom]),
    }
    if kind == "mesh":
        facts |= meshes.of(int(model.geom_dataid[geom])).moved(pose).facts()
    else:
        facts |= {"size": _size(kind, model.geom_size[geom]), "pose": (*pose.xyz, *pose.quat)}
    if facts["contype"] or facts["conaffinity"]:
        facts |= {word: plain(getattr(model, f"geom_{word}")[geom]) for word in SURFACE}
    material = int(model.geom_matid[geom])
    rgba = numbers(np.float32(model.geom_rgba[geom]))
    has_rgba = rgba != (0.5, 0.5, 0.5, 1.0)  # MuJoCo draws it rather than the material's
    if material >= 0 or has_rgba:
        facts["rgba"] = rgba if has_rgba else numbers(model.mat_rgba[material])
    if material >= 0:
        textures = [int(t) for t in np.ravel(model.mat_texid[material]) if int(t) >= 0]
        facts |= {"texture": meshes.pixels(textures[0])} if textures else {}
    return facts


def _size(kind: str, half: object) -> tuple[float, ...]:
    """The size as the vocabulary has it; MuJoCo counts half edges and half lengths."""
    a, b, c = numbers(half)
    match kind:
        case "box":
            return (2.0 * a, 2.0 * b, 2.0 * c)
        case "sphere":
            return (a,)
        case "cylinder" | "capsule":
            return (a, 2.0 * b)
    return (a, b, c)


def _filtered(model: Model, opaque: Collection[tuple[str, str]]) -> Iterator[tuple[str, str]]:
    """Pairs of bodies (sorted names) that both have collision geoms and never meet."""
    solid = np.flatnonzero((model.geom_contype != 0) | (model.geom_conaffinity != 0)).tolist()
    body_of = {geom: int(model.geom_bodyid[geom]) for geom in solid
               if ("shape", shape_name(model, geom)) not in opaque}  # fmt: skip
    met = {(body_of[a], body_of[b]) for a, b in touching_geoms(model) if {a, b} <= body_of.keys()}
    for a, b in itertools.combinations(sorted({*body_of.values()} - {0}), 2):
        if not {(a, b), (b, a)} & met:
            first, second = sorted((body_name(model, a), body_name(model, b)))
            yield first, second
