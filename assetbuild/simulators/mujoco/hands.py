"""Grippers of a compiled MuJoCo model: what one drive opens and closes.

Nothing is taken from names. A drive is swept from one end to the other with contacts off, so that
coupled joints and closed loops take part; where the tips of what it moves come together, or come
to the body that they are on, it is a hand.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from assetbuild.errors import StepError
from assetbuild.robot.pose import Array
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import Data, Model, mj
from assetbuild.simulators.mujoco.drives import Drive, read_drives

OBJECT = "gripped object"
"""The name of the body, joint and geom of what is gripped."""
SAMPLES = 41
"""Poses of a sweep."""
SETTLE_S = 0.06
"""For which each is commanded."""
SETTLING = 10
"""Poses from the initial one to the first."""
TIP_M = 0.01
"""Depth of the outermost part of a finger that is its tip."""
MEETS = 0.4
"""Share of the open width that may be left between the middles of closed fingertips."""
SKEW = 0.1
"""rad; fingers that point within this of an axis of the palm point along it."""
LEAST_OPENING_M = 0.01
LARGEST_M = 0.3
"""From a finger's joint to its tip; an elbow or a knee folds, too."""


@dataclass(frozen=True)
class Hand:
    """What opens and closes.

    palm: body that the fingers are on. sides: bodies that move together against the others; the
    second is what stands still with the palm where all fingers move the same way.
    poses: (n, nq) positions of the model from open to closed; targets: (n, k) of its drives, rad
    or m.
    fingers: joints that move. tips: (n, 3) world points between the fingertips; along, across:
    (n, 3) world directions in which the fingers point, and from the first side to the second.
    """

    palm: int
    drives: tuple[Drive, ...]
    sides: tuple[tuple[int, ...], tuple[int, ...]]
    poses: Array
    targets: Array
    fingers: tuple[int, ...]
    tips: Array
    along: Array
    across: Array


def find_hands(model: Model) -> Iterator[Hand]:
    """Every gripper that one drive closes, or two drives of fingers that face each other.

    What has a drive for each of many joints closes in many ways: see `between_keys`.
    model: has an `OBJECT` that may be put anywhere.
    """
    drives = read_drives(model)
    driven = {int(model.jnt_bodyid[drive.joint]) for drive in drives}
    ends = [
        drive
        for drive in drives
        if drive.holds_position
        and model.jnt_limited[drive.joint]
        and mujoco.below(model, body := int(model.jnt_bodyid[drive.joint])) & driven == {body}
    ]
    for drive in ends:
        fingers = sorted(_linked(model, drive.joint))
        if hand := _swept(model, (drive,), fingers):
            yield hand
    for one, other in itertools.combinations(ends, 2):
        parents = model.body_parentid[model.jnt_bodyid[[one.joint, other.joint]]]
        for flip in (False, True) if parents[0] == parents[1] else ():
            hand = _swept(model, (one, other), [one.joint, other.joint], flip=flip)
            if hand and hand.palm not in hand.sides[1]:  # they close on each other
                yield hand


def between_keys(model: Model, opened: str, closed: str) -> Hand:
    """The hand whose joints differ between two keyframes; each of its drives moves evenly.

    Raises StepError where there is no such keyframe, or nothing closes between the two.
    """
    keys = [mj.mj_name2id(model, mj.mjtObj.mjOBJ_KEY, name) for name in (opened, closed)]
    for key, name in zip(keys, (opened, closed), strict=True):
        if key < 0:
            raise StepError(f"there is no keyframe `{name}`", hint="name one of `keyframes`")
    first, last = (np.array(model.key_qpos[key]) for key in keys)
    fingers = [j for j in mujoco.turning(model) if first[(at := model.jnt_qposadr[j])] != last[at]]
    drives = tuple(d for d in read_drives(model) if d.holds_position and d.joint in fingers)
    poses = first + np.linspace(0.0, 1.0, SAMPLES)[:, None] * (last - first)
    places = [int(model.jnt_qposadr[drive.joint]) for drive in drives]
    hand = _hand(model, drives, fingers, poses, poses[:, places]) if drives else None
    if hand is None:
        raise StepError(
            f"no fingers come together between the keyframes `{opened}` and `{closed}`",
            hint="the keyframes differ in the joints of one hand, whose tips meet",
        )
    return hand


def solid_geoms(model: Model, bodies: Collection[int]) -> list[int]:
    """Shapes of bodies that can touch something."""
    return [geom for geom in mujoco.collision_geoms(model) if model.geom_bodyid[geom] in bodies]


