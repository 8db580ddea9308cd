"""Small experiments that tell a sound robot from one that merely loads.

Each takes a compiled model and leaves it as it was, so that one compilation serves all.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from assetbuild.robot.pose import Array
from assetbuild.simulators.mujoco import (
    Data,
    Model,
    at_key,
    caught_warnings,
    explicit_pairs,
    floats,
    floor_contacts,
    floors,
    follow,
    is_finite,
    name_of,
    overlaps,
    raise_base,
    touching_geoms,
    turning,
    without,
)
from assetbuild.simulators.mujoco.drives import read_drives

Name = TypeVar("Name", str, tuple[str, str])
SWING_RAD, SWING_M = 0.1, 0.02
"""How far a drive is commanded to move its joint; less where the range is short."""
FREQUENCY_HZ = 2.0
LEAST_LEAN_RAD = 0.03
"""Less stands on points or edges: the round feet of Bolt make 0.008 rad and Spryped's 0.02, the
soles of Talos 0.075, a G1's 0.12."""
TOUCH_M = 0.005
"""Shapes nearer than this to the floor count as standing on it."""
SEED = 20_000
FINER = 4
"""Steps in place of one: they tell drives that outrun the timestep from a pose that falls."""
HELD_KG = 1e6
"""Inertia added to the six coordinates of a floating base to hold it: against 100 kg it moves by a
ten thousandth. Much more costs the constraints of light fingers the solver's digits."""


def hold_base(model: Model) -> None:
    """A floating base with the inertia of a hill: see `HELD_KG`."""
    import mujoco

    for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
        first = int(model.jnt_dofadr[joint])
        model.dof_armature[first : first + 6] = HELD_KG


# --- drives -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Answer:
    """One joint told to swing by `asked`; it moved by `moved` at most, rad or m."""

    asked: float
    moved: float


def answers(model: Model) -> Mapping[str, Answer]:
    """Each position servo in turn follows one period of a sine; base held, no gravity or contact.

    A drive that moves its joint the wrong way, hardly or not at all is dead: a gain in other
    units, an effort limit of nothing, an axis of length zero.
    """
    import mujoco

    found = {}
    model = without(model, "CONTACT", "LIMIT")
    with caught_warnings():
        hold_base(model)
        model.opt.gravity[:] = 0.0
        # A joint that follows another cannot answer alone.
        coupled = (model.eq_type == mujoco.mjtEq.mjEQ_JOINT) & (model.eq_obj2id >= 0)
        led = {int(joint) for joint in model.eq_obj1id[coupled]}
        steps = max(4, round(1.0 / FREQUENCY_HZ / model.opt.timestep))
        for drive in read_drives(model):
            if not drive.holds_position or drive.joint in led:
                continue
            data = at_key(model)
            asked = _swing(model, drive.joint)
            at, middle = int(model.jnt_qposadr[drive.joint]), float(data.ctrl[drive.ctrl_index])
            start, moved = float(data.qpos[at]), 0.0
            for step in range(steps):
                wave = math.sin(2.0 * math.pi * (step + 1) / steps)
                data.ctrl[drive.ctrl_index] = middle + drive.command_step(asked * wave)
                mujoco.mj_step(model, data)
                moved = max(moved, abs(float(data.qpos[at]) - start))
            found[drive.joint_name] = Answer(asked, moved)
    return found


def _swing(model: Model, joint: int) -> float:
    widest = SWING_M if int(model.jnt_type[joint]) == 2 else SWING_RAD
    if not model.jnt_limited[joint]:
        return widest
    lower, upper = (float(v) for v in model.jnt_range[joint])
    return min(widest, 0.2 * (upper - lower))


# --- energy and timestep ------------------------------------------------------------------------


def energy_drift(model: Model, seconds: float = 1.0) -> float:
    """Relative change of the energy of free motion: no drives, contacts, friction or damping.

    The joints start at up to 1 rad/s; the change is against the kinetic energy at the start.
    nan when the simulation became unstable.
    """
    import mujoco

    model = without(model, "CONSTRAINT", "ACTUATION")
    with caught_warnings():
        model.opt.gravity[:] = 0.0
        for name in ("dof_damping", "dof_frictionloss", "jnt_stiffness"):
            getattr(model, name)[:] = 0.0
        data = at_key(model)
        random = np.random.default_rng(SEED)
        data.qvel[:] = 0.0
        for joint in turning(model):
            data.qvel[int(model.jnt_dofadr[joint])] = random.uniform(-1.0, 1.0)
        start = _kinetic(model, data)
        worst = 0.0
        for _ in range(max(1, round(seconds / model.opt.timestep))):
            mujoco.mj_step(model, data)
            worst = max(worst, abs(_kinetic(model, data) - start))
        if not is_finite(data):
            return math.nan
    return worst / start if start > 0.0 else 0.0


