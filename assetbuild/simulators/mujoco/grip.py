"""A gripper that closes on an object, lifts it and is shaken, in MuJoCo.

The hand stands still and points down; a table below it goes away instead of the hand going up.
Gravity points where the fingers point, and shakes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from assetbuild.robot.pose import Array
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import Data, Model, mj
from assetbuild.simulators.mujoco.hands import (
    OBJECT,
    Hand,
    at_pose,
    between_keys,
    find_hands,
    solid_geoms,
)

Shape = Literal["cube", "cylinder", "sphere"]
SHAPES: tuple[Shape, ...] = ("cube", "cylinder", "sphere")
WIDTH_M, LEAST_WIDTH_M = 0.04, 0.008
"""A cube is this wide, a sphere this thick, and so is a cylinder, which is one and a half times as
tall; less where the hand does not open so far."""
CLOSE_S, LIFT_S, SHAKE_S, HOLD_S = 1.0, 1.5, 1.0, 5.0
TOTAL_S = CLOSE_S + LIFT_S + SHAKE_S + HOLD_S
RAMP = 0.75
"""Share of the time to close in which the command gets there."""
LIFT_M = 0.2
SHAKE_G, SHAKE_HZ = 0.3, 3.0
"""The shaking in times gravity, in all three directions one after the other."""
FRICTION = 1.0
"""The object and the fingers have it."""
BEYOND_M = 0.005
"""The object reaches so far beyond the fingertips."""
OPEN = 0.1
"""Share of its travel that the hand is more open at the start than the object needs."""
SMALLER = 0.7
"""Times the width that did not fit, the next one."""
DEPTHS, PLACES, ASIDE, EVERY = 4, 31, 1.5, 2
"""An object is tried at so many depths and at so many places across the hand, which reach to so
many times its width on both sides, in every second pose."""
TABLE_M, G = 0.02, 9.81
_TABLE = "table below the object"
_TABLE_BIT = 1 << 30


@dataclass(frozen=True)
class Place:
    """An object between open fingers. width_m: see `WIDTH_M`.

    start: number of the hand's pose from which it closes. xyz: (3,) of the object's centre.
    R: (3, 3) its axes in the world as columns: x across the hand, z back to the palm.
    """

    shape: Shape
    width_m: float
    start: int
    xyz: Array
    R: Array

    @property
    def down(self) -> Array:
        """(3,) world direction in which the fingers point."""
        down: Array = -self.R[:, 2]
        return down


@dataclass(frozen=True)
class Grip:
    """How an object of `mass` kg was held.

    slip_m: how far it moved since it was lifted, seen from the bodies that press on it, the mean of
    both sides. seat_m: likewise, from when the hand had closed until then: it finds its seat when
    the table leaves it. forces_n: mean normal force of each side in the last second, None where
    nobody looked. held: whether it was still in the hand at the end. failure: why a simulator did
    not get there.
    """

    place: Place
    mass: float
    slip_m: float
    seat_m: float
    forces_n: tuple[float, float] | None
    held: bool
    failure: str = ""


Try = tuple[Place, float]
"""An object and its mass, kg."""


def with_object(path: Path) -> Model:
    """The robot of an MJCF with an object that floats and a table, both far away."""
    return mujoco.load(path, visuals=False, change=_add_object).model


def _add_object(spec: Any) -> None:  # Any: MuJoCo's MjSpec
    for key in spec.keys:
        if len(key.qpos):
            key.qpos = np.append(key.qpos, (0.0, 0.0, 50.0, 1.0, 0.0, 0.0, 0.0))
    body = spec.worldbody.add_body(name=OBJECT, pos=(0.0, 0.0, 50.0))
    body.add_freejoint(name=OBJECT)
    body.mass, body.inertia, body.explicitinertial = 1.0, (1.0, 1.0, 1.0), True
    body.ipos, body.iquat = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    body.add_geom(
        name=OBJECT,
        type=mj.mjtGeom.mjGEOM_BOX,
        size=(WIDTH_M, WIDTH_M, WIDTH_M),
        contype=1 | _TABLE_BIT,
        conaffinity=1,
        condim=4,
    )
    table = spec.worldbody.add_body(name=_TABLE, mocap=True, pos=(0.0, 0.0, 60.0))
    table.add_geom(
        name=_TABLE,
        type=mj.mjtGeom.mjGEOM_BOX,
        size=(0.5, 0.5, TABLE_M),
        contype=0,
        conaffinity=_TABLE_BIT,
    )


def hands_of(model: Model, keyframes: tuple[str, str] | None) -> list[Hand]:
    """The hand between two keyframes, or without them all that are found."""
    return [between_keys(model, *keyframes)] if keyframes else list(find_hands(model))


def tries_of(model: Model, hand: Hand, masses: Sequence[float]) -> list[Try]:
    """What the hand is to hold: each shape that fits, with each mass in kg."""
    places = (fit(model, hand, shape) for shape in SHAPES)
    return [(place, mass) for place in places if place is not None for mass in masses]


def probe_of(model: Model) -> int:
    """The geom of the object."""
    return int(model.geom(OBJECT).id)


def half_size(shape: Shape, width: float) -> Array:
    """(3,) half of its size along its axes, m."""
    return np.array((0.5, 0.5, 0.75 if shape == "cylinder" else 0.5)) * width


def inertia_of(shape: Shape, width: float, mass: float) -> Array:
    """(3,) principal moments of a homogeneous object, kg m2; width in m, mass in kg."""
    if shape != "cylinder":
        return np.full(3, mass * width**2 / (6.0 if shape == "cube" else 10.0))
    tall = 2.0 * half_size(shape, width)[2]
    side = mass * (0.75 * width**2 + tall**2) / 12.0
    return np.array((side, side, mass * width**2 / 8.0))


def _resize(model: Model, shape: Shape, width: float) -> None:
    kinds, (half, _, tall) = mj.mjtGeom, half_size(shape, width)
    kind, size = {
        "cube": (kinds.mjGEOM_BOX, (half, half, half)),
        "cylinder": (kinds.mjGEOM_CYLINDER, (half, tall, 0.0)),
        "sphere": (kinds.mjGEOM_SPHERE, (half, 0.0, 0.0)),
    }[shape]
    model.geom_type[probe_of(model)], model.geom_size[probe_of(model)] = int(kind), size


# --- where it fits ------------------------------------------------------------------------------


def fit(model: Model, hand: Hand, shape: Shape) -> Place | None:
    """The largest object up to `WIDTH_M` that fingers touch on both sides, as deep as it can be.

    model: of `with_object`. None where none fits between them.
    """
    model, width = mujoco.without(model), WIDTH_M
    while width > LEAST_WIDTH_M:
        _resize(model, shape, width)
        for out in np.linspace(0.0, half_size(shape, width)[2], DEPTHS):
            for index in range(len(hand.poses) - 1, -1, -EVERY):
                place = _room(model, hand, index, shape, width, float(out))
                if place is not None:
                    return place
        width *= SMALLER
    return None


def _room(
    model: Model, hand: Hand, index: int, shape: Shape, width: float, out: float
) -> Place | None:
    """The middle of places in a row between the fingers where the object touches nothing.

    index: of the pose. out: m, less deep in the hand than can be.
    """
    data, along, across = at_pose(model, hand.poses[index]), hand.along[index], hand.across[index]
    R = np.column_stack([across, np.cross(across, along), -along])
    solid = [mujoco.outlines(model, data, solid_geoms(model, side)) for side in hand.sides]
    deepest = min(float((points @ along).max()) for points in solid)
    depth = deepest + BEYOND_M - half_size(shape, width)[2] + out
    middle = hand.tips[index] + (depth - hand.tips[index] @ along) * along
    places = middle + np.linspace(-ASIDE, ASIDE, PLACES)[:, None] * width * across
    touched = ""  # of each place a side's number, `x` for both or other bodies, `-` for nothing
    for xyz in places:
        _put(model, data, xyz, R)
        mj.mj_kinematics(model, data)
        mj.mj_collision(model, data)
        bodies = {body for _, body in _contacts(model, data, deeper_than=0.0)}
        ours = [str(number) for number, side in enumerate(hand.sides) if bodies <= set(side)]
        touched += "-" if not bodies else ours[0] if ours else "x"
    between = re.search(r"0(-+)1", touched)
    if between is None:
        return None
    start = max(0, index - round(OPEN * len(hand.poses)))
    return Place(shape, width, start, places[sum(between.span(1)) // 2], R)


# --- how it is held -----------------------------------------------------------------------------


def grip(model: Model, hand: Hand, place: Place, mass: float) -> Grip:
    """Close on an object, lift it, shake it and hold it.

    model: of `with_object`. mass: kg.
    """
    # A copy with this object, in which nothing but the fingers moves.
    model, body = mujoco.without(model), int(model.body(OBJECT).id)
    _resize(model, place.shape, place.width_m)
    model.body_mass[body] = mass
    model.body_inertia[body] = inertia_of(place.shape, place.width_m, mass)
    mj.mj_setConst(model, mj.MjData(model))
    mujoco.held_but(model, hand.fingers)
    fingers = solid_geoms(model, [body for side in hand.sides for body in side])
    model.geom_friction[[*fingers, probe_of(model)], 0] = FRICTION
    step = float(model.opt.timestep)
    data = mujoco.at_key(model)  # the rest of the robot aims at its home
    data.qpos[:] = hand.poses[place.start]
    _put(model, data, place.xyz, place.R)
    table, down = int(model.body(_TABLE).mocapid[0]), place.down
    mj.mju_mat2Quat(data.mocap_quat[table], place.R.ravel())
    looks, pressing, seen, forces = [CLOSE_S, CLOSE_S + LIFT_S], list[int](), list[Array](), []
    times: Array = step * np.arange(float(round(TOTAL_S / step)))
    driven = [drive.ctrl_index for drive in hand.drives]
    commands = [
        [drive.command(target) for drive, target in zip(hand.drives, targets, strict=True)]
        for targets in closing(hand, place, times).tolist()
    ]
    tables, gravity = table_at(place, times) + TABLE_M * down, G * down + shaking(place, times)
    for index, time in enumerate(times.tolist()):
        data.ctrl[driven] = commands[index]
        data.mocap_pos[table] = tables[index]
        model.opt.gravity[:] = gravity[index]
        mj.mj_step(model, data)
        if looks and time >= looks[0]:
            looks.pop(0)
            if not pressing:  # the body of each side that presses most
                by_body = _forces(model, data)
                pressing = [max(side, key=lambda b: by_body.get(b, 0.0)) for side in hand.sides]
            seen.append(_seen_from(data, pressing))
        if time > TOTAL_S - 1.0:
            by_body = _forces(model, data)
            forces.append([sum(by_body.get(b, 0.0) for b in side) for side in hand.sides])
    seen.append(_seen_from(data, pressing))
    seat, slip = np.linalg.norm(np.diff(seen, axis=0), axis=2).mean(axis=1)
    fell = np.linalg.norm(data.body(OBJECT).xpos - place.xyz) > LIFT_M / 2.0
    one, other = (float(force) for force in np.mean(forces, axis=0))
    held = bool(mujoco.is_finite(data) and not fell and min(one, other) > 0.0)
    return Grip(place, mass, float(slip), float(seat), (one, other), held)


def closing(hand: Hand, place: Place, times: Array) -> Array:
    """(n, k) what the hand's drives are commanded to at each time, rad or m."""
    start, end = hand.targets[place.start], hand.targets[-1]
    share = np.minimum(1.0, times / (RAMP * CLOSE_S))
    targets: Array = start + share[:, None] * (end - start)
    return targets


