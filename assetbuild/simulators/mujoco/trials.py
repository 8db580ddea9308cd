"""Small experiments that tell a sound robot from one that merely loads.

Each takes a compiled model and leaves it as it was, so that one compilation serves all.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from assetbuild.robot.pose import Array
from assetbuild.robot.sections import Action
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import Data, Model, mj
from assetbuild.simulators.mujoco.drives import read_drives, torques

Depths = Mapping[tuple[str, str], float]
SWING_RAD, SWING_M = 0.1, 0.02
"""How far a drive is commanded to move its joint; less where the range is short."""
FREQUENCY_HZ = 2.0
LEAST_LEAN_RAD = 0.03
"""Less stands on points or edges: the round feet of Bolt make 0.008 rad and Spryped's 0.02, the
soles of Talos 0.075, a G1's 0.12."""
TOUCH_M = 0.005
"""Shapes nearer than this to the floor count as standing on it."""
DIRECTIONS = 720
"""Points that stand out in one of these are the corners of what stands on the floor."""
SEED = 20_000
FINER = 4
"""Steps in place of one, with which drives are compared."""
CONTROL_S, NOISE_S = 0.02, 5.0
"""Between two commands of an untrained policy; how long it is tried."""


# --- drives -------------------------------------------------------------------------------------


def answers(model: Model) -> Mapping[str, tuple[float, float]]:
    """Each position servo in turn follows one period of a sine; base held, no gravity or contact.

    Returns by joint how far it was told to swing and how far it moved at most, rad or m.
    A drive that moves its joint the wrong way, hardly or not at all is dead: a gain in other
    units, an effort limit of nothing, an axis of length zero.
    """
    by_joint = {}
    model = mujoco.without(model, "CONTACT", "LIMIT")
    with mujoco.caught_warnings():
        mujoco.hold_base(model)
        model.opt.gravity[:] = 0.0
        # A joint that follows another cannot answer alone.
        coupled = (model.eq_type == mj.mjtEq.mjEQ_JOINT) & (model.eq_obj2id >= 0)
        led = model.eq_obj1id[coupled].tolist()
        steps = max(4, round(1.0 / FREQUENCY_HZ / model.opt.timestep))
        for drive in read_drives(model):
            if not drive.holds_position or drive.joint in led:
                continue
            data, asked = mujoco.at_key(model), _swing(model, drive.joint)
            at, middle = int(model.jnt_qposadr[drive.joint]), float(data.ctrl[drive.ctrl_index])
            start, moved = float(data.qpos[at]), 0.0
            for step in range(steps):
                wave = math.sin(2.0 * math.pi * (step + 1) / steps)
                data.ctrl[drive.ctrl_index] = middle + drive.command_step(asked * wave)
                mj.mj_step(model, data)
                moved = max(moved, abs(float(data.qpos[at]) - start))
            by_joint[drive.joint_name] = asked, moved
    return by_joint


def _swing(model: Model, joint: int) -> float:
    widest = SWING_M if int(model.jnt_type[joint]) == 2 else SWING_RAD
    lower, upper = model.jnt_range[joint] if model.jnt_limited[joint] else (-math.inf, math.inf)
    return float(min(widest, 0.2 * (upper - lower)))


def shake(model: Model, action: Action) -> tuple[float | None, str, float] | None:
    """What PPO does at first: each servo gets a new random target 50 times a second.

    Normally distributed about the initial pose with the joint's scale of `action`; falls and lies
    on the floor as it may. Returns the seconds until it went to infinity, None = it did not, and
    the fastest joint with its speed, rad/s or m/s. None: nothing is a position servo.
    """
    servos = [drive for drive in read_drives(model) if drive.holds_position]
    if not servos:
        return None
    scales, most = [], torques(model)
    for drive in servos:
        lower, upper = most[drive.joint]
        effort, slides = max(-lower, upper), int(model.jnt_type[drive.joint]) == 2
        scale = action.scale(effort if effort < math.inf else None, drive.kp, slides=slides)
        scales.append(drive.command_step(scale))
    places, joints = [drive.ctrl_index for drive in servos], mujoco.turning(model)
    dofs = model.jnt_dofadr[joints]
    random, speeds, ended = np.random.default_rng(SEED), np.zeros(len(joints)), None
    model = mujoco.without(model)
    with mujoco.caught_warnings():
        data = mujoco.at_key(model)
        commands = np.array(data.ctrl)
        each = max(1, round(CONTROL_S / model.opt.timestep))
        for step in range(each * round(NOISE_S / CONTROL_S)):
            if step % each == 0:
                noise = [scale * random.standard_normal() for scale in scales]
                data.ctrl[places] = commands[places] + noise
            mj.mj_step(model, data)
            if not mujoco.is_finite(data):
                ended = step * model.opt.timestep
                break
            speeds = np.maximum(speeds, np.abs(data.qvel[dofs]))
    name = mujoco.name_of(model, "joint", joints[int(speeds.argmax())])
    return ended, name, float(speeds.max())


