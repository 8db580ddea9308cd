"""MuJoCo as checks use it: load, look, drop. Versions 3.11 to 4.

MuJoCo's own warnings are caught: without a handler they go to a log file in the working folder.
"""

from __future__ import annotations

import copy
import itertools
import re
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from assetbuild.errors import StepError, one_line
from assetbuild.findings import NOT_LOADED
from assetbuild.plugin_types import Check
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import Array, rotation_of

Model = Any  # mujoco.MjModel: its extension module has no types
Data = Any  # mujoco.MjData: as above


class _Engine:
    """MuJoCo itself, imported where it is first used."""

    def __getattr__(self, name: str) -> Any:  # Any: as above
        import mujoco

        value = self.__dict__[name] = getattr(mujoco, name)
        return value


mj: Any = _Engine()  # Any: as above
HELD_KG = 1e6
"""Inertia added to coordinates, such as the six of a floating base, to hold them: against 100 kg it
moves by a ten thousandth. Much more costs the constraints of light fingers the solver's digits."""


def body_names(tree: Tree) -> dict[str, str]:
    """Name in MJCF by body name: the same, but `world` is MuJoCo's own."""
    names = {body.name: body.name for body in tree.bodies}
    if "world" in names:
        written = "world_body"
        while written in names:
            written += "_"
        names["world"] = written
    return names


class WithMujoco(Check):
    """Base of the checks that look at compiled models."""

    shares = True
    isolated: ClassVar[bool] = True
    preload: ClassVar[tuple[str, ...]] = ("mujoco",)


class InMujoco(WithMujoco):
    """Base of the checks that simulate the MJCF."""

    needs: ClassVar[tuple[str, ...]] = ("mjcf",)
    engines: ClassVar[tuple[str, ...]] = ("mujoco",)


LEAST_STEP_S = 1e-6
"""Shorter steps, and none, are mistakes: a second would take a million of them."""


class ArenaFullError(StepError):
    """MuJoCo's own memory, `<size memory>`, does not hold the contacts and constraints of a state.

    MuJoCo then goes on without any constraint, or stops.
    """


ARENA_FULL = ("Insufficient arena memory", "arena memory is full", "mj_stackAlloc: out of memory")
"""What MuJoCo 3.11 to 4 say then, in a warning or an error."""


def full_and_mjx(inputs: Path, stem: str) -> Iterator[tuple[str, Path]]:
    """(target, file) of the full model and, where it is built, the mjx model among a check's files.

    stem: the robot's name, or `scene`.
    """
    for target, name in (("mjcf", f"{stem}.xml"), ("mjx", f"{stem}_mjx.xml")):
        if (path := inputs / target / name).is_file():
            yield target, path


def full_and_mjx_models(
    inputs: Path, stem: str, figures: dict[str, object]
) -> Iterator[tuple[str, Path, Model]]:
    """(target, file, its model); of a file that does not load the figures say so, NOT_LOADED."""
    for target, path in full_and_mjx(inputs, stem):
        try:
            yield target, path, load(path, visuals=False).model
        except StepError as error:  # `mjcf.load` reports it
            figures[target] = {NOT_LOADED: error.message}


@dataclass(frozen=True)
class Loaded:
    """A compiled model and what MuJoCo said about it."""

    model: Model
    warnings: tuple[str, ...]


def load(
    path: Path, *, visuals: bool = True, change: Callable[[Any], None] | None = None
) -> Loaded:  # Any: MuJoCo's MjSpec
    """Compiles an MJCF file; StepError with MuJoCo's own words when it refuses.

    visuals: False leaves out what has no effect on the physics, as MuJoCo's `discardvisual` does,
    so most meshes are never read. change: what is done to the specification before compiling.
    """
    with caught_warnings() as messages:
        try:
            if visuals and change is None:
                model = mj.MjModel.from_xml_path(str(path))
            else:
                spec = mj.MjSpec.from_file(str(path))
                # Keeps what a visual shape gives a body without inertia.
                spec.compiler.discardvisual |= not visuals
                if change is not None:
                    change(spec)
                model = spec.compile()
        except ValueError as error:
            raise StepError(_without_folder(str(error), path)) from None
    if any("NaN" in text for text in messages) or model.opt.timestep < LEAST_STEP_S:
        why = f"a number in it is NaN, or its timestep of {model.opt.timestep:g} s is too short"
        raise StepError(why)
    return Loaded(model, tuple(_without_folder(text, path) for text in messages))


def leave_out_meshes(spec: Any, chosen: Callable[[Any], bool]) -> None:  # Any: MjSpec, MjsGeom
    """Small balls in the place of the meshes of some geoms. Bodies must state their masses."""
    for geom in spec.geoms:
        if geom.meshname and chosen(geom):
            geom.type, geom.size, geom.meshname = mj.mjtGeom.mjGEOM_SPHERE, (0.01, 0.0, 0.0), ""
    used = {geom.meshname for geom in spec.geoms}
    for mesh in [mesh for mesh in spec.meshes if mesh.name not in used]:
        spec.delete(mesh)


