"""MuJoCo as checks use it: load, look, drop. Versions 3.11 to 4.

MuJoCo's own warnings are caught: without a handler they go to a log file in the working folder.
"""

from __future__ import annotations

import copy
import itertools
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from assetbuild.errors import StepError, one_line
from assetbuild.kinds import Check
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import Array, rotation_of

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


class InMujoco(Check):
    """Base of the checks that simulate the MJCF."""

    isolated: ClassVar[bool] = True
    preload: ClassVar[tuple[str, ...]] = ("mujoco",)
    needs: ClassVar[tuple[str, ...]] = ("mjcf",)
    engines: ClassVar[tuple[str, ...]] = ("mujoco",)


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
    for target, path in (
        ("mjcf", inputs / "mjcf" / f"{stem}.xml"),
        ("mjx", inputs / "mjx" / f"{stem}_mjx.xml"),
    ):
        if path.is_file():
            yield target, path


def full_and_mjx_models(
    inputs: Path, stem: str, figures: dict[str, object]
) -> Iterator[tuple[str, Path, Model]]:
    """(target, file, its model); of a file that does not load the figures say so."""
    for target, path in full_and_mjx(inputs, stem):
        try:
            model = load(path, visuals=False).model
        except StepError as error:  # `mjcf.load` reports it
            figures[target] = {"skipped": error.message}
            continue
        yield target, path, model


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
    """Collects what MuJoCo warns about meanwhile, in order.

    ArenaFullError where its memory did not suffice; StepError where MuJoCo gave up otherwise.
    """
    import mujoco

    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(said.append)
    try:
        with warnings.catch_warnings(record=True) as from_python:
            warnings.simplefilter("always")
            yield said
        said += [str(item.message) for item in from_python]
    except mujoco.FatalError as error:
        _refuse_full([str(error)])
        raise StepError(f"MuJoCo gave up: {one_line(error)}") from None
    finally:
        mujoco.set_mju_user_warning(before)
    _refuse_full(said)


def _refuse_full(said: list[str]) -> None:
    for text in said:
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


def initial_key(model: Model) -> int | None:
    """The keyframe `home`, else the first; None without any. See `robot.initial`."""
    import mujoco

    home = int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, "home"))
    return max(home, 0) if model.nkey else None


def at_key(model: Model, key: int | None = None) -> Data:
    """A keyframe with its controls; without `key` the initial pose, see `robot.initial`."""
    import mujoco

    data = mujoco.MjData(model)
    key = initial_key(model) if key is None else key
    if key is None:
        _stand_within_limits(model, data)
    else:
        mujoco.mj_resetDataKeyframe(model, data, key)
    mujoco.mj_forward(model, data)
    return data


def _stand_within_limits(model: Model, data: Data) -> None:
    """Every joint as near to its zero as its limits allow, and those that follow others there.

    Position servos hold that pose.
    """
    import mujoco

    turning = np.isin(model.jnt_type, (2, 3))  # slide, hinge
    limited = np.flatnonzero(turning & (model.jnt_limited != 0))
    at, (lower, upper) = model.jnt_qposadr[limited], model.jnt_range[limited].T
    data.qpos[at] = np.clip(data.qpos[at], lower, upper)
    follow(model, data)
    mujoco.mj_forward(model, data)
    gain, bias = model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 1]
    servos = np.flatnonzero((gain > 0.0) & (bias < 0.0))
    data.ctrl[servos] = -bias[servos] / gain[servos] * data.actuator_length[servos]


def follow(model: Model, data: Data) -> None:
    """Joints that an equality couples to another take the position that it asks for."""
    import mujoco

    for index in np.flatnonzero(model.eq_type == mujoco.mjtEq.mjEQ_JOINT):
        follower, leader = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
        x = 0.0
        if leader >= 0:
            at = int(model.jnt_qposadr[leader])
            x = float(data.qpos[at] - model.qpos0[at])
        at = int(model.jnt_qposadr[follower])
        terms = model.eq_data[index, :5]
        data.qpos[at] = model.qpos0[at] + sum(float(c) * x**n for n, c in enumerate(terms))


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


def actuators(model: Model) -> range:
    """Their numbers; `nu` counts commands, of which an actuator has several in MuJoCo 4."""
    return range(len(model.actuator_trntype))


def first_command(model: Model, actuator: int) -> int:
    """The place of an actuator's command in `data.ctrl`, of the first of several."""
    places = getattr(model, "actuator_ctrladr", None)  # MuJoCo 3.11 has none
    return actuator if places is None else int(places[actuator])


def turning(model: Model) -> list[int]:
    """Hinges and slides."""
    import mujoco

    kinds = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    return [joint for joint in range(model.njnt) if int(model.jnt_type[joint]) in kinds]


def floats(model: Model) -> bool:
    """Whether its first joint is free."""
    return bool(model.njnt) and int(model.jnt_type[0]) == 0  # mjJNT_FREE


def raise_base(model: Model, data: Data, height_m: float) -> None:
    """Lift what floats; call before the next step."""
    import mujoco

    for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
        data.qpos[int(model.jnt_qposadr[joint]) + 2] += height_m


def contact_solver(model: Model) -> dict[str, object]:
    """How a model wants contacts solved, by MuJoCo's words."""
    cone = "elliptic" if int(model.opt.cone) else "pyramidal"
    return {"cone": cone, "impratio": float(model.opt.impratio)}


# --- shapes -------------------------------------------------------------------------------------


def floors(model: Model) -> list[int]:
    """Planes of the world."""
    import mujoco

    planes = model.geom_type == int(mujoco.mjtGeom.mjGEOM_PLANE)
    return [int(i) for i in np.flatnonzero(planes & (model.geom_bodyid == 0))]


def floor_contacts(model: Model, data: Data) -> list[tuple[int, int]]:
    """(number of the contact, the robot's geom in it) of contacts with a floor."""
    pairs = np.array(data.contact.geom[: data.ncon]).reshape(-1, 2)
    is_floor = np.isin(pairs, floors(model))
    touching = np.flatnonzero(is_floor.sum(axis=1) == 1)
    return [(int(i), int(pairs[i][~is_floor[i]][0])) for i in touching]


def collision_geoms(model: Model) -> list[int]:
    """Geoms of the robot that can touch something."""
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    return [int(i) for i in np.flatnonzero(solid & (model.geom_bodyid != 0))]


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


def touching_geoms(model: Model) -> Iterator[tuple[int, int]]:
    """Pairs of geoms that masks, excludes and MuJoCo's own filter let touch."""
    excluded = {int(signature) for signature in model.exclude_signature}
    solid = [i for i in range(model.ngeom) if model.geom_contype[i] or model.geom_conaffinity[i]]
    for a, b in itertools.combinations(solid, 2):
        first, second = sorted((int(model.geom_bodyid[a]), int(model.geom_bodyid[b])))
        if (first << 16) + second in excluded or passes(model, first, second):
            continue
        mask = model.geom_contype[a] & model.geom_conaffinity[b]
        if mask | (model.geom_contype[b] & model.geom_conaffinity[a]):
            yield a, b


def explicit_pairs(model: Model) -> Iterator[tuple[int, int]]:
    """Pairs of geoms that touch whatever filters say: the elements `<pair>`."""
    for index in range(model.npair):
        yield int(model.pair_geom1[index]), int(model.pair_geom2[index])