# --- energy and timestep ------------------------------------------------------------------------


def energy_drift(model: Model) -> float:
    """Relative change of the energy in 1 s of free motion: no drives, springs, contacts, friction,
    damping or medium.

    The joints start at up to 1 rad/s; the change is against the kinetic energy at the start.
    nan when the simulation became unstable.
    """
    model = mujoco.without(model, "CONSTRAINT", "ACTUATION", "SPRING", "DAMPER")
    with mujoco.caught_warnings():
        model.opt.gravity[:] = 0.0
        model.opt.density = model.opt.viscosity = 0.0
        data, random = mujoco.at_key(model), np.random.default_rng(SEED)
        dofs = model.jnt_dofadr[mujoco.turning(model)]
        data.qvel[:] = 0.0
        data.qvel[dofs] = random.uniform(-1.0, 1.0, len(dofs))
        start, worst = _kinetic(model, data), 0.0
        for _ in range(max(1, round(1.0 / model.opt.timestep))):
            mj.mj_step(model, data)
            worst = max(worst, abs(_kinetic(model, data) - start))
        if not mujoco.is_finite(data):
            return math.nan
    return worst / start if start > 0.0 else 0.0


def _kinetic(model: Model, data: Data) -> float:
    mj.mj_forward(model, data)
    mj.mj_energyVel(model, data)
    return float(data.energy[1])


def timestep_error(model: Model) -> Mapping[str, float]:
    """Largest difference of each joint, told to move, to the same at a finer timestep; rad or m.

    Base held, no contact. inf where one of the two runs became unstable.
    """
    coarse, fine = (_commanded(model, finer) for finer in (1, FINER))
    errors = np.abs(coarse - fine).max(axis=0)
    errors = np.where(np.isfinite(errors), errors, math.inf)
    places = {name: model.jnt_qposadr[joint] for name, joint in mujoco.joints(model).items()}
    return {name: float(errors[place]) for name, place in places.items()}


def _commanded(model: Model, finer: int, seconds: float = 0.3) -> Array:
    """(n, nq) positions at the coarse steps, all servos told to move from the initial pose."""
    rows = []
    model = mujoco.without(model, "CONTACT")
    with mujoco.caught_warnings():
        mujoco.hold_base(model)
        steps = max(2, round(seconds / model.opt.timestep))
        model.opt.timestep = model.opt.timestep / finer
        data = mujoco.at_key(model)
        for drive in read_drives(model):
            if drive.holds_position:
                step = drive.command_step(0.5 * _swing(model, drive.joint))
                data.ctrl[drive.ctrl_index] += step
        for _ in range(steps):
            mj.mj_step(model, data, finer)
            finite = mujoco.is_finite(data)
            rows.append(np.array(data.qpos) if finite else np.full(model.nq, np.nan))
    return np.array(rows)


# --- what touches what --------------------------------------------------------------------------


def touching_pairs(model: Model, poses: int) -> Depths:
    """Share of random poses within the limits in which two bodies of the robot touch."""
    counts: dict[tuple[str, str], int] = {}
    random = np.random.default_rng(SEED)
    joints = mujoco.turning(model)
    limited = model.jnt_limited[joints, None] != 0
    lower, upper = np.where(limited, model.jnt_range[joints], (-math.pi, math.pi)).T
    with mujoco.caught_warnings():
        data = mujoco.at_key(model)
        for _ in range(poses):
            data.qpos[model.jnt_qposadr[joints]] = random.uniform(lower, upper)
            mujoco.follow(model, data)
            mj.mj_kinematics(model, data)  # no constraints: the contacts of a crowd are enough
            mj.mj_comPos(model, data)
            mj.mj_collision(model, data)
            for pair, depth in mujoco.overlaps(model, data, "body").items():
                counts[pair] = counts.get(pair, 0) + (depth > 1e-3)
    return _largest_first({pair: count / poses for pair, count in counts.items() if count})


def overlaps_at_home(model: Model) -> Depths:
    """Depth (m) in which bodies lie in one another or in a floor ("") in the initial pose."""
    with mujoco.caught_warnings():
        return _largest_first(mujoco.overlaps(model, mujoco.at_key(model), "body", floor=True))