def _without_folder(text: str, path: Path) -> str:
    """Put it in one line without absolute paths, nor words about visual shapes that we left out."""
    text = re.sub(r"The visual elements of the spec were discarded[^.]*\.", "", text)
    plain = text.replace(f"{path.parent.resolve()}/", "").replace(f"{path.parent}/", "")
    return " ".join(plain.split())


@contextmanager
def caught_warnings() -> Iterator[list[str]]:
    """Collects what MuJoCo warns about meanwhile, in order.

    ArenaFullError where its memory did not suffice; StepError where MuJoCo gave up otherwise.
    """
    messages: list[str] = []
    before = mj.get_mju_user_warning()
    mj.set_mju_user_warning(messages.append)
    try:
        with warnings.catch_warnings(record=True) as from_python:
            warnings.simplefilter("always")
            yield messages
        messages += [str(item.message) for item in from_python]
    except mj.FatalError as error:
        _refuse_full([str(error)])
        raise StepError(f"MuJoCo gave up: {one_line(error)}") from None
    finally:
        mj.set_mju_user_warning(before)
    _refuse_full(messages)


def _refuse_full(messages: list[str]) -> None:
    for text in messages:
        if any(words in text for words in ARENA_FULL):
            raise ArenaFullError(f"MuJoCo's memory is full: {one_line(text)}")


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
    full = np.zeros((model.nv, model.nv))
    mj.mj_fullM(model, data, full)  # same order of arguments in 3.11, 3.17 and 4
    return full


# --- states -------------------------------------------------------------------------------------


def without(model: Model, *flags: str) -> Model:
    """A copy to change and to step, with some of MuJoCo's features off: `CONTACT`, `LIMIT`."""
    changed = copy.copy(model)
    for flag in flags:
        changed.opt.disableflags |= int(getattr(mj.mjtDisableBit, f"mjDSBL_{flag}"))
    return changed


def at_key(model: Model, key: int | None = None) -> Data:
    """A keyframe with its controls; without `key` the initial pose, as `robot.initial` has it."""
    data = mj.MjData(model)
    if key is None and model.nkey:  # `home`, else the first
        key = max(int(mj.mj_name2id(model, mj.mjtObj.mjOBJ_KEY, "home")), 0)
    if key is not None:
        mj.mj_resetDataKeyframe(model, data, key)
    else:  # as near to zero as the limits allow; followers there, and position servos hold it
        turning = np.isin(model.jnt_type, (2, 3))  # slide, hinge
        limited = np.flatnonzero(turning & (model.jnt_limited != 0))
        at, (lower, upper) = model.jnt_qposadr[limited], model.jnt_range[limited].T
        data.qpos[at] = np.clip(data.qpos[at], lower, upper)
        follow(model, data)
        mj.mj_forward(model, data)
        gain, bias = model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 1]
        servos = np.flatnonzero((gain > 0.0) & (bias < 0.0))
        data.ctrl[servos] = -bias[servos] / gain[servos] * data.actuator_length[servos]
    mj.mj_forward(model, data)
    return data


def follow(model: Model, data: Data) -> None:
    """Joints that an equality couples to another take the position that it asks for."""
    for index in np.flatnonzero(model.eq_type == mj.mjtEq.mjEQ_JOINT):
        follower, leader = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
        x = 0.0
        if leader >= 0:
            at = int(model.jnt_qposadr[leader])
            x = float(data.qpos[at] - model.qpos0[at])
        at = int(model.jnt_qposadr[follower])
        terms = model.eq_data[index, :5]
        data.qpos[at] = model.qpos0[at] + sum(float(c) * x**n for n, c in enumerate(terms))


def is_finite(data: Data) -> bool:
    """MuJoCo starts over silently when a state goes bad: the last of its warnings count that."""
    if data.warning.number[int(mj.mjtWarning.mjWARN_BADQPOS) :].any():
        return False
    return bool(np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all())


def overlaps(
    model: Model, data: Data, kind: str, *, floor: bool = False
) -> dict[tuple[str, str], float]:
    """Depth (m) of the contacts of the robot with itself, by pair of names of `geom` or `body`.

    floor: with floors, too, whose name is "".
    """
    geoms, distances = data.contact.geom[: data.ncon], data.contact.dist[: data.ncon]
    bodies, in_floor = model.geom_bodyid[geoms], np.isin(geoms, floors(model))
    counted = np.where(in_floor.any(axis=1), floor, bodies.all(axis=1))
    numbers = np.where(in_floor, -1, bodies if kind == "body" else geoms)[counted]
    deepest: dict[tuple[int, int], float] = {}
    for (a, b), distance in zip(numbers.tolist(), distances[counted].tolist(), strict=True):
        deepest[a, b] = max(deepest.get((a, b), 0.0), -distance)
    depths: dict[tuple[str, str], float] = {}
    for pair, depth in deepest.items():
        first, second = sorted("" if n < 0 else name_of(model, kind, n) for n in pair)
        depths[first, second] = max(depths.get((first, second), 0.0), depth)
    return dict(sorted(depths.items()))


