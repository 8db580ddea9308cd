"""Full effort against what holds a joint in MuJoCo: its limits, and the joint that it follows.

Without gravity and contacts, the base held. The load grows slowly, so that nothing is thrown.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from assetbuild.robot.pose import Array
from assetbuild.simulators.mujoco import (
    Data,
    Model,
    at_key,
    caught_warnings,
    is_finite,
    name_of,
    without,
)
from assetbuild.simulators.mujoco.drives import aim
from assetbuild.simulators.mujoco.hands import held_but
from assetbuild.simulators.mujoco.trials import hold_base

RISE_S, HOLD_S = 0.2, 0.3
"""The load grows to the full effort, then stays."""


@dataclass(frozen=True)
class Pushed:
    """How far full effort moved a joint from where it is held, rad or m; nan: unstable."""

    joint: str
    slides: bool
    effort: float
    error: float


def past_limits(model: Model, efforts: Mapping[str, float]) -> Iterator[Pushed]:
    """Each joint with limits and an effort, at both of them, the drives holding it there.

    efforts: by joint, N m or N. All joints are pushed at once: the limit of each feels its own
    load alone.
    """
    model = _alone(without(model, "CONTACT"))
    model.eq_active0[_loops(model)] = 0  # not all of a loop's joints can be at their limits
    joints = [j for j in _named(model, efforts) if model.jnt_limited[j]]
    worst = np.zeros(model.njnt)
    for side in (0, 1) if joints else ():
        data, load = at_key(model), np.zeros(model.nv)
        for joint in joints:
            data.qpos[model.jnt_qposadr[joint]] = model.jnt_range[joint, side]
            sign = 1.0 if side else -1.0
            load[model.jnt_dofadr[joint]] = sign * efforts[name_of(model, "joint", joint)]
        _lead(model, data, load)
        aim(model, data)
        for position in _under(model, data, load):
            beyond = position[model.jnt_qposadr] - model.jnt_range[:, side]
            worst = np.maximum(worst, beyond if side else -beyond)
    yield from (_pushed(model, joint, efforts, worst[joint]) for joint in joints)


def off_couplings(model: Model, efforts: Mapping[str, float]) -> Iterator[Pushed]:
    """Each joint that follows another or is locked; the leader's effort works against it.

    efforts: by joint; of a follower, what its leader brings there.
    """
    model = _alone(without(model, "CONTACT", "LIMIT", "ACTUATION"))
    for index in _couplings(model):
        follower, leader = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
        effort = efforts.get(name_of(model, "joint", follower), 0.0)
        if not effort > 0.0:
            continue
        offset, gear = (float(v) for v in model.eq_data[index, :2])
        data, load, worst = at_key(model), np.zeros(model.nv), 0.0
        load[model.jnt_dofadr[follower]] = effort
        if leader >= 0:
            load[model.jnt_dofadr[leader]] = -gear * effort
        for position in _under(model, data, load):
            led = position[model.jnt_qposadr[leader]] if leader >= 0 else 0.0
            off = position[model.jnt_qposadr[follower]] - offset - gear * led
            worst = max(worst, abs(float(off))) if np.isfinite(off) else float("nan")
        yield _pushed(model, follower, efforts, worst)


def open_loops(model: Model, efforts: Mapping[str, float]) -> Iterator[Pushed]:
    """Each closed loop while drives push with their effort, one way and the other.

    All other joints are blocked, so that the loops carry it. efforts: of drives, by joint. The
    error is how far the two points of a loop part, m.
    """
    import mujoco

    model = _alone(without(model, "CONTACT", "ACTUATION", "LIMIT"))
    driven = _named(model, efforts)
    held_but(model, driven)
    worst, load = dict.fromkeys(_loops(model), 0.0), np.zeros(model.nv)
    for joint in driven:
        load[model.jnt_dofadr[joint]] = efforts[name_of(model, "joint", joint)]
    for sign in (-1.0, 1.0) if worst and driven else ():
        data = at_key(model)
        mujoco.mj_forward(model, data)
        open_at_home = {index: _gap(data, index) for index in worst}
        for position in _under(model, data, sign * load):
            for index, most in worst.items():
                gap = _gap(data, index) if np.isfinite(position).all() else float("nan")
                worst[index] = float(np.maximum(most, gap - open_at_home[index]))
    for index, error in worst.items():
        yield Pushed(f"loop {name_of(model, 'equality', index)}", True, float(load.max()), error)


def _gap(data: Data, equality: int) -> float:
    """Distance of the two points of a `connect` or `weld`, m."""
    import mujoco

    rows = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    mine = np.flatnonzero(rows & (data.efc_id == equality))[:3]
    return float(np.linalg.norm(data.efc_pos[mine]))


def _alone(model: Model) -> Model:
    """Without gravity, the base held; for a model that may be changed."""
    hold_base(model)
    model.opt.gravity[:] = 0.0
    return model


def _named(model: Model, efforts: Mapping[str, float]) -> list[int]:
    return [
        joint
        for joint in range(model.njnt)
        if int(model.jnt_type[joint]) in (2, 3)  # slide, hinge
        and efforts.get(name_of(model, "joint", joint), 0.0) > 0.0
    ]


def _couplings(model: Model) -> list[int]:
    import mujoco

    held = (model.eq_type == mujoco.mjtEq.mjEQ_JOINT) & (model.eq_active0 != 0)
    return [int(index) for index in np.flatnonzero(held)]


def _loops(model: Model) -> list[int]:
    import mujoco

    kinds = (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD))
    closed = np.isin(model.eq_type, kinds) & (model.eq_active0 != 0)
    return [int(index) for index in np.flatnonzero(closed)]


def _lead(model: Model, data: Data, load: Array) -> None:
    """Put followers where their leaders are, and take the load off them: it is the leader's."""
    for index in _couplings(model):
        follower, leader = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
        offset, gear = model.eq_data[index, :2]
        led = data.qpos[model.jnt_qposadr[leader]] if leader >= 0 else 0.0
        data.qpos[model.jnt_qposadr[follower]] = offset + gear * led
        load[model.jnt_dofadr[follower]] = 0.0


def _under(model: Model, data: Data, load: Array) -> Iterator[Array]:
    """qpos after each step while the load grows and stays."""
    import mujoco

    step = float(model.opt.timestep)
    with caught_warnings():
        for index in range(round((RISE_S + HOLD_S) / step)):
            data.qfrc_applied[:] = load * min(1.0, (index + 1) * step / RISE_S)
            mujoco.mj_step(model, data)
            if not is_finite(data):  # MuJoCo starts again from its default pose
                yield np.full(model.nq, np.nan)
                return
            yield data.qpos


def _pushed(model: Model, joint: int, efforts: Mapping[str, float], error: float) -> Pushed:
    name = name_of(model, "joint", joint)
    return Pushed(name, int(model.jnt_type[joint]) == 2, efforts[name], float(error))
