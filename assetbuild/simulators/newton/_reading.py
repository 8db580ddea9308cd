"""What Newton's solver holds of a USD or an MJCF; runs in Newton's environment. API as of 1.8."""

from __future__ import annotations

import itertools
import math
from typing import Any

UNLIMITED = 1e6
"""Newton's word for an effort or a range without limit, at least."""


LAW = {
    "kp": "kp",
    "kd": "kd",
    "max_effort": "maxEffort",
    "max_motor_effort": "maxMotorEffort",
    "saturation_effort": "saturationEffort",
    "velocity_limit": "velocityLimit",
}
"""Arrays of Newton's drives and clamps, and what the USD calls them."""


def readings(model: Any, held: Any, run: dict[str, Any]) -> dict[str, Any]:
    """Facts of bodies, joints and shapes, SI; None = unlimited, or none.

    run: has their names by what the file calls them, its whole path or the end of it. Of a USD also
    what it alone says: how soft limits are, and the laws of explicit drives. Joints are those of
    the solver's model: MJCF drives live in attributes of Newton that only it sees.
    """
    usd = run["stage"].endswith(".usda")
    joints = {joined(label): label for label in model.joint_label}

    def named(index: int) -> str:
        name = held.joint(index).name.strip("_")
        return called(joints.get(name, name), run["joints"])

    turning = [i for i in range(held.njnt) if int(held.jnt_type[i]) in (2, 3)]  # slide, hinge
    drives = driven(held)
    rows = {named(index): joint(held, index, *drives.get(index, ())) for index in turning}
    for index in range(held.neq):
        if int(held.eq_type[index]) == 2 and int(held.eq_obj2id[index]) >= 0:  # mjEQ_JOINT
            rows[named(int(held.eq_obj1id[index]))] |= {
                "mimics": named(int(held.eq_obj2id[index])),
                "mimic offset": float(held.eq_data[index, 0]),
                "mimic multiplier": float(held.eq_data[index, 1]),
            }
    for index in turning if usd else ():
        row = rows[named(index)]
        limited = row["lower"] is not None or row["upper"] is not None
        row["newton:solreflimit"] = held.jnt_solref[index].tolist() if limited else None
    for label, law in actuators(model).items() if usd else ():
        rows[called(label, run["joints"])] |= law
    return {
        "dof": int(held.nv),
        "bodies": bodies(model, run["bodies"]),
        "joints": rows,
        "shapes": shapes(model, held, run.get("shapes", {})),
        "touching": touching(model, held, run["bodies"]),
    }


def called(label: str, names: dict[str, str]) -> str:
    """The robot's name of a label."""
    end = label.rsplit("/", 1)[-1]
    return names.get(label, names.get(end, end))


def joined(label: str) -> str:
    """What the solver calls a label."""
    return "_".join(label.strip("/").split("/")).strip("_")


def driven(held: Any) -> dict[int, tuple[int, float]]:
    """By joint, its actuator and the gear by which this acts there, m or rad per m or rad.

    An actuator of a fixed tendon acts on the joint that all joints of the tendon follow.
    """
    leaders = {
        int(held.eq_obj1id[i]): (int(held.eq_obj2id[i]), float(held.eq_data[i, 1]))
        for i in range(held.neq)
        if int(held.eq_type[i]) == 2 and int(held.eq_obj2id[i]) >= 0
    }
    found: dict[int, tuple[int, float]] = {}
    for index in range(held.nu):
        moved, gear = int(held.actuator_trnid[index, 0]), float(held.actuator_gear[index, 0])
        parts = {moved: gear}
        if int(held.actuator_trntype[index]) == 3:  # mjTRN_TENDON
            first, count = int(held.tendon_adr[moved]), int(held.tendon_num[moved])
            parts = {}
            for wrap in range(first, first + count):
                name, share = leaders.get(int(held.wrap_objid[wrap]), (held.wrap_objid[wrap], 1.0))
                parts[int(name)] = parts.get(int(name), 0.0) + gear * share * held.wrap_prm[wrap]
        if len(parts) == 1:
            found |= {name: (index, abs(float(gear))) for name, gear in parts.items()}
    return found


def actuators(model: Any) -> dict[str, dict[str, float | None]]:
    """By joint, the law of its `NewtonActuator`: gains and what limits the effort, SI, rad."""
    starts = [int(start) for start in model.joint_qd_start.numpy()]
    labels = dict(zip(starts, model.joint_label, strict=False))
    found: dict[str, dict[str, float | None]] = {}
    for group in model.actuators:
        parts = [group.drive, *group.clamping]
        columns = {
            word: getattr(part, name).numpy()
            for part in parts
            for name, word in LAW.items()
            if getattr(part, name, None) is not None
        }
        for row, dof in enumerate(group.indices.numpy()):
            values = {word: float(column[row]) for word, column in columns.items()}
            found[labels[int(dof)]] = {
                f"newton:actuator {word}": value if math.isfinite(value) else None
                for word, value in values.items()
            }
    return found


