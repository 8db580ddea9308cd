"""A robot that holds a keyframe on the floor of a scene, in MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from assetbuild.errors import StepError
from assetbuild.robot.model import Control
from assetbuild.robot.pose import Array
from assetbuild.simulators.mujoco import (
    Data,
    Model,
    at_key,
    caught_warnings,
    collision_geoms,
    floats,
    floor_contacts,
    floors,
    is_finite,
    name_of,
    overlaps,
    turning,
)
from assetbuild.simulators.mujoco.drives import Drive, drives_of, read_drives


@dataclass(frozen=True)
class Gains:
    """A PD law outside the simulator. effort: N m or N, None = unlimited."""

    kp: float
    kd: float
    effort: float | None = None


@dataclass(frozen=True)
class Stand:
    """What a robot did that held a keyframe on the floor. Names are of geoms and joints.

    gap_m: lowest point over the floor at the start, by collision geom, m.
    sag_m: base lower than at the start; tilt_rad: of the base's z axis; drift_m: sideways.
    touching, touched: geoms on the floor at the end, and at any time.
    overlapping: pairs of the robot's own geoms in contact at the start, with depth in m.
    joint_sag: target minus position at the end, rad or m; load: |torque| / effort at the end.
    floats: whether its base is free; driven: whether it has actuators; held: joints whose drives
    aim at a position; slides: joints in m.
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
    held: tuple[str, ...]
    slides: tuple[str, ...]
    com_height_m: float
    com_sag_m: float

    @property
    def worst_held(self) -> tuple[str, float]:
        """The held joint furthest from its target at the end, and how far, rad or m."""
        off = {name: abs(self.joint_sag[name]) for name in self.held}
        return max(off.items(), key=lambda item: (item[1], item[0]), default=("", 0.0))


EXTERNAL = frozenset({"ideal_pd", "dc_motor", "motor"})
"""Actuator models whose PD law acts outside of the simulator, from kp and kd of the table."""
_SLIDE = 2
"""`mjJNT_SLIDE`."""
Outcome = Literal["stands", "holds", "falls", "rests", "unstable"]
"""A floating robot stands under its drives, or rests where it has none; a fixed one holds."""


def outcome(stood: Stand, fall: float) -> Outcome:
    """What a robot did that nobody touched.

    fall: share of the height of its base or centre of mass that it may lose, rad that its base may
    tilt, and rad (m) that a driven joint of a fixed robot may move.
    """
    if not stood.finite:
        return "unstable"
    if not stood.floats and not stood.held:
        return "rests"
    if not stood.floats:
        return "falls" if stood.worst_held[1] > fall else "holds"
    # A base frame on the ground cannot sink, so the centre of mass counts besides.
    height = max(stood.height_m, stood.com_height_m)
    lower = stood.sag_m > fall * height or stood.com_sag_m > fall * stood.com_height_m
    if lower or stood.tilt_rad > fall:
        return "falls"
    return "stands" if stood.driven else "rests"


def outcome_figures(stood: Stand, fall: float) -> dict[str, object]:
    """The outcome with its heights (m), and a sentence for the verdict."""
    did, seconds = outcome(stood, fall), f"{stood.seconds:.3g} s"
    if did == "unstable":
        return {"outcome": did, "sentence": f"the simulation became unstable within {seconds}"}
    if not stood.floats:
        joint, off = stood.worst_held
        unit = "m" if joint in stood.slides else "rad"
        far = f"`{joint}` moves furthest, by {off:.3g} {unit}"
        verb = "does not hold" if did == "falls" else "holds"
        said = f"{verb} its pose for {seconds}: {far}"
        if did == "rests":
            said = "rests on its fixed base: no drive holds a position"
        return {"outcome": did, "sentence": said}
    after = stood.height_m - stood.sag_m
    verb = {
        "stands": f"stands for {seconds}",
        "rests": f"rests for {seconds} without drives",
        "falls": f"falls within {seconds}",
    }[did]
    heights = f"base height {stood.height_m:.3g} m at the start, {after:.3g} m at the end"
    return {
        "outcome": did,
        "sentence": f"{verb}: {heights}, tilted by {stood.tilt_rad:.2g} rad",
        "height_before_m": stood.height_m,
        "height_after_m": after,
    }


