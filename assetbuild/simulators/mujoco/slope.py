"""A robot that stands on a slope, in MuJoCo: does it creep below the angle of friction?

Gravity is turned instead of the floor. A robot that would tip over before it slides, or whose
drives give way, gets a flatter slope, and less friction on it, so that friction carries the same
share of its load.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from assetbuild.robot.pose import Array
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import Data, Model, mj
from assetbuild.simulators.mujoco.drives import read_drives
from assetbuild.simulators.mujoco.trials import support

WATCH_S = 1.0
LEVEL = (0.5, 0.0, 0.0)
TILTING = (LEVEL, (0.5, 0.0, 1.0), (2.0, 1.0, 1.0))
"""Seconds, and the slope at their start and end as a share of the angle: it stands on level ground,
the ground tilts, and what swings comes to rest; then it is watched."""
SHARE = 0.8
"""Share of the angle of friction by which the slope is steep, where nobody says."""
SLOW = 0.001
"""m/s that feet may slide at, where nobody says."""
LEAN = 0.4
"""Share of the angle at which it would tip over that the ground tilts by at most."""
LEAST_LEAN = 0.02
"""rad; on the slope that such a robot stands on, its rocking is all that can be measured."""
FLATTER = (1.0, 0.5, 0.25)
"""Parts of that angle that are tried, one after the other, until the robot's drives carry it."""
FALLEN = 0.3
"""rad; a robot that leaned further has fallen."""


@dataclass(frozen=True)
class Slope:
    """What a robot stands on, and what it does there.

    angle: rad; friction: of the feet on it, lower than the stated one where the robot would tip
    over. scale: how much more of the load friction would carry on the steep slope.
    speed: of what touches the floor, m/s, on the worse of a slope along x and one along y. On a
    flatter slope it is scaled up with the load that friction would carry on the steep one.
    """

    angle: float
    friction: float
    stated: float
    scale: float
    speed: float = math.nan


def creep(model: Model, share: float = SHARE, limit: float = SLOW) -> Slope | str:
    """How fast the initial pose of a scene slides on a slope; or why nothing can be said.

    share: of the angle of friction. limit: m/s; a robot that slides faster is tried on flatter
    slopes, where it slides as fast if its contacts are the cause, and rests if its drives are.
    """
    steepest = slope_under(model, share)
    if isinstance(steepest, str):
        return steepest
    stood = []
    for part in FLATTER:
        slope = slope_at(part * steepest.angle, steepest.stated, share)
        changed = mujoco.without(model)
        changed.geom_friction[:, 0] *= slope.friction / slope.stated
        changed.pair_friction[:, :2] *= slope.friction / slope.stated
        with mujoco.caught_warnings():
            speeds = [
                _slide(changed, slope.angle, np.array(way)) for way in ((1.0, 0.0), (0.0, 1.0))
            ]
        slope = replace(slope, speed=slope.scale * float(np.max(speeds)))  # nan if the robot fell
        if math.isfinite(slope.speed):
            stood.append(slope)
        if slope.speed <= limit:
            break
    return min(stood, key=lambda one: one.speed, default="the robot falls")


def slope_at(angle: float, friction: float, share: float) -> Slope:
    """A slope of `angle` rad with so little friction that it carries a share of what it can."""
    scale = math.sin(share * math.atan(friction)) / math.sin(angle)
    return Slope(angle, math.tan(angle / share), friction, scale)


def slope_under(model: Model, share: float) -> Slope | str:
    """The steepest slope that a robot may stand on without tipping over; or why there is none."""
    if not mujoco.stands_free(model):
        return "it does not stand on a floor"
    model = mujoco.without(model)
    with mujoco.caught_warnings():
        start = mujoco.at_key(model)
        for _ in _stand(model, start, LEVEL, 0.0, np.zeros(2)):
            pass
        touching = mujoco.floor_contacts(model, start)
        contacts = [start.contact[index] for index, _ in touching]
        mu = min((float(c.friction[0]) if c.dim > 1 else 0.0 for c in contacts), default=0.0)
        if not touching:
            return "it does not touch the floor"
        if mu <= 0.0:
            return "its feet have no friction"
        held = {drive.joint for drive in read_drives(model) if drive.holds_position}
        turning = {int(model.jnt_bodyid[joint]) for joint in {*mujoco.turning(model)} - held}
        if any(mujoco.above(model, model.geom_bodyid[geom]) & turning for _, geom in touching):
            return "it rolls"
        margin = support(model).margin_m
    if margin is None or margin <= 0.0:
        return "its centre of mass is not over its feet"
    lean = math.atan2(margin, float(start.subtree_com[0][2]))
    if lean < LEAST_LEAN:
        return f"it tips over on {lean:.2g} rad, which says nothing about friction"
    return slope_at(min(share * math.atan(mu), LEAN * lean), mu, share)


def _slide(model: Model, angle: float, down: Array) -> float:
    """Speed of the feet down the slope, m/s; nan where the robot fell."""
    data = mujoco.at_key(model)
    up = np.array(data.xmat[1]).reshape(3, 3)[:, 2]
    for phase in TILTING:
        for _ in _stand(model, data, phase, angle, down):
            pass
    watched = _stand(model, data, (WATCH_S, 1.0, 1.0), angle, down)
    slid = sum(step * _sliding(model, data, down) for step in watched)
    upright = float(up @ np.array(data.xmat[1]).reshape(3, 3)[:, 2]) > math.cos(angle + FALLEN)
    return abs(slid) / WATCH_S if upright and mujoco.is_finite(data) else math.nan


def _stand(
    model: Model, data: Data, phase: tuple[float, float, float], angle: float, down: Array
) -> Iterator[float]:
    """Stand on ground that tilts; yields each step's length in s. down: (2,) of the slope."""
    (seconds, first, last), step = phase, float(model.opt.timestep)
    g, advance = float(np.linalg.norm(model.opt.gravity)), mj.mj_step
    for tilt in np.linspace(first * angle, last * angle, max(1, round(seconds / step))):
        model.opt.gravity[:] = (*(g * math.sin(tilt) * down), -g * math.cos(tilt))
        advance(model, data)
        yield step


def _sliding(model: Model, data: Data, down: Array) -> float:
    """Mean velocity down the slope of the robot's material points that touch the floor, m/s."""
    touching = mujoco.floor_contacts(model, data)
    if not touching:
        return 0.0
    contacts, geoms = (list(column) for column in zip(*touching, strict=True))
    bodies = model.geom_bodyid[geoms]
    # MuJoCo's spatial velocities are those at the centre of mass of the body's tree.
    wx, wy, wz, vx, vy, _ = data.cvel[bodies].T
    x, y, z = (data.contact.pos[contacts] - data.subtree_com[model.body_rootid[bodies]]).T
    along = down[0] * (vx + wy * z - wz * y) + down[1] * (vy + wz * x - wx * z)
    return float(along.sum()) / len(touching)