def bodies(model: Any, names: dict[str, str]) -> dict[str, dict[str, Any]]:
    """Mass, centre and tensor (xx, yy, zz, xy, xz, yz) about it, in the body's axes."""
    found = {}
    columns = (model.body_mass, model.body_com, model.body_inertia)
    rows = zip(model.body_label, *(column.numpy() for column in columns), strict=True)
    for label, mass, centre, tensor in rows:
        six = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
        found[called(label, names)] = {
            "mass": float(mass),
            "centre of mass": [float(v) for v in centre],
            "inertia": [float(tensor[i][j]) for i, j in six],
        }
    return found


def shapes(model: Any, held: Any, names: dict[str, str]) -> dict[str, dict[str, Any]]:
    """The surface of each collision shape; margin and gap are Newton's, whose solver has none."""
    margins, gaps = model.shape_margin.numpy(), model.shape_gap.numpy()
    found = {}
    for index in range(held.ngeom):
        label, _, shape = held.geom(index).name.rpartition("_")  # Newton appends its number
        if label:
            found[called(label, names)] = {
                "friction": held.geom_friction[index].tolist(),
                "condim": float(held.geom_condim[index]),
                "priority": float(held.geom_priority[index]),
                "solref": held.geom_solref[index].tolist(),
                "solimp": held.geom_solimp[index].tolist(),
                "margin": float(margins[int(shape)]),
                "gap": float(gaps[int(shape)]),
            }
    return found


def joint(held: Any, index: int, drive: int | None = None, gear: float = 1.0) -> dict[str, Any]:
    """One joint of the solver's model; its drive as it acts on the joint, behind the gear."""
    dof = int(held.jnt_dofadr[index])
    efforts = [float(held.jnt_actfrcrange[index, 1])] if held.jnt_actfrclimited[index] else []
    if drive is not None and held.actuator_forcelimited[drive]:
        efforts.append(gear * float(held.actuator_forcerange[drive, 1]))
    effort = min(efforts, default=math.inf)
    limited = bool(held.jnt_limited[index]) and abs(held.jnt_range[index]).max() < UNLIMITED
    return {
        "type": {2: "linear", 3: "rotary"}[int(held.jnt_type[index])],
        "axis": [float(v) for v in held.jnt_axis[index]],
        "lower": float(held.jnt_range[index, 0]) if limited else None,
        "upper": float(held.jnt_range[index, 1]) if limited else None,
        "kp": -gear * gear * float(held.actuator_biasprm[drive, 1]) if drive is not None else 0.0,
        "kd": -gear * gear * float(held.actuator_biasprm[drive, 2]) if drive is not None else 0.0,
        "effort": effort if effort < UNLIMITED else None,
        "armature": float(held.dof_armature[dof]),
        "friction": float(held.dof_frictionloss[dof]),
        "damping": float(held.dof_damping[dof]),
    }


def touching(model: Any, held: Any, own: dict[str, str]) -> list[list[str]]:
    """Pairs of bodies, by name, that the solver's masks, excludes and own filter let touch."""
    labels = {joined(label): label for label in model.body_label}
    excluded = {int(signature) for signature in held.exclude_signature}
    solid = [i for i in range(held.ngeom) if held.geom_contype[i] or held.geom_conaffinity[i]]
    pairs = [(int(held.pair_geom1[i]), int(held.pair_geom2[i])) for i in range(held.npair)]
    for a, b in itertools.combinations(solid, 2):
        one, two = sorted((int(held.geom_bodyid[a]), int(held.geom_bodyid[b])))
        masks = (held.geom_contype[a] & held.geom_conaffinity[b]) | (
            held.geom_contype[b] & held.geom_conaffinity[a]
        )
        if masks and (one << 16) + two not in excluded and not passes(held, one, two):
            pairs.append((a, b))
    found = set()
    for pair in pairs:
        bodies = [held.body(int(held.geom_bodyid[geom])).name.strip("_") for geom in pair]
        if "world" not in bodies:
            found.add(tuple(sorted(called(labels.get(b, b), own) for b in bodies)))
    return [list(pair) for pair in sorted(found)]


def passes(held: Any, one: int, two: int) -> bool:
    """Whether both are one rigid piece, or parent and child that both move."""
    here, there = int(held.body_weldid[one]), int(held.body_weldid[two])
    above = [int(held.body_weldid[held.body_parentid[weld]]) for weld in (here, there)]
    return here == there or (0 not in (here, there) and (here == above[1] or there == above[0]))
