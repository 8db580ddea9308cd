"""A robot that stands on a slope, in MuJoCo: does it creep below the angle of friction?

Gravity is turned instead of the floor. A robot that would tip over before it slides gets a flatter
slope, and less friction on it, so that friction carries the same share of its load.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from assetbuild.robot.pose import Array
from assetbuild.simulators.mujoco import (
    Data,
    Model,
    at_key,
    caught_warnings,
    floats,
    floor_contacts,
    floors,
    is_finite,
    turning,
    without,
)
from assetbuild.simulators.mujoco.drives import read_drives
from assetbuild.simulators.mujoco.stand import Gains, command, laws_of
from assetbuild.simulators.mujoco.trials import support

SETTLE_S, TILT_S, REST_S, WATCH_S = 0.5, 0.5, 1.0, 2.0
"""It stands on level ground, the ground tilts, what swings comes to rest, then it is watched."""
SHARE = 0.8
"""Of the angle of friction, where nobody says how steep the slope is."""
LEAN = 0.4
"""Share of the angle at which it would tip over that the ground tilts by at most."""
FALLEN = 0.3
"""rad; a robot that leaned further has fallen."""


@dataclass(frozen=True)
class Ground:
    """What a robot is to stand on.

    angle: of the slope, rad; friction: of the feet on it, lower than the stated one where the robot
    would tip over. scale: how much more of the load friction would carry on the steep slope.
    """

    angle: float
    friction: float
    stated: float
    scale: float


@dataclass(frozen=True)
class Creep:
    """What a robot did on a slope.

    speed: of what touches the floor, m/s, on the worse of a slope along x and one along y. On a
    flatter slope it is scaled up with the load that friction would carry on the steep one.
    """

    ground: Ground
    speed: float


def creep(model: Model, share: float, external: Mapping[str, Gains]) -> Creep | str:
    """How fast the initial pose of a scene slides on a slope; or why nothing can be said.

    share: of the angle of friction. external: as in `mujoco_stand.stand`.
    """
    ground = ground_under(model, share, external)
    if isinstance(ground, str):
        return ground
    model = without(model)
    with caught_warnings():
        model.geom_friction[:, 0] *= ground.friction / ground.stated
        model.pair_friction[:, :2] *= ground.friction / ground.stated
        ways = (np.array((1.0, 0.0)), np.array((0.0, 1.0)))
        speeds = [_slide(model, ground.angle, way, external) for way in ways]
    if not all(map(math.isfinite, speeds)):
        return "it falls"
    return Creep(ground, ground.scale * max(speeds))


def ground_under(model: Model, share: float, external: Mapping[str, Gains]) -> Ground | str:
    """The slope on which friction carries a share of what it can; or why there is none."""
    if not floats(model) or not floors(model):
        return "it does not stand on a floor"
    model = without(model)
    with caught_warnings():
        start = at_key(model)
        _stand(model, start, np.array(start.qpos), external, (0.0, 0.0), SETTLE_S, np.zeros(2))
        mu, feet = _footing(model, start)
        if not feet:
            return "it does not touch the floor"
        if mu <= 0.0:
            return "its feet have no friction"
        if any(_rolls(model, body, external) for body in feet):
            return "it rolls"
        margin = support(model).margin_m
    if margin is None or margin <= 0.0:
        return "its centre of mass is not over its feet"
    lean = math.atan2(margin, float(start.subtree_com[0][2]))
    angle = min(share * math.atan(mu), LEAN * lean)
    scale = math.sin(share * math.atan(mu)) / math.sin(angle)
    return Ground(angle, math.tan(angle / share), mu, scale)


def _slide(model: Model, angle: float, down: Array, external: Mapping[str, Gains]) -> float:
    """Speed of the feet down the slope, m/s; nan where the robot fell."""
    data = at_key(model)
    target, up = np.array(data.qpos), np.array(data.xmat[1]).reshape(3, 3)[:, 2]
    _stand(model, data, target, external, (0.0, 0.0), SETTLE_S, down)
    _stand(model, data, target, external, (0.0, angle), TILT_S, down)
    _stand(model, data, target, external, (angle, angle), REST_S, down)
    slid = _stand(model, data, target, external, (angle, angle), WATCH_S, down)
    upright = float(up @ np.array(data.xmat[1]).reshape(3, 3)[:, 2]) > math.cos(angle + FALLEN)
    return abs(slid) / WATCH_S if upright and is_finite(data) else math.nan


def _stand(
    model: Model,
    data: Data,
    target: Array,
    external: Mapping[str, Gains],
    angles: tuple[float, float],
    seconds: float,
    down: Array,
) -> float:
    """Stand on ground that tilts from one angle to another; how far the feet slid down it, m."""
    import mujoco

    laws, step = laws_of(model, external), float(model.opt.timestep)
    g, slid = float(np.linalg.norm(model.opt.gravity)), 0.0
    for tilt in np.linspace(*angles, max(1, round(seconds / step))):
        model.opt.gravity[:] = (*(g * math.sin(tilt) * down), -g * math.cos(tilt))
        command(model, data, target, laws)
        mujoco.mj_step(model, data)
        slid += step * float(_sliding(model, data)[:2] @ down)
    return slid


def _sliding(model: Model, data: Data) -> Array:
    """(3,) mean velocity of the robot's material points that touch the floor, m/s."""
    import mujoco

    speeds, velocity = [np.zeros(3)], np.zeros(6)
    for index, geom in floor_contacts(model, data):
        body = int(model.geom_bodyid[geom])
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, velocity, 0)
        arm = np.array(data.contact[index].pos) - np.array(data.xipos[body])
        speeds.append(velocity[3:] + np.cross(velocity[:3], arm))
    mean: Array = np.sum(speeds, axis=0) / max(1, len(speeds) - 1)
    return mean


def _footing(model: Model, data: Data) -> tuple[float, set[int]]:
    """(least friction on the floor, bodies that touch it)."""
    touching = floor_contacts(model, data)
    contacts = [data.contact[index] for index, _ in touching]
    mus = [float(contact.friction[0]) if contact.dim > 1 else 0.0 for contact in contacts]
    return min(mus, default=0.0), {int(model.geom_bodyid[geom]) for _, geom in touching}


def _rolls(model: Model, body: int, external: Mapping[str, Gains]) -> bool:
    """Whether a joint above a body turns freely: nothing holds its position."""
    held = {drive.joint for drive in read_drives(model) if drive.holds_position}
    held |= {drive.joint for drive, _ in laws_of(model, external)}
    while body:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        if any(j in turning(model) and j not in held for j in range(first, first + count)):
            return True
        body = int(model.body_parentid[body])
    return False
