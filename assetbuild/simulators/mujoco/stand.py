"""A robot that holds a keyframe on the floor of a scene, in MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from assetbuild.errors import StepError
from assetbuild.robot.pose import Array
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import Data, Model, mj
from assetbuild.simulators.mujoco.drives import read_drives, torques


@dataclass(frozen=True)
class Stand:
    """What a robot did that held a keyframe on the floor. Names are of geoms and joints.

    gap_m: lowest point over the floor at the start, by collision geom, m.
    sag_m: base lower than at the start; tilt_rad: of the base's z axis; drift_m: sideways.
    touching, touched: geoms on the floor at the end, and at any time.
    overlapping: pairs of the robot's own geoms in contact at the start, with depth in m.
    joint_sag: target minus position at the end, rad or m; load: |torque| / effort at the end.
    floats: whether its base is free; driven: whether it has actuators; worst_held: of the joints
    whose drives aim at a position, the one furthest from it at the end, how far, and the unit.
    com_height_m: of its centre of mass over the floor, at the start; com_sag_m: lower at the end.
    """

    seconds: float
    finite: bool
    warnings: tuple[str, ...]
    height_m: float
    gap_m: Mapping[str, float]
    sag_m: float
    tilt_rad: float
    drift_m: float
    touching: tuple[str, ...]
    touched: tuple[str, ...]
    overlapping: Mapping[tuple[str, str], float]
    joint_sag: Mapping[str, float]
    load: Mapping[str, float]
    floats: bool
    driven: bool
    worst_held: tuple[str, float, str]
    com_height_m: float
    com_sag_m: float


LEAST_M = 0.01
"""A lower base or centre of mass falls or rises as one of this height."""
FAR_M = 1e3
"""Shapes further than this above the floor count as so far."""
Outcome = Literal["stands", "holds", "falls", "rests", "unstable"]
"""A floating robot stands under its drives, or rests where it has none; a fixed one holds."""


def outcome(stood: Stand, fall: float) -> Outcome:
    """What a robot did that nobody touched.

    fall: share of the height of its base or centre of mass that it may lose, rad that its base may
    tilt, and rad (m) that a driven joint of a fixed robot may move.
    """
    if not stood.finite:
        return "unstable"
    if not stood.floats:
        joint, off, _ = stood.worst_held
        return "rests" if not joint else "falls" if off > fall else "holds"
    # A base frame on the ground cannot sink, so the centre of mass counts besides.
    lower = stood.sag_m > fall * _height(stood)
    lower = lower or stood.com_sag_m > fall * max(stood.com_height_m, LEAST_M)
    if lower or stood.tilt_rad > fall or _is_thrown(stood):
        return "falls"
    return "stands" if stood.driven else "rests"


def _is_thrown(stood: Stand) -> bool:
    """Whether it rose by more than its own height."""
    return -stood.com_sag_m > _height(stood)


def _height(stood: Stand) -> float:
    """Height over the floor that a fall is a share of, m."""
    return max(stood.height_m, stood.com_height_m, LEAST_M)


def outcome_figures(stood: Stand, fall: float) -> dict[str, object]:
    """The outcome with its heights (m), and a sentence for the verdict."""
    did, seconds = outcome(stood, fall), f"{stood.seconds:.3g} s"
    after, (joint, off, unit) = stood.height_m - stood.sag_m, stood.worst_held
    far = f"its pose for {seconds}: `{joint}` moves furthest, by {round(off, 6):.3g} {unit}"
    heights = (
        f"base height {round(stood.height_m, 6):z.3g} m at the start, {after:.3g} m at the end, "
        f"tilted by {stood.tilt_rad:.2g} rad"
    )
    why = "" if joint or not stood.driven else ", as no drive holds a position"
    falls = "is thrown up" if _is_thrown(stood) else "falls"
    sentence = {
        ("unstable", stood.floats): f"the simulation became unstable within {seconds}",
        ("holds", False): f"holds {far}",
        ("falls", False): f"does not hold {far}",
        ("rests", False): "rests on its fixed base: no drive holds a position",
        ("stands", True): f"stands for {seconds}: {heights}",
        ("rests", True): f"rests for {seconds} without drives: {heights}",
        ("falls", True): f"{falls} within {seconds}{why}: {heights}",
    }[did, stood.floats]
    known = {"height_before_m": stood.height_m, "height_after_m": after}
    shown = known if stood.floats and stood.finite else {}
    return {"outcome": did, "sentence": sentence, **shown}


def stand(model: Model, keyframe: str | int, seconds: float) -> Stand:
    """Holds a keyframe of a scene with a floor (a plane of the world at z = 0) for a while.

    keyframe: its name, or its number where it may have none. Drives whose law is outside of the
    simulator do nothing: see `drives.servoed`.
    Raises StepError when there is no such keyframe or no floor.
    """
    key = keyframe
    if isinstance(key, str):
        key = mj.mj_name2id(model, mj.mjtObj.mjOBJ_KEY, key)
    if not 0 <= key < model.nkey:
        raise StepError(f"the model has no keyframe `{keyframe}`")
    if not mujoco.floors(model):
        raise StepError("the scene has no floor: no plane in its world")
    base = int(model.jnt_bodyid[0]) if mujoco.floats(model) else 1
    joints = mujoco.joints(model)
    places = {name: int(model.jnt_qposadr[j]) for name, j in joints.items()}
    with mujoco.caught_warnings() as messages:
        data = mujoco.at_key(model, key)
        target, overlapping = np.array(data.qpos), mujoco.overlaps(model, data, "geom")
        shapes = {mujoco.name_of(model, "geom", i): i for i in mujoco.collision_geoms(model)}
        floor = mujoco.floors(model)[0]
        gaps = {
            name: float(mj.mj_geomDistance(model, data, geom, floor, FAR_M, None))
            for name, geom in shapes.items()
        }
        at, com, R = np.array(data.xpos[base]), float(data.subtree_com[base][2]), _axes(data, base)
        touched: set[str] = set()
        for _ in range(max(1, round(seconds / model.opt.timestep))):
            mj.mj_step(model, data)
            touched |= _on_floor(model, data)
        mj.mj_forward(model, data)
        finite = mujoco.is_finite(data)
    moved = np.array(data.xpos[base]) - at
    sag = {name: float(target[q] - data.qpos[q]) for name, q in places.items()}
    held = {d.joint_name for d in read_drives(model) if d.holds_position}
    far, worst = max(((abs(sag[name]), name) for name in held), default=(0.0, ""))
    unit = "m" if worst and int(model.jnt_type[joints[worst]]) == 2 else "rad"
    return Stand(
        seconds=float(data.time),
        finite=finite,
        warnings=tuple(messages),
        height_m=float(at[2]),
        gap_m=gaps,
        sag_m=-float(moved[2]),
        tilt_rad=math.acos(np.clip((R.T @ _axes(data, base))[2, 2], -1.0, 1.0)),
        drift_m=math.hypot(float(moved[0]), float(moved[1])),
        touching=tuple(sorted(_on_floor(model, data))),
        touched=tuple(sorted(touched)),
        overlapping=overlapping,
        joint_sag=sag,
        load=dict(_load(model, data, joints)),
        floats=mujoco.floats(model),
        driven=model.nu > 0,
        worst_held=(worst, far, unit),
        com_height_m=com,
        com_sag_m=com - float(data.subtree_com[base][2]),
    )


def _axes(data: Data, body: int) -> Array:
    """(3, 3) axes of a body in the world, as columns."""
    return np.array(data.xmat[body]).reshape(3, 3)


def _on_floor(model: Model, data: Data) -> set[str]:
    return {mujoco.name_of(model, "geom", geom) for _, geom in mujoco.floor_contacts(model, data)}


def _load(model: Model, data: Data, joints: Mapping[str, int]) -> Iterator[tuple[str, float]]:
    most = torques(model)
    for name, joint in joints.items():
        lower, upper = most.get(joint, (0.0, 0.0))
        torque = float(data.qfrc_actuator[int(model.jnt_dofadr[joint])])
        limit = upper if torque > 0.0 else -lower
        if 0.0 < limit < math.inf:
            yield name, abs(torque) / limit
