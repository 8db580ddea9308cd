"""A gripper that closes on an object, lifts it and is shaken, in MuJoCo.

The hand stands still and points down; a table below it goes away instead of the hand going up.
Gravity points where the fingers point, and shakes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from assetbuild.errors import StepError
from assetbuild.robot.pose import Array
from assetbuild.simulators.mujoco import Data, Model, caught_warnings, is_finite, without
from assetbuild.simulators.mujoco_hands import Hand, held_but, solid_geoms, vertices

Shape = Literal["cube", "cylinder", "sphere"]
SHAPES: tuple[Shape, ...] = ("cube", "cylinder", "sphere")
WIDTH_M, LEAST_WIDTH_M = 0.04, 0.008
"""Of a cube, and diameter of a sphere and of a cylinder, which is one and a half times as tall;
less where the hand does not open so far."""
CLOSE_S, LIFT_S, SHAKE_S, HOLD_S = 1.0, 1.5, 1.0, 5.0
RAMP = 0.75
"""Share of the time to close in which the command gets there."""
LIFT_M = 0.2
SHAKE_G, SHAKE_HZ = 0.3, 3.0
"""The shaking in times gravity, in all three directions one after the other."""
FRICTION = 1.0
"""Of the object and of the fingers."""
BEYOND_M = 0.005
"""The object reaches so far beyond the fingertips."""
OPEN = 0.1
"""Share of its travel that the hand is more open at the start than the object needs."""
DEPTHS, PLACES, ASIDE, EVERY = 4, 31, 1.5, 2
"""Where the object is tried, along the fingers and across them, to so many times its width, in
every second pose."""
TABLE_M, G = 0.02, 9.81
_OBJECT, _TABLE = "gripped object", "table below the object"
_TABLE_BIT = 1 << 30


@dataclass(frozen=True)
class Grip:
    """How an object was held. width_m: of the object. force_n: mean normal force of both sides.

    slip_m: how far it moved along the fingers that hold it, on average, from when they had closed.
    held: whether it was in the hand at the end.
    """

    shape: Shape
    mass: float
    width_m: float
    slip_m: float = math.nan
    forces_n: tuple[float, float] = (0.0, 0.0)
    held: bool = False


def with_object(path: Path) -> Model:
    """The robot of an MJCF with an object that floats and a table, both far away."""
    import mujoco

    spec = mujoco.MjSpec.from_file(str(path))
    spec.compiler.discardvisual = True
    for key in spec.keys:
        if len(key.qpos):
            key.qpos = np.append(key.qpos, (0.0, 0.0, 50.0, 1.0, 0.0, 0.0, 0.0))
    body = spec.worldbody.add_body(name=_OBJECT, pos=(0.0, 0.0, 50.0))
    body.add_freejoint(name=_OBJECT)
    body.mass, body.inertia, body.explicitinertial = 1.0, (1.0, 1.0, 1.0), True
    body.ipos, body.iquat = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    body.add_geom(
        name=_OBJECT,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=(WIDTH_M, WIDTH_M, WIDTH_M),
        contype=1 | _TABLE_BIT,
        conaffinity=1,
        condim=4,
    )
    table = spec.worldbody.add_body(name=_TABLE, mocap=True, pos=(0.0, 0.0, 60.0))
    table.add_geom(
        name=_TABLE,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=(0.5, 0.5, TABLE_M),
        contype=0,
        conaffinity=_TABLE_BIT,
    )
    with caught_warnings():
        try:
            return spec.compile()
        except ValueError as error:
            raise StepError(str(error)) from None


def probe_of(model: Model) -> int:
    """The geom of the object."""
    return int(model.geom(_OBJECT).id)


def grip(model: Model, hand: Hand, shape: Shape, mass: float) -> Grip | None:
    """Close on an object, lift, shake and hold it; None where none fits between the fingers.

    model: of `with_object`. mass: kg.
    """
    model = without(model)
    fitted = _fit(model, hand, shape)
    if fitted is None:
        return None
    width, place = fitted
    with caught_warnings():
        _give_mass(model, shape, width, mass)
        return _hold(model, hand, Grip(shape, mass, width), place)


@dataclass(frozen=True)
class _Place:
    """Where an object is gripped. start: number of the pose from which the hand closes.

    xyz: (3,) of its centre. R: (3, 3) its axes in the world as columns: x across the hand, z back
    to the palm.
    """

    start: int
    xyz: Array
    R: Array

    @property
    def down(self) -> Array:
        """(3,) world direction in which the fingers point."""
        down: Array = -self.R[:, 2]
        return down


def _half(shape: Shape, width: float) -> Array:
    """Half sizes of an object."""
    return np.array((0.5, 0.5, 0.75 if shape == "cylinder" else 0.5)) * width


def _resize(model: Model, shape: Shape, width: float) -> None:
    import mujoco

    kinds = mujoco.mjtGeom
    geom, half = probe_of(model), _half(shape, width)
    kind = {
        "cube": kinds.mjGEOM_BOX,
        "cylinder": kinds.mjGEOM_CYLINDER,
        "sphere": kinds.mjGEOM_SPHERE,
    }
    model.geom_type[geom] = int(kind[shape])
    model.geom_size[geom] = (
        half if shape == "cube" else (half[0], half[2] if shape == "cylinder" else 0.0, 0.0)
    )


def _give_mass(model: Model, shape: Shape, width: float, mass: float) -> None:
    """Of a homogeneous object, m: width."""
    import mujoco

    body = int(model.body(_OBJECT).id)
    full = 2.0 * _half(shape, width)
    if shape == "cube":
        inertia = mass / 6.0 * np.full(3, full[0] ** 2)
    elif shape == "sphere":
        inertia = 0.1 * mass * np.full(3, full[0] ** 2)
    else:
        side = mass * (3.0 * (full[0] / 2.0) ** 2 + full[2] ** 2) / 12.0
        inertia = np.array((side, side, mass * full[0] ** 2 / 8.0))
    model.body_mass[body], model.body_inertia[body] = mass, inertia
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _fit(model: Model, hand: Hand, shape: Shape) -> tuple[float, _Place] | None:
    """The largest object up to `WIDTH_M` that is between the fingers where they touch it on both
    sides: (its width, its place); None where none is.
    """
    width = WIDTH_M
    while width > LEAST_WIDTH_M:
        _resize(model, shape, width)
        half = _half(shape, width)
        for out in np.linspace(0.0, half[2], DEPTHS):
            for index in range(len(hand.poses) - 1, -1, -EVERY):
                place = _room(model, hand, index, half, float(out))
                if place is not None:
                    return width, place
        width *= 0.7
    return None


def _room(model: Model, hand: Hand, index: int, half: Array, out: float) -> _Place | None:
    """A place between the fingers in a pose where the object touches nothing.

    out: m, less deep in the hand than can be.
    """
    import mujoco

    data, along, across = _state(model, hand.poses[index]), hand.along[index], hand.across[index]
    R = np.column_stack([across, np.cross(across, along), -along])
    deepest = min(float((vertices(model, data, side) @ along).max()) for side in hand.sides)
    middle = hand.tips[index] + (deepest + BEYOND_M - half[2] + out) * along
    middle = middle - (hand.tips[index] @ along) * along
    places = middle + np.linspace(-ASIDE, ASIDE, PLACES)[:, None] * 2.0 * half[0] * across
    touched = []
    for place in places:
        _put(model, data, place, R)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        touched.append(_touched(model, data, hand))
    between = _between(touched)
    if between is None:
        return None
    return _Place(max(0, index - round(OPEN * len(hand.poses))), places[between], R)


def _touched(model: Model, data: Data, hand: Hand) -> int | None:
    """What the object lies in: a side by its number, -1 for both or other bodies; None: nothing."""
    pairs = [c.geom for c in _contacts(model, data) if c.dist < 0.0]
    bodies = {int(b) for pair in pairs for b in model.geom_bodyid[pair]} - {
        int(model.body(_OBJECT).id)
    }
    for number, side in enumerate(hand.sides):
        if bodies and bodies <= set(side):
            return number
    return -1 if bodies else None


def _between(touched: Sequence[int | None]) -> int | None:
    """The middle of places in a row that touch nothing, with a side before and the other behind."""
    free: list[int] = []
    before: int | None = None
    for index, what in enumerate(touched):
        if what is None:
            free.append(index)
            continue
        if free and (before, what) == (0, 1):
            return free[len(free) // 2]
        free, before = [], what
    return None


def _hold(model: Model, hand: Hand, grip: Grip, place: _Place) -> Grip:
    """Close from a pose on an object at a place, lift, shake and hold it."""
    import mujoco

    held_but(model, hand.fingers)
    model.geom_friction[solid_geoms(model, [b for side in hand.sides for b in side]), 0] = FRICTION
    data, step = _state(model, hand.poses[place.start]), float(model.opt.timestep)
    _put(model, data, place.xyz, place.R)
    table, below = int(model.body(_TABLE).mocapid[0]), float(_half(grip.shape, grip.width_m)[2])
    mujoco.mju_mat2Quat(data.mocap_quat[table], place.R.ravel())
    pressing, before, forces = [0, 0], np.zeros((2, 3)), []
    total = CLOSE_S + LIFT_S + SHAKE_S + HOLD_S
    start, end = hand.targets[place.start], hand.targets[-1]
    for index in range(round(total / step)):
        time = index * step
        closed = min(1.0, time / (RAMP * CLOSE_S))
        for drive, target in zip(hand.drives, start + closed * (end - start), strict=True):
            data.ctrl[drive.ctrl_index] = drive.command(float(target))
        lifted = LIFT_M * min(1.0, max(0.0, (time - CLOSE_S) / LIFT_S))
        data.mocap_pos[table] = place.xyz + (below + TABLE_M + lifted) * place.down
        model.opt.gravity[:] = G * (place.down + place.R @ _shaking(time - CLOSE_S - LIFT_S))
        mujoco.mj_step(model, data)
        if time >= CLOSE_S and not before.any():
            pressing = _pressing(model, data, hand)
            before = _seen_from(data, pressing)
        if time > total - 1.0:
            by_body = _forces(model, data)
            forces.append([sum(by_body.get(b, 0.0) for b in side) for side in hand.sides])
    slips = np.linalg.norm(_seen_from(data, pressing) - before, axis=1)
    fell = np.linalg.norm(data.body(_OBJECT).xpos - place.xyz) > LIFT_M / 2.0
    one, other = (float(force) for force in np.mean(forces, axis=0))
    return replace(
        grip,
        slip_m=float(slips.mean()),
        forces_n=(one, other),
        held=bool(is_finite(data) and not fell and min(one, other) > 0.0),
    )


def _shaking(time: float) -> Array:
    """(3,) acceleration in times gravity: along each axis of the object, one after the other."""
    if not 0.0 <= time < SHAKE_S:
        return np.zeros(3)
    axis = int(3.0 * time / SHAKE_S)
    shaken: Array = SHAKE_G * math.sin(2.0 * math.pi * SHAKE_HZ * time) * np.eye(3)[axis]
    return shaken


def _state(model: Model, pose: Array) -> Data:
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[:] = pose
    mujoco.mj_forward(model, data)
    return data


def _put(model: Model, data: Data, xyz: Array, R: Array) -> None:
    import mujoco

    at = int(model.joint(_OBJECT).qposadr[0])
    data.qpos[at : at + 3] = xyz
    mujoco.mju_mat2Quat(data.qpos[at + 3 : at + 7], R.ravel())


def _contacts(model: Model, data: Data) -> list[Any]:  # Any: mujoco.MjContact
    """Contacts of the object with the robot."""
    geom, table = probe_of(model), int(model.geom(_TABLE).id)
    return [c for c in data.contact[: data.ncon] if geom in c.geom and table not in c.geom]


def _forces(model: Model, data: Data) -> dict[int, float]:
    """Sum of the normal forces of each body of the robot on the object, N."""
    import mujoco

    geom, force, sums = probe_of(model), np.zeros(6), dict[int, float]()
    for index in range(data.ncon):
        pair = [int(g) for g in data.contact[index].geom]
        if geom in pair:
            other = int(model.geom_bodyid[pair[int(pair[0] == geom)]])
            mujoco.mj_contactForce(model, data, index, force)
            sums[other] = sums.get(other, 0.0) + float(force[0])
    return sums


def _pressing(model: Model, data: Data, hand: Hand) -> list[int]:
    """Of each side the body that presses most."""
    forces = _forces(model, data)
    return [max(side, key=lambda body: forces.get(body, 0.0)) for side in hand.sides]


def _seen_from(data: Data, bodies: Sequence[int]) -> Array:
    """(n, 3) place of the object in the frames of bodies."""
    at = np.array(data.body(_OBJECT).xpos)
    return np.array([data.xmat[body].reshape(3, 3).T @ (at - data.xpos[body]) for body in bodies])