def _kinetic(model: Model, data: Data) -> float:
    import mujoco

    mujoco.mj_forward(model, data)
    mujoco.mj_energyVel(model, data)
    return float(data.energy[1])


def timestep_error(model: Model, finer: int = 4) -> Mapping[str, float]:
    """Largest difference of each joint, told to move, to the same at a finer timestep; rad or m.

    Base held, no contact. inf where one of the two runs became unstable.
    """
    coarse, fine = (_commanded(model, n) for n in (1, finer))
    found = {}
    for joint in turning(model):
        at = int(model.jnt_qposadr[joint])
        error = float(np.abs(coarse[:, at] - fine[:, at]).max())
        found[name_of(model, "joint", joint)] = error if math.isfinite(error) else math.inf
    return found


def _commanded(model: Model, finer: int, seconds: float = 0.3) -> Array:
    """(n, nq) positions at the coarse steps, all servos told to move from the initial pose."""
    import mujoco

    rows = []
    model = without(model, "CONTACT")
    with caught_warnings():
        hold_base(model)
        steps = max(2, round(seconds / model.opt.timestep))
        model.opt.timestep = model.opt.timestep / finer
        data = at_key(model)
        for drive in read_drives(model):
            if drive.holds_position:
                step = drive.command_step(0.5 * _swing(model, drive.joint))
                data.ctrl[drive.ctrl_index] += step
        for _ in range(steps):
            mujoco.mj_step(model, data, finer)
            rows.append(np.array(data.qpos) if is_finite(data) else np.full(model.nq, np.nan))
    return np.array(rows)


# --- self-collision -----------------------------------------------------------------------------


def touching_pairs(model: Model, poses: int) -> Mapping[tuple[str, str], float]:
    """Share of random poses within the limits in which two bodies of the robot touch."""
    import mujoco

    counts: dict[tuple[str, str], int] = {}
    random = np.random.default_rng(SEED)
    joints = turning(model)
    with caught_warnings():
        data = at_key(model)
        for _ in range(poses):
            for joint in joints:
                limited = bool(model.jnt_limited[joint])
                lower, upper = model.jnt_range[joint] if limited else (-math.pi, math.pi)
                data.qpos[int(model.jnt_qposadr[joint])] = random.uniform(lower, upper)
            follow(model, data)
            mujoco.mj_kinematics(model, data)  # no constraints: the contacts of a crowd are enough
            mujoco.mj_comPos(model, data)
            mujoco.mj_collision(model, data)
            for pair, depth in overlaps(model, data, "body").items():
                counts[pair] = counts.get(pair, 0) + (depth > 1e-3)
    return _largest_first({pair: count / poses for pair, count in counts.items() if count})


def overlaps_at_home(model: Model) -> Mapping[tuple[str, str], float]:
    """Depth (m) in which bodies of the robot lie in one another in the initial pose."""
    with caught_warnings():
        return _largest_first(overlaps(model, at_key(model), "body"))


def depths_in_floor(model: Model) -> Mapping[str, float]:
    """Depth (m) in which moving bodies of the robot lie in a floor in the initial pose."""
    found: dict[str, float] = {}
    data = at_key(model)
    for index, geom in floor_contacts(model, data):
        body = name_of(model, "body", int(model.geom_bodyid[geom]))
        found[body] = max(found.get(body, 0.0), -float(data.contact[index].dist))
    return _largest_first(found)


def touches_floors(model: Model) -> bool:
    """Whether a shape of the robot can touch a floor, by MuJoCo's masks or an explicit pair."""
    planes = set(floors(model))
    return any(planes & set(pair) for pair in (*touching_geoms(model), *explicit_pairs(model)))


def depths(model: Model, positions: Mapping[str, float]) -> dict[tuple[str, str], float]:
    """Depth (m) of the geoms of a scene in one another, and of a fixed robot's in its floor, in a
    pose by joint name. The floor's pairs are ("", geom).
    """
    import mujoco

    data = at_key(model)
    for name, value in positions.items():
        data.qpos[int(model.joint(name).qposadr[0])] = value
    mujoco.mj_fwdPosition(model, data)
    found = overlaps(model, data, "geom")
    if floats(model):
        return found  # it is put on the floor
    for contact in data.contact[: data.ncon]:
        geoms = int(contact.geom1), int(contact.geom2)
        if 0 in model.geom_bodyid[list(geoms)]:
            own = next(geom for geom in geoms if model.geom_bodyid[geom])
            pair = "", name_of(model, "geom", own)
            found[pair] = max(found.get(pair, 0.0), -float(contact.dist))
    return found


