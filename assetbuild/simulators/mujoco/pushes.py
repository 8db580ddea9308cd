"""Full effort against what holds a joint in MuJoCo: its limits, and the joint that it follows.

Without gravity and contacts, the base held. The load grows slowly, so that nothing is thrown.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from assetbuild.robot.pose import Array
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import Data, Model, mj
from assetbuild.simulators.mujoco.drives import aim

RISE_S, HOLD_S = 0.2, 0.3
"""The load grows to the full effort, then stays."""
JOINT, LOOP = ("JOINT",), ("CONNECT", "WELD")
"""Kinds of equalities: couplings of joints, and closed loops."""


@dataclass(frozen=True)
class Pushed:
    """How far full effort moved a joint from where it is held, rad or m; nan: unstable."""

    joint: str
    slides: bool
    error: float


def past_limits(model: Model, efforts: Mapping[str, float]) -> Iterator[Pushed]:
    """Each joint with limits and an effort, at both of them, the drives holding it there.

    efforts: by joint, N m or N. All joints are pushed at once: the limit of each feels its own
    load alone.
    """
    model = _alone(model, "CONTACT")
    model.eq_active0[_active(model, LOOP)] = 0  # not all of a loop's joints can be at their limits
    pushed = {j: effort for j, effort in _loaded(model, efforts).items() if model.jnt_limited[j]}
    joints, worst = list(pushed), np.zeros(len(pushed))
    at, limits = model.jnt_qposadr[joints], model.jnt_range[joints]
    for side, sign in ((0, -1.0), (1, 1.0)) if joints else ():
        data, load = mujoco.at_key(model), np.zeros(model.nv)
        data.qpos[at] = limits[:, side]
        load[model.jnt_dofadr[joints]] = sign * np.array([*pushed.values()])
        _lead(model, data, load)
        aim(model, data)
        for position in _under(model, data, load):
            worst = np.maximum(worst, sign * (position[at] - limits[:, side]))
    for joint, error in zip(joints, worst, strict=True):
        yield _pushed(model, joint, float(error))


def off_couplings(model: Model, efforts: Mapping[str, float]) -> Iterator[Pushed]:
    """Each joint that follows another or is locked; the leader's effort works against it.

    efforts: by joint; of a follower, what its leader brings there.
    """
    model = _alone(model, "CONTACT", "LIMIT", "ACTUATION")
    pushed = _loaded(model, efforts)
    for index in _active(model, JOINT):
        follower, leader, offset, gear = _coupling(model, index)
        if follower not in pushed:
            continue
        data, load, worst = mujoco.at_key(model), np.zeros(model.nv), 0.0
        load[model.jnt_dofadr[follower]] = pushed[follower]
        if leader >= 0:
            load[model.jnt_dofadr[leader]] = -gear * pushed[follower]
        for position in _under(model, data, load):
            led = position[model.jnt_qposadr[leader]] if leader >= 0 else 0.0
            off = position[model.jnt_qposadr[follower]] - offset - gear * led
            worst = float(np.maximum(worst, abs(off)))
        yield _pushed(model, follower, worst)


def open_loops(model: Model, efforts: Mapping[str, float]) -> Iterator[Pushed]:
    """Each closed loop while drives push with their effort, one way and the other.

    All other joints are blocked, so that the loops carry it. efforts: of drives, by joint. The
    error is how far the two points of a loop part, m.
    """
    model = _alone(model, "CONTACT", "ACTUATION", "LIMIT")
    pushed, loops = _loaded(model, efforts), _active(model, LOOP)
    mujoco.held_but(model, pushed)
    worst, load = np.zeros(len(loops)), np.zeros(model.nv)
    load[model.jnt_dofadr[[*pushed]]] = [*pushed.values()]
    for sign in (-1.0, 1.0) if loops and pushed else ():
        data = mujoco.at_key(model)
        mj.mj_forward(model, data)
        at_home = _gaps(data, loops)
        for position in _under(model, data, sign * load):
            opened = _gaps(data, loops) - at_home if np.isfinite(position).all() else math.nan
            worst = np.maximum(worst, opened)
    for index, error in zip(loops, worst, strict=True):
        yield Pushed(f"loop {mujoco.name_of(model, 'equality', index)}", True, float(error))


def _gaps(data: Data, loops: list[int]) -> Array:
    """Distance of the two points of each `connect` or `weld`, m."""
    rows = data.efc_type == int(mj.mjtConstraint.mjCNSTR_EQUALITY)
    places = [np.flatnonzero(rows & (data.efc_id == index))[:3] for index in loops]
    return np.array([np.linalg.norm(data.efc_pos[place]) for place in places])


def _alone(model: Model, *flags: str) -> Model:
    """A copy without gravity and some of MuJoCo's features, the base held."""
    model = mujoco.without(model, *flags)
    mujoco.hold_base(model)
    model.opt.gravity[:] = 0.0
    return model


def _loaded(model: Model, efforts: Mapping[str, float]) -> dict[int, float]:
    """Effort by number of the hinges and slides that have one."""
    found = mujoco.joints(model)
    return {joint: efforts[name] for name, joint in found.items() if efforts.get(name, 0.0) > 0.0}


def _active(model: Model, kinds: tuple[str, ...]) -> list[int]:
    numbers = [int(getattr(mj.mjtEq, f"mjEQ_{kind}")) for kind in kinds]
    return np.flatnonzero(np.isin(model.eq_type, numbers) & (model.eq_active0 != 0)).tolist()


def _coupling(model: Model, equality: int) -> tuple[int, int, float, float]:
    """(follower, leader or -1, offset, multiplier)."""
    offset, gear = (float(value) for value in model.eq_data[equality, :2])
    return int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality]), offset, gear


def _lead(model: Model, data: Data, load: Array) -> None:
    """Put followers where their leaders are, and take the load off them: it is the leader's."""
    for index in _active(model, JOINT):
        follower, leader, offset, gear = _coupling(model, index)
        led = data.qpos[model.jnt_qposadr[leader]] if leader >= 0 else 0.0
        data.qpos[model.jnt_qposadr[follower]] = offset + gear * led
        load[model.jnt_dofadr[follower]] = 0.0


def _under(model: Model, data: Data, load: Array) -> Iterator[Array]:
    """qpos after each step while the load grows and stays."""
    step = float(model.opt.timestep)
    with mujoco.caught_warnings():
        for index in range(round((RISE_S + HOLD_S) / step)):
            data.qfrc_applied[:] = load * min(1.0, (index + 1) * step / RISE_S)
            mj.mj_step(model, data)
            if not mujoco.is_finite(data):  # MuJoCo starts again from its default pose
                yield np.full(model.nq, np.nan)
                return
            yield data.qpos


def _pushed(model: Model, joint: int, error: float) -> Pushed:
    return Pushed(mujoco.name_of(model, "joint", joint), int(model.jnt_type[joint]) == 2, error)