def depths(
    model: Model, positions: Mapping[str, float], kind: str = "geom"
) -> dict[tuple[str, str], float]:
    """Depth (m) of the geoms or bodies of a scene in one another, and of a fixed robot's in its
    floor (""), in a pose by joint name; joints that the model does not name stay.
    """
    data = mujoco.at_key(model)
    for name, joint in mujoco.joints(model).items():
        at = int(model.jnt_qposadr[joint])
        data.qpos[at] = positions.get(name, data.qpos[at])
    mj.mj_fwdPosition(model, data)
    stands = not mujoco.floats(model)  # what floats is put on the floor
    return mujoco.overlaps(model, data, kind, floor=stands)


def _largest_first(values: Depths) -> Depths:
    return dict(sorted(values.items(), key=lambda item: (-item[1], item[0])))


# --- on the floor -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Support:
    """margin_m: of the centre of mass inside the support polygon, negative outside.

    off_m: centre of mass beyond the middle of the points' extent, x and y; 0 without points.
    lean_rad: by which a robot whose centre of mass is over the middle may lean before it tips.
    """

    margin_m: float | None
    points: int
    off_m: tuple[float, float] = (0.0, 0.0)
    lean_rad: float = 0.0

    @property
    def is_area(self) -> bool:
        """Whether drives alone can keep the robot up: a sole carries it, not points or edges."""
        return self.lean_rad > LEAST_LEAN_RAD


def support(model: Model, near_m: float = TOUCH_M) -> Support:
    """Where the centre of mass stands over the feet in the initial pose of a scene.

    near_m: what is nearer to the floor stands on it.

    margin None: the robot touches the floor in less than three points that span an area.
    """
    model = mujoco.without(model)
    with mujoco.caught_warnings():
        model.geom_margin[:] = near_m
        data = mujoco.at_key(model)
        on_floor = np.isin(data.contact.geom, mujoco.floors(model)).any(axis=1)
        points = np.array(data.contact.pos)[on_floor, :2]
        com, height = np.array(data.subtree_com[0][:2]), float(data.subtree_com[0][2])
    if not len(points):
        return Support(None, 0)
    x, y = com - (points.min(axis=0) + points.max(axis=0)) / 2.0
    off = float(x), float(y)
    normals = side_normals(points)
    if normals is None:
        return Support(None, len(points), off)
    reach = (normals @ points.T).max(axis=1)
    margin = float((reach - normals @ com).min())
    width = float((reach + (-normals @ points.T).max(axis=1)).min())
    return Support(margin, len(points), off, math.atan2(width / 2.0, height))


def side_normals(points: Array) -> Array | None:
    """(k, 2) unit normals, both ways, of the lines through any two points (n, 2); None: no area.

    Those of the sides of the convex hull are among them, and only across a side is a hull as near
    to a point inside, or as narrow.
    """
    if len(points) < 3 or np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] < 1e-3:
        return None
    ways = np.exp(2j * math.pi * np.arange(DIRECTIONS) / DIRECTIONS)
    corners = points[np.unique((points @ [ways.real, ways.imag]).argmax(axis=0))]
    first, second = np.triu_indices(len(corners), 1)
    x, y = (corners[second] - corners[first]).T
    normals: Array = np.stack([y, -x], axis=1) / np.hypot(x, y)[:, None]
    return np.concatenate([normals, -normals])


SETTLED = ("fastest_joint", "deepest_contact_m", "drift_m")


def settle(
    model: Model, drop_m: float, seconds: float = 2.0, steps: int = 1000
) -> dict[str, float] | None:
    """Dropped in its initial pose under its drives; then `steps` more to see its base wander.

    Returns the three of `SETTLED`; None when the simulation became unstable.
    """
    model = mujoco.without(model)
    with mujoco.caught_warnings():
        data = mujoco.at_key(model)
        mujoco.raise_base(model, data, drop_m)
        mj.mj_step(model, data, max(1, round(seconds / model.opt.timestep)))
        speed = np.abs(data.qvel[model.jnt_dofadr[mujoco.turning(model)]]).max(initial=0.0)
        depth = -np.min(data.contact.dist, initial=0.0)
        place = np.array(data.xpos[1])
        mj.mj_step(model, data, steps)
        mj.mj_forward(model, data)
        drift = math.dist(place, np.array(data.xpos[1]))
    values = (float(speed), float(depth), drift)
    return dict(zip(SETTLED, values, strict=True)) if mujoco.is_finite(data) else None


def unit_of(model: Model, joint: str) -> str:
    """`m` of a joint that slides, `rad` of one that turns."""
    return "m" if model.joint(joint).type[0] == mj.mjtJoint.mjJNT_SLIDE else "rad"
