"""A compiled MuJoCo model as facts: what will be simulated, whatever the file looks like."""

from __future__ import annotations

import itertools
import json
import math
from collections import Counter
from collections.abc import Collection, Iterator
from typing import Any

import numpy as np

from assetbuild.facts.mjcf_loops import LOOPS, loop_facts
from assetbuild.facts.mjcf_meshes import Meshes, pose_of
from assetbuild.facts.table import Value, Writer, pair_name
from assetbuild.simulators.mujoco import Model, inertia_of, name_of, passes
from assetbuild.simulators.mujoco.drives import Drive, read_drives
from assetbuild.simulators.mujoco.levers import tendon_coupling

BALL = 1
JOINTS = {0: "floating", BALL: "ball", 2: "linear", 3: "rotary"}
GROUPS = {2: "visual", 3: "collision"}
"""Menagerie's groups of geoms."""
OBJECTS = {
    "mjOBJ_XBODY": "frame", "mjOBJ_SITE": "frame", "mjOBJ_BODY": "body", "mjOBJ_GEOM": "shape",
    "mjOBJ_JOINT": "joint", "mjOBJ_ACTUATOR": "actuator", "mjOBJ_CAMERA": "camera",
    "mjOBJ_TENDON": "tendon",
}  # fmt: skip
"""MuJoCo's kind of object -> the vocabulary's; an XBODY is the frame of a body."""


def read_model(
    model: Model,
    book: Writer,
    opaque: Collection[tuple[str, str]] = frozenset(),
    meshes: Meshes | None = None,
) -> frozenset[tuple[str, str]]:
    """Puts every fact of a compiled model into the book; the world's own geoms are left out.

    opaque: (kind, name) of what no other format can say: it has words of MJCF alone. Returns the
    subjects that the book now tells whole.
    """
    moving = [joint for joint in range(model.njnt) if int(model.jnt_type[joint]) in (2, 3)]
    balls = [joint for joint in range(model.njnt) if int(model.jnt_type[joint]) == BALL]
    _root(model, book)
    for body in range(1, model.nbody):
        book.put("body", _name(model, "body", body), _body(model, body))
    for joint in (*moving, *balls):
        book.put("joint", _name(model, "joint", joint), _joint(model, joint))
    drives = [
        drive
        for drive in read_drives(model)
        if ("actuator", _name(model, "actuator", drive.index)) not in opaque
    ]
    told = {("actuator", _name(model, "actuator", drive.index)) for drive in drives}
    for drive in drives:
        _drive(model, drive, book)
    followers: set[str] = set()
    for equality in range(model.neq):
        subject = ("equality", str(model.eq(equality).name))
        if subject not in opaque and _equality(model, equality, followers, book):
            told.add(subject)
    for site in range(model.nsite):
        _site(model, site, book)
    meshes = meshes or Meshes(model)
    for geom in range(model.ngeom):
        if int(model.geom_bodyid[geom]):
            book.put("shape", _name(model, "geom", geom), _geom(model, geom, meshes))
    for pair in _filtered(model, opaque):
        book.put("pair", pair_name(*pair), {"filtered": True})
    for (a, b), count in _excluded(model).items():
        if count > 1 or passes(model, a, b):  # one of them changes nothing, unless a base is pinned
            name = pair_name(_body_name(model, a), _body_name(model, b))
            book.put("pair", name, {"mjcf:excludes": float(count)})
    _senses(model, book)
    for key in range(model.nkey):
        _keyframe(model, key, moving, drives, book)
    book.put("simulation", "", simulation_facts(model.opt))
    told |= {("keyframe", _name(model, "key", key)) for key in range(model.nkey)}
    return frozenset(told) | {(key.kind, key.name) for key in book.facts}


def _name(model: Model, kind: str, index: int) -> str:
    return name_of(model, kind, index)


def _body_name(model: Model, index: int) -> str:
    return _name(model, "body", index) if index else ""


def _numbers(values: object) -> tuple[float, ...]:
    return tuple(float(v) for v in np.ravel(np.asarray(values, dtype=np.float64)))


# --- bodies and joints ----------------------------------------------------------------------


def _root(model: Model, book: Writer) -> None:
    floating = bool(model.njnt) and int(model.jnt_type[0]) == 0
    facts: dict[str, Value] = {"base": "floating" if floating else "fixed"}
    if not floating and model.nbody > 1:
        pose = pose_of(model.body_pos[1], model.body_quat[1])
        facts["base pose"] = (*pose.xyz, *pose.quat)
    book.put("robot", "", facts)


