"""MuJoCo as checks use it: load, look, drop, stand. Versions 3.11 to 4.

MuJoCo's own warnings are caught: without a handler they go to a log file in the working folder.
"""

from __future__ import annotations

import copy
import math
import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from assetbuild.errors import StepError
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import Array, rotation_of
from assetbuild.simulators.experiments import FreeFall, fall_of

Model = Any  # mujoco.MjModel: its extension module has no types
Data = Any  # mujoco.MjData: as above


def body_names(tree: Tree) -> dict[str, str]:
    """Name in MJCF by body name: the same, but `world` is MuJoCo's own."""
    names = {body.name: body.name for body in tree.bodies}
    if "world" in names:
        written = "world_body"
        while written in names:
            written += "_"
        names["world"] = written
    return names


@dataclass(frozen=True)
class Loaded:
    """A compiled model and what MuJoCo said about it."""

    model: Model
    warnings: tuple[str, ...]


def load(path: Path, *, visuals: bool = True) -> Loaded:
    """Compiles an MJCF file; StepError with MuJoCo's own words when it refuses.

    visuals: False leaves out, as MuJoCo's `discardvisual` does, what has no effect on the
    physics: compiling is quick then, because most meshes are never read.
    """
    with caught_warnings() as said:
        try:
            model = _compiled(path) if visuals else _compiled_for_physics(path)
        except ValueError as error:
            raise StepError(_without_folder(str(error), path)) from None
    return Loaded(model, tuple(_without_folder(text, path) for text in said))


def _compiled(path: Path) -> Model:
    import mujoco

    return mujoco.MjModel.from_xml_path(str(path))


def _compiled_for_physics(path: Path) -> Model:
    import mujoco

    spec = mujoco.MjSpec.from_file(str(path))
    spec.compiler.discardvisual = True  # keeps what a visual shape gives a body without inertia
    return spec.compile()


def _without_folder(text: str, path: Path) -> str:
    """No absolute path: the same message wherever the file lies; in one line.

    Without what MuJoCo adds about the visual shapes that we asked it to leave out.
    """
    text = re.sub(r"The visual elements of the spec were discarded[^.]*\.", "", text)
    plain = text.replace(f"{path.parent.resolve()}/", "").replace(f"{path.parent}/", "")
    return " ".join(plain.split())


@contextmanager
def caught_warnings() -> Iterator[list[str]]:
    """Collects what MuJoCo warns about meanwhile, in order."""
    import mujoco

    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(said.append)
    try:
        with warnings.catch_warnings(record=True) as from_python:
            warnings.simplefilter("always")
            yield said
        said += [str(item.message) for item in from_python]
    finally:
        mujoco.set_mju_user_warning(before)


def name_of(model: Model, kind: str, index: int) -> str:
    """Name of a body, joint, geom, site, actuator or key; `<kind> <index>` when it has none."""
    return str(getattr(model, kind)(index).name) or f"{kind} {index}"


def inertia_of(model: Model, body: int) -> Array:
    """(3, 3) inertia about the centre of mass in the axes of the body, kg m2."""
    w, x, y, z = (float(v) for v in model.body_iquat[body])
    R = rotation_of((w, x, y, z))
    tensor: Array = R @ np.diag(model.body_inertia[body]) @ R.T
    return tensor


def mass_matrix(model: Model, data: Data) -> Array:
    """(nv, nv) joint-space inertia after `mj_forward` or `mj_crb`."""
    import mujoco

    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)  # same order of arguments in 3.11, 3.17 and 4
    return full


# --- states -------------------------------------------------------------------------------------


def without(model: Model, *flags: str) -> Model:
    """A copy to change and to step, with some of MuJoCo's features off: `CONTACT`, `LIMIT`."""
    import mujoco

    changed = copy.copy(model)
    for flag in flags:
        changed.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    return changed


def at_key(model: Model, key: int = 0) -> Data:
    """A keyframe with its controls; zero where the model has none."""
    import mujoco

    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, key)
    mujoco.mj_forward(model, data)
    return data


def step_for(model: Model, data: Data, seconds: float) -> int:
    """Steps for so long, at least once; how often."""
    import mujoco

    steps = max(1, round(seconds / float(model.opt.timestep)))
    mujoco.mj_step(model, data, steps)
    mujoco.mj_forward(model, data)
    return steps


def is_finite(data: Data) -> bool:
    """MuJoCo starts over silently when a state goes bad: its counters tell."""
    import mujoco

    bad = (
        mujoco.mjtWarning.mjWARN_BADQPOS,
        mujoco.mjtWarning.mjWARN_BADQVEL,
        mujoco.mjtWarning.mjWARN_BADQACC,
        mujoco.mjtWarning.mjWARN_BADCTRL,
    )
    if any(data.warning[int(kind)].number for kind in bad):
        return False
    return bool(np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all())


def overlaps(model: Model, data: Data, kind: str) -> dict[tuple[str, str], float]:
    """Depth (m) of the contacts of the robot with itself, by pair of names of `geom` or `body`."""
    found: dict[tuple[str, str], float] = {}
    for contact in data.contact[: data.ncon]:
        bodies = [int(model.geom_bodyid[geom]) for geom in (contact.geom1, contact.geom2)]
        if 0 not in bodies:
            pair = bodies if kind == "body" else (int(contact.geom1), int(contact.geom2))
            a, b = sorted(name_of(model, kind, index) for index in pair)
            found[a, b] = max(found.get((a, b), 0.0), -float(contact.dist))
    return dict(sorted(found.items()))


def turning(model: Model) -> list[int]:
    """Hinges and slides."""
    import mujoco

    kinds = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    return [joint for joint in range(model.njnt) if int(model.jnt_type[joint]) in kinds]