def stand(
    model: Model, keyframe: str | int, seconds: float, external: Mapping[str, Gains] | None = None
) -> Stand:
    """Holds a keyframe of a scene with a floor (a plane of the world at z = 0) for a while.

    keyframe: its name, or its number where it may have none.
    external: PD laws by joint name, for joints whose actuator is a plain torque motor.
    Raises StepError when there is no such keyframe or no floor.
    """
    import mujoco

    key = _key(model, keyframe)
    if not floors(model):
        raise StepError("the scene has no floor: no plane in its world")
    laws = laws_of(model, external or {})
    holding = [drive.joint_name for drive in read_drives(model) if drive.holds_position]
    with caught_warnings() as said:
        data = at_key(model, key)
        target = np.array(data.qpos)
        gaps = {name_of(model, "geom", i): lowest_z(model, data, i) for i in collision_geoms(model)}
        overlapping = overlaps(model, data, "geom")
        base = _base(model)
        X_start = np.array(data.xpos[base]), np.array(data.xmat[base]).reshape(3, 3)
        com_start = float(np.array(data.subtree_com[base])[2])
        touched: set[str] = set()
        for _ in range(max(1, round(seconds / model.opt.timestep))):
            command(model, data, target, laws)
            mujoco.mj_step(model, data)
            touched |= _on_floor(model, data)
        mujoco.mj_forward(model, data)
        finite = is_finite(data)
    turned = X_start[1].T @ np.array(data.xmat[base]).reshape(3, 3)
    moved = np.array(data.xpos[base]) - X_start[0]
    com = float(np.array(data.subtree_com[base])[2])
    places = {name_of(model, "joint", j): int(model.jnt_qposadr[j]) for j in turning(model)}
    return Stand(
        seconds=float(data.time),
        finite=finite,
        warnings=tuple(said),
        height_m=float(X_start[0][2]),
        gap_m=gaps,
        sag_m=-float(moved[2]),
        tilt_rad=math.acos(max(-1.0, min(1.0, float(turned[2, 2])))),
        drift_m=math.hypot(float(moved[0]), float(moved[1])),
        touching=tuple(sorted(_on_floor(model, data))),
        touched=tuple(sorted(touched)),
        overlapping=overlapping,
        joint_sag={name: float(target[q] - data.qpos[q]) for name, q in places.items()},
        load=_load(model, data),
        floats=floats(model),
        driven=model.nu > 0,
        held=tuple(dict.fromkeys((*holding, *(drive.joint_name for drive, _ in laws)))),
        slides=tuple(n for n in places if int(model.joint(n).type[0]) == _SLIDE),
        com_height_m=com_start,
        com_sag_m=com_start - com,
    )


def _key(model: Model, keyframe: str | int) -> int:
    """The number of a keyframe."""
    import mujoco

    key = keyframe
    if isinstance(key, str):
        key = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, key)
    if not 0 <= key < model.nkey:
        raise StepError(f"the model has no keyframe `{keyframe}`")
    return key


def _base(model: Model) -> int:
    """The body that floats; of a fixed robot the first."""
    return int(model.jnt_bodyid[0]) if floats(model) else 1


def lowest_z(model: Model, data: Data, geom: int) -> float:
    """World z of the lowest point of a sphere, capsule, cylinder, ellipsoid, box or mesh, m."""
    import mujoco

    kinds = mujoco.mjtGeom
    kind, size = int(model.geom_type[geom]), np.array(model.geom_size[geom])
    z = float(data.geom_xpos[geom][2])
    down = np.array(data.geom_xmat[geom]).reshape(3, 3)[2]  # world z in the axes of the geom
    if kind == kinds.mjGEOM_SPHERE:
        return z - float(size[0])
    if kind == kinds.mjGEOM_CAPSULE:
        return z - float(size[0] + size[1] * abs(down[2]))
    if kind == kinds.mjGEOM_CYLINDER:
        return z - float(size[0] * math.hypot(down[0], down[1]) + size[1] * abs(down[2]))
    if kind == kinds.mjGEOM_BOX:
        return z - float(size @ np.abs(down))
    if kind == kinds.mjGEOM_ELLIPSOID:
        return z - float(np.linalg.norm(size * down))
    if kind == kinds.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first = int(model.mesh_vertadr[mesh])
        vertices = model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])]
        return z + float((vertices @ down).min())
    raise StepError(f"no lowest point of a geom of type {kind}")


def _on_floor(model: Model, data: Data) -> set[str]:
    return {name_of(model, "geom", geom) for _, geom in floor_contacts(model, data)}


def external_laws(control: Control) -> dict[str, Gains]:
    """PD laws by joint of the drives that are plain motors in MJCF, from the actuator table."""
    return {a.joint: Gains(a.kp, a.kd, a.effort) for a in control.actuators if a.model in EXTERNAL}


def laws_of(model: Model, external: Mapping[str, Gains]) -> list[tuple[Drive, Gains]]:
    """The motors that a law outside of the simulator commands."""
    motors = (drive for drive in read_drives(model) if drive.gain)
    return [(drive, external[drive.joint_name]) for drive in motors if drive.joint_name in external]


def command(model: Model, data: Data, target: Array, laws: Sequence[tuple[Drive, Gains]]) -> None:
    """What a controller with these gains would command before this step.

    target: (nq,) positions.
    """
    for drive, gains in laws:
        q, v = int(model.jnt_qposadr[drive.joint]), int(model.jnt_dofadr[drive.joint])
        torque = gains.kp * (target[q] - data.qpos[q]) - gains.kd * data.qvel[v]
        if gains.effort is not None:
            torque = max(-gains.effort, min(gains.effort, torque))
        data.ctrl[drive.ctrl_index] = torque / drive.gain


def _load(model: Model, data: Data) -> dict[str, float]:
    load = {}
    for joint in turning(model):
        found = drives_of(model, joint)
        torque = float(data.qfrc_actuator[int(model.jnt_dofadr[joint])])
        limit = found.torque[1] if torque > 0.0 else -found.torque[0]
        if found.drives and 0.0 < limit < math.inf:
            load[name_of(model, "joint", joint)] = abs(torque) / limit
    return load