def _largest_first(found: Mapping[Name, float]) -> Mapping[Name, float]:
    return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))


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
    model = without(model)
    with caught_warnings():
        model.geom_margin[:] = near_m
        data = at_key(model)
        points = [
            np.array(contact.pos[:2])
            for contact in data.contact[: data.ncon]
            if 0 in (model.geom_bodyid[contact.geom1], model.geom_bodyid[contact.geom2])
        ]
        com, height = np.array(data.subtree_com[0][:2]), float(data.subtree_com[0][2])
    if not points:
        return Support(None, 0)
    x, y = com - (np.min(points, axis=0) + np.max(points, axis=0)) / 2.0
    margin = polygon_margin(np.array(points), com)
    lean = 0.0 if margin is None else math.atan2(_narrowest(np.array(points)) / 2.0, height)
    return Support(margin, len(points), (float(x), float(y)), lean)


def _narrowest(points: Array) -> float:
    """Width (m) of points (n, 2) that span an area, in the direction in which it is smallest."""
    corners, outward = _sides(points)
    behind = np.einsum("ijk,ik->ij", corners[None, :, :] - corners[:, None, :], -outward)
    return float(behind.max(axis=1).min())


def polygon_margin(points: Array, inside: Array) -> float | None:
    """Distance (m) of a point to the border of the convex hull of points (n, 2); None: no area.

    Outside of a corner the nearest side's line is nearer than the corner: the sign counts.
    """
    if len(points) < 3 or np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] < 1e-3:
        return None
    corners, outward = _sides(points)
    return float(np.einsum("ij,ij->i", outward, corners - inside).min())


def _sides(points: Array) -> tuple[Array, Array]:
    """(k, 2) corners of the convex hull of points (n, 2), and unit outward normals of its sides."""
    corners = _hull_corners(points)
    along = np.roll(corners, -1, axis=0) - corners
    outward = np.column_stack([along[:, 1], -along[:, 0]])
    return corners, outward / np.linalg.norm(outward, axis=1)[:, None]


def _hull_corners(points: Array) -> Array:
    """(k, 2) corners of the convex hull of points (n, 2), counter-clockwise.

    The monotone chain of Andrew (1979); importing scipy's takes as long as this whole check.
    """
    ordered = sorted({(float(x), float(y)) for x, y in points})
    corners: list[tuple[float, float]] = []
    for side in (ordered, ordered[::-1]):
        chain: list[tuple[float, float]] = []
        for x, y in side:
            while len(chain) >= 2:
                (ax, ay), (bx, by) = chain[-2:]
                if (bx - ax) * (y - ay) > (by - ay) * (x - ax):
                    break
                chain.pop()
            chain.append((x, y))
        corners += chain[:-1]
    return np.array(corners)


def stands_free(model: Model) -> bool:
    """Whether its first joint is free, and there is a floor to stand on."""
    return floats(model) and bool(floors(model))


@dataclass(frozen=True)
class Settled:
    """After a drop of a scene's robot: fastest joint, deepest contact, wander of the base."""

    finite: bool
    speed: float
    penetration_m: float
    drift_m: float


def settle(
    model: Model, drop_m: float, seconds: float = 2.0, steps: int = 1000, finer: int = 1
) -> Settled:
    """Dropped in its initial pose under its drives; then `steps` more to see it wander.

    finer: steps in place of each, for as long.
    """
    import mujoco

    model = without(model)
    with caught_warnings():
        model.opt.timestep = model.opt.timestep / finer
        data = at_key(model)
        raise_base(model, data, drop_m)
        mujoco.mj_step(model, data, max(1, round(seconds / model.opt.timestep)))
        speeds = [abs(float(data.qvel[int(model.jnt_dofadr[j])])) for j in turning(model)]
        depth = max((-float(c.dist) for c in data.contact[: data.ncon]), default=0.0)
        place = np.array(data.xpos[1])
        mujoco.mj_step(model, data, steps * finer)
        mujoco.mj_forward(model, data)
        drift = math.dist(place, np.array(data.xpos[1]))
    return Settled(is_finite(data), max(speeds, default=0.0), max(depth, 0.0), drift)