def at_pose(model: Model, pose: Array) -> Data:
    """The model's shapes where (nq,) positions put them; nothing else is computed."""
    data = mj.MjData(model)
    data.qpos[:] = pose
    mj.mj_kinematics(model, data)
    return data


# --- what a drive moves -------------------------------------------------------------------------


def _linked(model: Model, joint: int) -> set[int]:
    """The joint and all that follow it, directly, through others or in closed loops."""
    active = (int(equality) for equality in np.flatnonzero(model.eq_active0))
    groups = [set(_constrained(model, equality)) for equality in active]
    joints = {joint}
    while more := [group for group in groups if group & joints and not group <= joints]:
        joints = joints.union(*more)
    return joints


def _constrained(model: Model, equality: int) -> Iterator[int]:
    """Joints that an equality couples; of bodies that it connects, those of the loop it closes."""
    ends = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
    kind = int(model.eq_type[equality])
    if kind == int(mj.mjtEq.mjEQ_JOINT):
        yield from (joint for joint in ends if joint >= 0)
    elif kind in (int(mj.mjtEq.mjEQ_CONNECT), int(mj.mjtEq.mjEQ_WELD)):
        sites = int(model.eq_objtype[equality]) == int(mj.mjtObj.mjOBJ_SITE)
        one, other = (mujoco.above(model, int(model.site_bodyid[e]) if sites else e) for e in ends)
        loop = one ^ other
        yield from (joint for joint in mujoco.turning(model) if model.jnt_bodyid[joint] in loop)


def _swept(
    model: Model, drives: tuple[Drive, ...], fingers: Sequence[int], *, flip: bool = False
) -> Hand | None:
    """The hand that drives close from one end to the other, if it is one and remains stable.

    flip: the last of them begins at its upper end.
    """
    moved = mujoco.without(model, "CONTACT")
    moved.opt.gravity[:] = 0.0
    mujoco.held_but(moved, fingers)
    data, joints = mujoco.at_key(moved), [drive.joint for drive in drives]
    start = np.array(data.qpos[model.jnt_qposadr[joints]])
    first, last = np.array(model.jnt_range[joints], dtype=float).T
    if flip:
        first[-1], last[-1] = last[-1], first[-1]
    targets, poses = np.linspace(first, last, SAMPLES), []
    for row in (*np.linspace(start, first, SETTLING), *targets):
        for drive, target in zip(drives, row, strict=True):
            data.ctrl[drive.ctrl_index] = drive.command(float(target))
        mj.mj_step(moved, data, max(1, round(SETTLE_S / float(model.opt.timestep))))
        poses.append(np.array(data.qpos))
    if not mujoco.is_finite(data):
        return None
    return _hand(model, drives, fingers, np.array(poses[SETTLING:]), targets)


# --- what closes --------------------------------------------------------------------------------


def _hand(
    model: Model, drives: tuple[Drive, ...], fingers: Sequence[int], poses: Array, targets: Array
) -> Hand | None:
    """The hand that a sweep shows; None where nothing closes."""
    bodies = [int(model.jnt_bodyid[joint]) for joint in fingers]
    palm = max(set.intersection(*(mujoco.above(model, body) - {body} for body in bodies)))
    states = [at_pose(model, pose) for pose in poses]
    sides = _sides(model, palm, bodies, states)
    if sides is None or not all(solid_geoms(model, side) for side in sides):
        return None
    one = _tips(model, palm, sides[0], states)
    if palm in sides[1]:
        other = _opposite(model, sides[1], states, one)
    else:
        other = _tips(model, palm, sides[1], states)
    widths = np.linalg.norm(one - other, axis=1)
    if widths[0] < widths[-1]:
        poses, targets, one, other, widths = (a[::-1] for a in (poses, targets, one, other, widths))
        states.reverse()
    base, other = _base(model, states[0], fingers, one, other)
    reach = max(np.linalg.norm(tips - base, axis=1).max() for tips in (one, other))
    closed_m = float(widths.min())
    if (
        widths[0] - closed_m < LEAST_OPENING_M
        or closed_m > MEETS * widths[0]
        or reach > LARGEST_M
        or _stands_on(model, states[0], sides)
    ):
        return None
    ways = one - base, other - base
    # Between both fingers, or along an axis of the palm where it is nearly that.
    middle = _unit(_unit(ways[0]) + _unit(ways[1]))
    axes = np.array(states[0].xmat[palm]).reshape(3, 3).T
    axes = np.concatenate([axes, -axes])
    nearest = axes[np.argmax(middle @ axes.T, axis=1)]
    straight = np.sum(nearest * middle, axis=1, keepdims=True) > math.cos(SKEW)
    along = np.where(straight, nearest, middle)
    gap = ways[1] - ways[0]
    gap = np.where(np.linalg.norm(gap, axis=1, keepdims=True) > 2e-3, gap, gap[0])
    across = _unit(gap - np.sum(gap * along, axis=1, keepdims=True) * along)
    one_side, other_side = (tuple(sorted(side)) for side in sides)
    tips, moving = (one + other) / 2.0, tuple(fingers)
    return Hand(palm, drives, (one_side, other_side), poses, targets, moving, tips, along, across)