def actuators(model: Model) -> range:
    """Their numbers; `nu` counts commands, of which an actuator has several in MuJoCo 4."""
    return range(len(model.actuator_trntype))


def first_command(model: Model, actuator: int) -> int:
    """The place of an actuator's command in `data.ctrl`, of the first of several."""
    places = getattr(model, "actuator_ctrladr", None)  # MuJoCo 3.11 has none
    return actuator if places is None else int(places[actuator])


def turning(model: Model) -> list[int]:
    """Return the numbers of all hinges and slides."""
    return [joint for joint in range(model.njnt) if turns(model, joint)]


def turns(model: Model, joint: int) -> bool:
    """Whether it is a hinge or a slide."""
    kinds = (int(mj.mjtJoint.mjJNT_HINGE), int(mj.mjtJoint.mjJNT_SLIDE))
    return int(model.jnt_type[joint]) in kinds


def joints(model: Model) -> dict[str, int]:
    """Return the numbers of all hinges and slides by name."""
    return {name_of(model, "joint", joint): joint for joint in turning(model)}


def floats(model: Model) -> bool:
    """Whether its first joint is free."""
    return bool(model.njnt) and int(model.jnt_type[0]) == 0  # mjJNT_FREE


def stands_free(model: Model) -> bool:
    """Whether its first joint is free, and there is a floor to stand on."""
    return floats(model) and bool(floors(model))


def raise_base(model: Model, data: Data, height_m: float) -> None:
    """Lift what floats; call before the next step."""
    data.qpos[model.jnt_qposadr[model.jnt_type == mj.mjtJoint.mjJNT_FREE] + 2] += height_m


def hold_base(model: Model) -> None:
    """Give a floating base the inertia of a hill, in a model that may be changed: see `HELD_KG`."""
    free = np.flatnonzero(model.jnt_type == mj.mjtJoint.mjJNT_FREE)
    model.dof_armature[np.isin(model.dof_jntid, free)] = HELD_KG


def held_but(model: Model, joints: Collection[int]) -> None:
    """Give everything but these hinges and slides that inertia, so that it stands still."""
    model.dof_armature[~np.isin(model.dof_jntid, [*joints])] = HELD_KG


def above(model: Model, body: int) -> set[int]:
    """A body and all that it is on."""
    bodies = {body}
    while body:
        body = int(model.body_parentid[body])
        bodies.add(body)
    return bodies


def below(model: Model, top: int) -> set[int]:
    """A body and all that is on it."""
    bodies = {top}
    for body in range(top + 1, model.nbody):
        if int(model.body_parentid[body]) in bodies:
            bodies.add(body)
    return bodies


def contact_solver(model: Model) -> dict[str, object]:
    """How a model wants contacts solved, by MuJoCo's words."""
    cone = "elliptic" if int(model.opt.cone) else "pyramidal"
    return {"cone": cone, "impratio": float(model.opt.impratio)}


# --- shapes -------------------------------------------------------------------------------------


def floors(model: Model) -> list[int]:
    """Planes of the world and of what is fixed to it, as a robot brings those of its source."""
    planes = model.geom_type == int(mj.mjtGeom.mjGEOM_PLANE)
    return [int(i) for i in np.flatnonzero(planes & (model.body_weldid[model.geom_bodyid] == 0))]


def floor_contacts(model: Model, data: Data) -> list[tuple[int, int]]:
    """(number of the contact, the robot's geom in it) of contacts with a floor."""
    geoms = data.contact.geom[: data.ncon]
    in_floor = np.isin(geoms, floors(model))
    touching = np.flatnonzero(in_floor[:, 0] != in_floor[:, 1])
    ours = geoms[touching, in_floor[touching, 0].astype(int)]
    return list(zip(touching.tolist(), ours.tolist(), strict=True))


def collision_geoms(model: Model) -> list[int]:
    """Geoms of the robot that can touch something, without the floors that it brings."""
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    solid[floors(model)] = False
    return [int(i) for i in np.flatnonzero(solid & (model.geom_bodyid != 0))]


def outlines(model: Model, data: Data, geoms: Iterable[int], most: int | None = None) -> Array:
    """(n, 3) points in the world, m: vertices of meshes, corners of the boxes of other shapes.

    most: vertices of each mesh, evenly chosen; None = all.
    """
    points = [np.zeros((0, 3))]
    for geom in geoms:
        mesh = int(model.geom_dataid[geom])
        if int(model.geom_type[geom]) == int(mj.mjtGeom.mjGEOM_MESH) and mesh >= 0:
            first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
            step = 1 + count // most if most else 1
            local = np.array(model.mesh_vert[first : first + count : step])
        else:
            middle, half = np.array(model.geom_aabb[geom]).reshape(2, 3)
            local = middle + half * np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
        R = np.array(data.geom_xmat[geom]).reshape(3, 3)
        points.append(local @ R.T + np.array(data.geom_xpos[geom]))
    return np.concatenate(points)