def raise_base(model: Model, data: Data, height_m: float) -> None:
    """Lift what floats; call before the next step."""
    import mujoco

    for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
        data.qpos[int(model.jnt_qposadr[joint]) + 2] += height_m


def driven_joint(model: Model, actuator: int) -> str:
    """Name of the joint that an actuator of the Robot drives."""
    return name_of(model, "joint", int(model.actuator_trnid[actuator, 0]))


def largest_force(model: Model, actuator: int) -> float | None:
    """N m or N: the limit of an actuator, that of the command of a plain motor; None = none."""
    if model.actuator_forcelimited[actuator]:
        return float(model.actuator_forcerange[actuator, 1])
    if model.actuator_ctrllimited[actuator] and not model.actuator_biastype[actuator]:
        return float(model.actuator_ctrlrange[actuator, 1])
    return None


# --- free fall ----------------------------------------------------------------------------------


def free_fall(model: Model, seconds: float) -> FreeFall:
    """Drops the robot from its first keyframe with contacts, limits and drives off.

    MuJoCo's integrators are semi-implicit: n steps of h from rest fall g/2 t (t + h), t = n h.
    """
    falling = without(model, "CONSTRAINT", "ACTUATION")
    with caught_warnings():
        data = at_key(falling)
        start = np.array(data.subtree_com[0])
        t = step_for(falling, data, seconds) * float(model.opt.timestep)
    moved = np.array(data.subtree_com[0]) - start
    gravity, h = np.array(model.opt.gravity), float(model.opt.timestep)
    return fall_of(moved, t, gravity, h, finite=is_finite(data))


# --- standing -----------------------------------------------------------------------------------


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


def stand(
    model: Model, keyframe: str, seconds: float, external: Mapping[str, Gains] | None = None
) -> Stand:
    """Holds a keyframe of a scene with a floor (a plane of the world at z = 0) for a while.

    external: PD laws by joint name, for joints whose actuator is a plain torque motor.
    Raises StepError when there is no such keyframe or no floor.
    """
    import mujoco

    key = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, keyframe)
    if key < 0:
        raise StepError(f"the model has no keyframe `{keyframe}`")
    if not floors(model):
        raise StepError("the scene has no floor: no plane in its world")
    floor = floors(model)[0]
    with caught_warnings() as said:
        data = at_key(model, key)
        target = np.array(data.qpos)
        gaps = {name_of(model, "geom", i): lowest_z(model, data, i) for i in collision_geoms(model)}
        overlapping = overlaps(model, data, "geom")
        X_start = np.array(data.xpos[1]), np.array(data.xmat[1]).reshape(3, 3)
        touched: set[str] = set()
        for _ in range(max(1, round(seconds / model.opt.timestep))):
            _drive_outside(model, data, target, external or {})
            mujoco.mj_step(model, data)
            touched |= _on_floor(model, data, floor)
        mujoco.mj_forward(model, data)
        finite = is_finite(data)
    turned = X_start[1].T @ np.array(data.xmat[1]).reshape(3, 3)
    moved = np.array(data.xpos[1]) - X_start[0]
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
        touching=tuple(sorted(_on_floor(model, data, floor))),
        touched=tuple(sorted(touched)),
        overlapping=overlapping,
        joint_sag={name: float(target[q] - data.qpos[q]) for name, q in places.items()},
        load=_load(model, data),
    )


def floors(model: Model) -> list[int]:
    """Planes of the world."""
    import mujoco

    planes = model.geom_type == int(mujoco.mjtGeom.mjGEOM_PLANE)
    return [int(i) for i in np.flatnonzero(planes & (model.geom_bodyid == 0))]


def collision_geoms(model: Model) -> list[int]:
    """Geoms of the robot that can touch something."""
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    return [int(i) for i in np.flatnonzero(solid & (model.geom_bodyid != 0))]


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


def _on_floor(model: Model, data: Data, floor: int) -> set[str]:
    touching = [{int(c.geom1), int(c.geom2)} for c in data.contact[: data.ncon]]
    others = set().union(*(pair for pair in touching if floor in pair)) - {floor}
    return {name_of(model, "geom", geom) for geom in others}


def _drive_outside(model: Model, data: Data, target: Array, external: Mapping[str, Gains]) -> None:
    """What a controller with these gains would command before this step."""
    if not external:
        return
    for actuator in range(model.nu):
        joint = int(model.actuator_trnid[actuator, 0])
        gains = external.get(name_of(model, "joint", joint))
        if gains is None:
            continue
        q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        torque = gains.kp * (target[q] - data.qpos[q]) - gains.kd * data.qvel[v]
        if gains.effort is not None:
            torque = max(-gains.effort, min(gains.effort, torque))
        data.ctrl[actuator] = torque


def _load(model: Model, data: Data) -> dict[str, float]:
    load = {}
    for actuator in range(model.nu):
        limit = largest_force(model, actuator)
        if limit:
            force = abs(float(data.actuator_force[actuator]))
            load[driven_joint(model, actuator)] = force / limit
    return load


def passes(model: Model, a: int, b: int) -> bool:
    """Whether MuJoCo lets two bodies (by number) pass through each other by its own rule.

    One rigid piece never touches itself, and neither do parent and child, unless the parent is
    part of the world or the model switches that filter off.
    """
    import mujoco

    weld_a, weld_b = int(model.body_weldid[a]), int(model.body_weldid[b])
    if weld_a == weld_b:
        return True
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FILTERPARENT or 0 in (weld_a, weld_b):
        return False
    above_a = int(model.body_weldid[model.body_parentid[weld_a]])
    above_b = int(model.body_weldid[model.body_parentid[weld_b]])
    return weld_a == above_b or weld_b == above_a