def _sides(
    model: Model, palm: int, bodies: Sequence[int], states: Sequence[Data]
) -> tuple[set[int], set[int]] | None:
    """What moves as the widest way does, and what moves against it, else what stands still.

    bodies: of the fingers' joints. None where nothing moves.
    """
    tops = [body for body in range(model.nbody) if int(model.body_parentid[body]) == palm]
    branches = [mujoco.below(model, top) for top in tops]
    branches = [one for one in branches if one & {*bodies} and solid_geoms(model, one)]
    if not branches:
        return None
    tips = [_tips(model, palm, branch, states) for branch in branches]
    ways = [tip[-1] - tip[0] for tip in tips]
    main = max(ways, key=lambda way: float(way @ way))
    one, other = set[int](), set[int]()
    for branch, way in zip(branches, ways, strict=True):
        (one if way @ main >= 0.0 else other).update(branch)
    still = np.flatnonzero(model.body_weldid == model.body_weldid[palm])
    return one, other or set(still.tolist())


def _tips(model: Model, palm: int, side: Collection[int], states: Sequence[Data]) -> Array:
    """(n, 3) middle of the outermost corners of a side in every state, of the same material."""
    geoms, middle = solid_geoms(model, side), len(states) // 2
    points = [mujoco.outlines(model, data, geoms) for data in states]
    far = np.linalg.norm(points[middle] - states[middle].xpos[palm], axis=1)
    outer = far > far.max() - TIP_M
    return np.array([(e[outer].min(axis=0) + e[outer].max(axis=0)) / 2.0 for e in points])


def _opposite(model: Model, side: Collection[int], states: Sequence[Data], tips: Array) -> Array:
    """(n, 3) in every state the point of what stands still that the closed fingertip is nearest to.

    tips: (n, 3) of the finger, which is closed at one end.
    """
    best, nearest, probe = np.inf, np.zeros(3), int(model.geom(OBJECT).id)
    for data, tip in ((states[0], tips[0]), (states[-1], tips[-1])):
        data.geom_xpos[probe], ends = tip, np.zeros(6)
        for geom in solid_geoms(model, side):
            distance = mj.mj_geomDistance(model, data, probe, geom, LARGEST_M, ends)
            if distance < best:
                best, nearest = distance, np.array(ends[3:])
    return np.tile(nearest, (len(states), 1))


def _base(
    model: Model, data: Data, fingers: Sequence[int], one: Array, other: Array
) -> tuple[Array, Array]:
    """Where the fingers begin, the mean of the joints that no other of them moves; and `other`.

    Of a single such finger both lie in the plane in which it moves.
    """
    bodies = [int(model.jnt_bodyid[joint]) for joint in fingers]
    moved = set[int]().union(*(mujoco.below(model, body) - {body} for body in bodies))
    first = [joint for joint, body in zip(fingers, bodies, strict=True) if body not in moved]
    base: Array = np.mean(data.xanchor[first], axis=0)
    if len(first) == 1 and model.jnt_type[first[0]] == mj.mjtJoint.mjJNT_HINGE:
        axis = np.array(data.xaxis[first[0]])
        other = other + ((one - other) @ axis)[:, None] * axis
        base = base + ((one[0] - base) @ axis) * axis
    return base, other


def _stands_on(model: Model, data: Data, sides: Sequence[Collection[int]]) -> bool:
    """Whether a floating robot stands on what would be a finger: a leg."""
    if not mujoco.floats(model):
        return False

    def lowest(bodies: Collection[int]) -> float:
        return float(mujoco.outlines(model, data, solid_geoms(model, bodies))[:, 2].min())

    ground = lowest(mujoco.below(model, int(model.jnt_bodyid[0])))
    return any(lowest(side) < ground + TIP_M for side in sides)


def _unit(ways: Array) -> Array:
    units: Array = ways / np.linalg.norm(ways, axis=-1, keepdims=True)
    return units