def table_at(place: Place, times: Array) -> Array:
    """(n, 3) middle of the table's upper face in the world at each time."""
    lifted = LIFT_M * np.clip((times - CLOSE_S) / LIFT_S, 0.0, 1.0)
    down = half_size(place.shape, place.width_m)[2] + lifted
    at: Array = place.xyz + down[:, None] * place.down
    return at


def shaking(place: Place, times: Array) -> Array:
    """(n, 3) m/s2 in the world: along each axis of the object, one after the other."""
    since = times - CLOSE_S - LIFT_S
    axes = place.R.T[np.clip(3.0 * since / SHAKE_S, 0.0, 2.0).astype(int)]
    size = SHAKE_G * G * np.sin(2.0 * np.pi * SHAKE_HZ * since)
    shaken: Array = np.where((since >= 0.0) & (since < SHAKE_S), size, 0.0)[:, None] * axes
    return shaken


def _put(model: Model, data: Data, xyz: Array, R: Array) -> None:
    at = int(model.joint(OBJECT).qposadr[0])
    data.qpos[at : at + 3] = xyz
    mj.mju_mat2Quat(data.qpos[at + 3 : at + 7], R.ravel())


def _contacts(
    model: Model, data: Data, deeper_than: float = -math.inf
) -> Iterator[tuple[int, int]]:
    """(number, body of the other) of contacts of the object with the robot."""
    probe, table = probe_of(model), int(model.geom(_TABLE).id)
    pairs, gaps = data.contact.geom[: data.ncon].tolist(), data.contact.dist.tolist()
    for index, ((one, other), gap) in enumerate(zip(pairs, gaps, strict=False)):
        if probe in (one, other) and table not in (one, other) and -gap > deeper_than:
            yield index, int(model.geom_bodyid[other if one == probe else one])


def _forces(model: Model, data: Data) -> dict[int, float]:
    """Sum of the normal forces of each body of the robot on the object, N."""
    force, sums = np.zeros(6), dict[int, float]()
    for index, body in _contacts(model, data):
        mj.mj_contactForce(model, data, index, force)
        sums[body] = sums.get(body, 0.0) + float(force[0])
    return sums


def _seen_from(data: Data, bodies: Sequence[int]) -> Array:
    """(n, 3) place of the object in the frames of bodies."""
    at = np.array(data.body(OBJECT).xpos)
    return np.array([data.xmat[body].reshape(3, 3).T @ (at - data.xpos[body]) for body in bodies])