def _body(model: Model, body: int) -> dict[str, Value]:
    parent = int(model.body_parentid[body])
    facts: dict[str, Value] = {
        "parent": _body_name(model, parent),
        "mass": float(model.body_mass[body]),
    }
    floating = model.njnt and int(model.jnt_type[0]) == 0
    if parent or floating:
        pose = pose_of(model.body_pos[body], model.body_quat[body])
        facts["pose"] = (*pose.xyz, *pose.quat)
    if facts["mass"] or model.body_inertia[body].any():
        tensor = inertia_of(model, body)
        facts["centre of mass"] = _numbers(model.body_ipos[body])
        facts["inertia"] = tuple(
            float(tensor[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
        )
    return facts


def _joint(model: Model, joint: int) -> dict[str, Value]:
    body, dof = int(model.jnt_bodyid[joint]), int(model.jnt_dofadr[joint])
    limited = bool(model.jnt_limited[joint])
    facts: dict[str, Value] = {
        "type": JOINTS[int(model.jnt_type[joint])],
        "body": _body_name(model, body),
        "parent": _body_name(model, int(model.body_parentid[body])),
        "anchor": _numbers(model.jnt_pos[joint]),
        "axis": _numbers(model.jnt_axis[joint]),
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
        facts["mjcf:actuatorfrcrange"] = _numbers(model.jnt_actfrcrange[joint])
    return facts


def _drive(model: Model, drive: Drive, book: Writer) -> None:
    name = _name(model, "actuator", drive.index)
    kind = "general" if drive.filtered else drive.kind
    plain = kind != "general"
    facts: dict[str, Value] = {
        "model": {"servo": "pd"}.get(kind, kind),
        "kp": drive.kp if plain else 0.0,
        "kd": drive.kd if plain else 0.0,
        "gear": drive.gear,
        "effort": _largest(drive.on_joint),
        "command range": drive.ctrl if math.isfinite(drive.ctrl[1]) else None,
    }
    if name != drive.joint_name:
        facts["drive name"] = name
    if not plain or (kind == "motor" and drive.gain != drive.gear):
        facts["drive parameters"] = general_text(model, drive.index)
    hidden = drive.on_joint != drive.torque and model.actuator_forcelimited[drive.index]
    ends = drive.torque if hidden else drive.within_effort
    if ends[0] != -ends[1] or hidden:
        facts["mjcf:effort range"] = ends
    known = book.facts.get(("joint", drive.joint_name, "gear"))  # type: ignore[call-overload] # a plain tuple
    if known is not None:
        book.put("actuator", name, {"mjcf:drives": drive.joint_name, **_as_words(facts)})
        return
    book.put("joint", drive.joint_name, facts)


def _as_words(facts: dict[str, Value]) -> dict[str, Value]:
    """Return the words of a second drive on one joint, which no other format has."""
    return {f"mjcf:{name.removeprefix('mjcf:')}": value for name, value in facts.items()}


def _largest(ends: tuple[float, float]) -> float | None:
    return max(-ends[0], ends[1]) if math.isfinite(ends[1]) else None


def general_text(model: Model, index: int) -> str:
    """The parameters of a general actuator, as JSON."""
    import mujoco

    kinds = [
        mujoco.mjtDyn(int(model.actuator_dyntype[index])).name,
        mujoco.mjtGain(int(model.actuator_gaintype[index])).name,
        mujoco.mjtBias(int(model.actuator_biastype[index])).name,
    ]
    rows = (model.actuator_dynprm, model.actuator_gainprm, model.actuator_biasprm)
    return json.dumps(
        [*(k.split("_")[1].lower() for k in kinds), *(_numbers(r[index]) for r in rows)]
    )


def _equality(model: Model, index: int, followers: set[str], book: Writer) -> bool:
    """A mimic joint, one that is locked, or a loop; False of every other kind, a word of MJCF.

    followers: joints that an equality before this one leads or locks.
    """
    kind = int(model.eq_type[index])
    if kind in LOOPS and model.eq_active0[index]:
        book.put("loop", str(model.eq(index).name), loop_facts(model, index))
        return True
    follower, leader = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
    data = _numbers(model.eq_data[index])
    if kind == 3 and (coupling := tendon_coupling(model, index)):  # mjEQ_TENDON
        follower, leader, multiplier, offset = coupling
        data = (offset, multiplier, 0.0, 0.0, 0.0)
    elif kind != 2:  # mjEQ_JOINT
        return False
    name = _name(model, "joint", follower)
    if name in followers:
        return False  # a second one acts beside the first
    followers.add(name)
    facts: dict[str, Value] = {"lower": data[0], "upper": data[0]}
    if leader >= 0:
        facts = {
            "mimics": _name(model, "joint", leader),
            "mimic offset": data[0],
            "mimic multiplier": data[1],
        }
    if any(data[2:5]) or (leader < 0 and data[1]):
        facts["mjcf:polycoef"] = data[:5]
    if not model.eq_active0[index]:
        facts["mjcf:active"] = False
    book.put("joint", name, facts)
    return True


def _site(model: Model, site: int, book: Writer) -> None:
    pose = pose_of(model.site_pos[site], model.site_quat[site])
    body = _body_name(model, int(model.site_bodyid[site]))
    book.put("frame", _name(model, "site", site), {"body": body, "pose": (*pose.xyz, *pose.quat)})


# --- shapes ---------------------------------------------------------------------------------


def _geom(model: Model, geom: int, meshes: Meshes) -> dict[str, Value]:
    import mujoco

    group = int(model.geom_group[geom])
    kind = mujoco.mjtGeom(int(model.geom_type[geom])).name.removeprefix("mjGEOM_").lower()
    role = GROUPS.get(group, f"group {group}")
    pose = pose_of(model.geom_pos[geom], model.geom_quat[geom])
    facts: dict[str, Value] = {
        "role": role,
        "body": _body_name(model, int(model.geom_bodyid[geom])),
        "geometry": kind,
        "mask": float(model.geom_contype[geom]),
        "partners": float(model.geom_conaffinity[geom]),
    }
    if kind == "mesh":
        surface = meshes.of(int(model.geom_dataid[geom])).moved(pose)
        facts |= surface.facts()
        if surface.normals:
            facts["mjcf:normals"] = surface.normals
    else:
        facts |= {"size": _size(kind, model.geom_size[geom]), "pose": (*pose.xyz, *pose.quat)}
    if facts["mask"] or facts["partners"]:
        facts |= contact_facts(model, geom)
    material = int(model.geom_matid[geom])
    rgba = _numbers(np.float32(model.geom_rgba[geom]))
    own = rgba != (0.5, 0.5, 0.5, 1.0)  # MuJoCo draws it rather than the material's
    if material >= 0 or own:
        facts["rgba"] = rgba if own else _numbers(model.mat_rgba[material])
    if material >= 0:
        textures = [int(t) for t in np.ravel(model.mat_texid[material]) if int(t) >= 0]
        facts |= {"texture": meshes.pixels(textures[0])} if textures else {}
    return facts


def _size(kind: str, half: object) -> tuple[float, ...]:
    """As the vocabulary has it; MuJoCo counts half edges and half lengths."""
    a, b, c = _numbers(half)
    match kind:
        case "box":
            return (2.0 * a, 2.0 * b, 2.0 * c)
        case "sphere":
            return (a,)
        case "cylinder" | "capsule":
            return (a, 2.0 * b)
    return (a, b, c)


def contact_facts(model: Model, geom: int) -> dict[str, Value]:
    """Return the facts of a surface that may touch something."""
    return {
        "friction": _numbers(model.geom_friction[geom]),
        "condim": float(model.geom_condim[geom]),
        "priority": float(model.geom_priority[geom]),
        "solref": _numbers(model.geom_solref[geom]),
        "solimp": _numbers(model.geom_solimp[geom]),
        "margin": float(model.geom_margin[geom]),
        "gap": float(model.geom_gap[geom]),
    }


def _excluded(model: Model) -> Counter[tuple[int, int]]:
    """How often each pair of bodies (sorted numbers) is excluded."""
    ends = (sorted((int(pair) >> 16, int(pair) & 0xFFFF)) for pair in model.exclude_signature)
    return Counter((first, second) for first, second in ends)


def _filtered(
    model: Model, opaque: Collection[tuple[str, str]] = frozenset()
) -> Iterator[tuple[str, str]]:
    """Pairs of bodies (sorted names) that both have collision geoms and never meet."""
    said = {(int(pair) >> 16, int(pair) & 0xFFFF) for pair in model.exclude_signature}
    masks: dict[int, list[tuple[int, int]]] = {}
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    for geom in np.flatnonzero(solid):
        if ("shape", _name(model, "geom", int(geom))) in opaque:
            continue
        bits = int(model.geom_contype[geom]), int(model.geom_conaffinity[geom])
        masks.setdefault(int(model.geom_bodyid[geom]), []).append(bits)
    masks.pop(0, None)
    for a, b in itertools.combinations(sorted(masks), 2):
        meets = any(
            one[0] & two[1] or two[0] & one[1] for one in set(masks[a]) for two in set(masks[b])
        )
        if not meets or (a, b) in said or (b, a) in said or passes(model, a, b):
            first, second = sorted((_body_name(model, a), _body_name(model, b)))
            yield first, second


# --- sensors, cameras, poses ----------------------------------------------------------------


def _senses(model: Model, book: Writer) -> None:
    import mujoco

    for sensor in range(model.nsensor):
        kind = mujoco.mjtSensor(int(model.sensor_type[sensor])).name.removeprefix("mjSENS_").lower()
        book.put(
            "sensor",
            _name(model, "sensor", sensor),
            {
                "type": kind.replace("actfrc", "actuatorfrc"),  # MJCF's word
                "object": _object(model, sensor, "obj"),
                "reference": _object(model, sensor, "ref"),
                "cutoff": float(model.sensor_cutoff[sensor]),
                "noise": float(model.sensor_noise[sensor]),
            },
        )
    for camera in range(model.ncam):
        pose = pose_of(model.cam_pos[camera], model.cam_quat[camera])
        mode = mujoco.mjtCamLight(int(model.cam_mode[camera])).name
        book.put(
            "camera",
            _name(model, "camera", camera),
            {
                "body": _body_name(model, int(model.cam_bodyid[camera])),
                "pose": (*pose.xyz, *pose.quat),
                "field of view": math.radians(float(model.cam_fovy[camera])),
                "resolution": _numbers(model.cam_resolution[camera]),
                "tracking": mode.removeprefix("mjCAMLIGHT_").lower(),
            },
        )


def _object(model: Model, sensor: int, side: str) -> str:
    """What a sensor looks at ("obj"), or in whose frame ("ref")."""
    import mujoco

    kind = mujoco.mjtObj(int(getattr(model, f"sensor_{side}type")[sensor]))
    index = int(getattr(model, f"sensor_{side}id")[sensor])
    if index < 0 or kind.name not in OBJECTS:
        return ""
    name = str(mujoco.mj_id2name(model, int(kind), index) or index)
    return "world" if name == "world" else f"{OBJECTS[kind.name]} {name}"


def _keyframe(model: Model, key: int, moving: list[int], drives: list[Drive], book: Writer) -> None:
    name, qpos, ctrl = _name(model, "key", key), model.key_qpos[key], model.key_ctrl[key]
    if model.njnt and int(model.jnt_type[0]) == 0:
        pose = pose_of(qpos[:3], qpos[3:7])
        book.put("keyframe", name, {"base pose": (*pose.xyz, *pose.quat)})
    for joint in moving:
        value = float(qpos[int(model.jnt_qposadr[joint])])
        book.put("keyframe", f"{name}/{_name(model, 'joint', joint)}", {"position": value})
    for joint in range(model.njnt):
        if int(model.jnt_type[joint]) == BALL:
            address = int(model.jnt_qposadr[joint])
            turn = pose_of((0.0, 0.0, 0.0), qpos[address : address + 4]).quat
            subject = f"{name}/{_name(model, 'joint', joint)}"
            book.put("keyframe", subject, {"mjcf:orientation": turn})
    for drive in drives:
        subject = f"{name}/{drive.joint_name}"
        book.put("keyframe", subject, {"target": float(ctrl[drive.ctrl_index])})


def simulation_facts(option: Any) -> dict[str, Value]:  # Any: MuJoCo's MjOption
    """What a model steps with."""
    import mujoco

    integrator = mujoco.mjtIntegrator(int(option.integrator)).name.removeprefix("mjINT_")
    cone = mujoco.mjtCone(int(option.cone)).name.removeprefix("mjCONE_").lower()
    solver = mujoco.mjtSolver(int(option.solver)).name.removeprefix("mjSOL_")
    words = {"EULER": "Euler", "NEWTON": "Newton", "RK4": "RK4", "CG": "CG", "PGS": "PGS"}
    return {
        "timestep": float(option.timestep),
        "gravity": _numbers(option.gravity),
        "integrator": words.get(integrator, integrator.lower()),
        "cone": cone,
        "solver": words.get(solver, solver),
        "iterations": float(option.iterations),
        "line search iterations": float(option.ls_iterations),
        "impratio": float(option.impratio),
    }
