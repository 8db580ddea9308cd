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
from assetbuild.simulators.mujoco import Data, Model, at_key, floats, is_finite, turning, without
from assetbuild.simulators.mujoco.drives import Drive, read_drives
from assetbuild.simulators.mujoco.trials import HELD_KG

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
HINGE = 3
"""`mjJNT_HINGE`."""
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


def find_hands(model: Model, probe: int) -> Iterator[Hand]:
    """Every gripper that one drive closes, or two drives of fingers that face each other.

    What has a drive for each of many joints closes in many ways: see `between_keys`.
    probe: a small sphere of the model that may be put anywhere.
    """
    drives = read_drives(model)
    driven = {drive.joint for drive in drives}
    ends = [d for d in drives if d.holds_position and _ends_in(model, d.joint, driven)]
    for drive in ends:
        fingers = sorted(_linked(model, drive.joint))
        yield from _swept(model, probe, (drive,), (False,), fingers)
    for one, other in itertools.combinations(ends, 2):
        above = [int(model.body_parentid[model.jnt_bodyid[d.joint]]) for d in (one, other)]
        if above[0] == above[1]:
            for flipped in (False, True):
                fingers = [one.joint, other.joint]
                yield from _swept(model, probe, (one, other), (False, flipped), fingers)


def _swept(
    model: Model,
    probe: int,
    drives: tuple[Drive, ...],
    flips: tuple[bool, ...],
    fingers: Sequence[int],
) -> Iterator[Hand]:
    """The hand that drives close from one end to the other, if it is one."""
    swept = _sweep(model, drives, flips, fingers)
    found = _hand(model, probe, drives, fingers, *swept) if swept is not None else None
    # Two fingers are a pair where they close on each other, not both on the palm.
    if found is not None and (len(drives) == 1 or found.palm not in found.sides[1]):
        yield found


def between_keys(model: Model, probe: int, opened: str, closed: str) -> Hand:
    """The hand whose joints differ between two keyframes; each of its drives moves evenly.

    Raises StepError where there is no such keyframe, or nothing closes between the two.
    """
    import mujoco

    keys = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, name) for name in (opened, closed)]
    for key, name in zip(keys, (opened, closed), strict=True):
        if key < 0:
            raise StepError(f"there is no keyframe `{name}`", hint="name one of `keyframes`")
    first, last = (np.array(model.key_qpos[key]) for key in keys)
    fingers = [j for j in turning(model) if first[(at := model.jnt_qposadr[j])] != last[at]]
    drives = tuple(d for d in read_drives(model) if d.holds_position and d.joint in fingers)
    share = np.linspace(0.0, 1.0, SAMPLES)[:, None]
    poses = first + share * (last - first)
    places = [int(model.jnt_qposadr[drive.joint]) for drive in drives]
    found = _hand(model, probe, drives, fingers, poses, poses[:, places]) if drives else None
    if found is None:
        raise StepError(
            f"no fingers come together between the keyframes `{opened}` and `{closed}`",
            hint="the keyframes differ in the joints of one hand, whose tips meet",
        )
    return found


def held_but(model: Model, fingers: Collection[int]) -> None:
    """Hold everything still but these joints, for a model that may be changed: see `HELD_KG`."""
    dofs = {int(model.jnt_dofadr[joint]) for joint in fingers}
    still = [dof for dof in range(model.nv) if dof not in dofs]
    model.dof_armature[still] = HELD_KG


def vertices(model: Model, data: Data, bodies: Sequence[int]) -> Array:
    """(n, 3) world corners of the shapes of bodies that can touch something."""
    import mujoco

    found = [np.zeros((0, 3))]
    for geom in solid_geoms(model, bodies):
        if int(model.geom_type[geom]) == int(mujoco.mjtGeom.mjGEOM_MESH):
            mesh = int(model.geom_dataid[geom])
            first = int(model.mesh_vertadr[mesh])
            local = np.array(model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])])
        else:
            middle, half = np.array(model.geom_aabb[geom]).reshape(2, 3)
            local = middle + half * np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
        R = np.array(data.geom_xmat[geom]).reshape(3, 3)
        found.append(local @ R.T + np.array(data.geom_xpos[geom]))
    return np.concatenate(found)


def solid_geoms(model: Model, bodies: Sequence[int]) -> list[int]:
    """Shapes of bodies that can touch something."""
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    return [int(geom) for geom in np.flatnonzero(solid & np.isin(model.geom_bodyid, bodies))]


def _ends_in(model: Model, joint: int, driven: set[int]) -> bool:
    """Whether a limited joint moves no other driven one."""
    below = _subtree(model, int(model.jnt_bodyid[joint]))
    return bool(model.jnt_limited[joint]) and not any(
        int(model.jnt_bodyid[other]) in below for other in driven - {joint}
    )


def _subtree(model: Model, top: int) -> set[int]:
    found = {top}
    for body in range(top + 1, model.nbody):
        if int(model.body_parentid[body]) in found:
            found.add(body)
    return found


def _sweep(
    model: Model, drives: Sequence[Drive], flips: Sequence[bool], fingers: Sequence[int]
) -> tuple[Array, Array] | None:
    """((n, nq) positions, (n, k) targets) from one end of the drives to the other.

    flips: which of them begins at its upper end. None where the simulation becomes unstable.
    """
    import mujoco

    model = without(model, "CONTACT")
    model.opt.gravity[:] = 0.0
    held_but(model, fingers)
    data = at_key(model)
    joints = [drive.joint for drive in drives]
    ends = [model.jnt_range[j][::-1] if flip else model.jnt_range[j]
            for j, flip in zip(joints, flips, strict=True)]  # fmt: skip
    first, last = np.array(ends, dtype=float).T
    start = np.array([float(data.qpos[int(model.jnt_qposadr[joint])]) for joint in joints])
    targets = np.linspace(first, last, SAMPLES)
    poses = []
    for row in (*np.linspace(start, first, SETTLING), *targets):
        for drive, target in zip(drives, row, strict=True):
            data.ctrl[drive.ctrl_index] = drive.command(float(target))
        mujoco.mj_step(model, data, max(1, round(SETTLE_S / float(model.opt.timestep))))
        poses.append(np.array(data.qpos))
    return (np.array(poses[SETTLING:]), targets) if is_finite(data) else None


def _linked(model: Model, joint: int) -> set[int]:
    """The joint and all that follow it, directly, through others or in closed loops."""
    active = (int(equality) for equality in np.flatnonzero(model.eq_active0))
    groups = [set(_constrained(model, equality)) for equality in active]
    found = {joint}
    while more := [group for group in groups if group & found and not group <= found]:
        found = found.union(*more)
    return found


def _constrained(model: Model, equality: int) -> Iterator[int]:
    """Joints that an equality couples; of bodies that it connects, those of the loop it closes."""
    import mujoco

    ends = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
    kind = int(model.eq_type[equality])
    if kind == int(mujoco.mjtEq.mjEQ_JOINT):
        yield from (joint for joint in ends if joint >= 0)
    elif kind in (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)):
        sites = int(model.eq_objtype[equality]) == int(mujoco.mjtObj.mjOBJ_SITE)
        one, other = (_line(model, int(model.site_bodyid[e]) if sites else e) for e in ends)
        yield from (joint for joint in turning(model) if model.jnt_bodyid[joint] in one ^ other)


def _line(model: Model, body: int) -> set[int]:
    """A body and all that it is on."""
    line = {body}
    while body:
        body = int(model.body_parentid[body])
        line.add(body)
    return line


def _hand(
    model: Model,
    probe: int,
    drives: tuple[Drive, ...],
    fingers: Sequence[int],
    poses: Array,
    targets: Array,
) -> Hand | None:
    """The hand that a sweep shows; None where nothing closes."""
    palm = _palm(model, fingers)
    tops = [body for body in range(model.nbody) if int(model.body_parentid[body]) == palm]
    branches = [_subtree(model, top) for top in tops]
    moved = [b for b in branches if _moves(model, b, fingers) and solid_geoms(model, sorted(b))]
    if not moved:
        return None
    tips = [_tips(model, palm, sorted(branch), poses) for branch in moved]
    ways = [tip[-1] - tip[0] for tip in tips]
    main = max(ways, key=lambda way: float(way @ way))
    sides: list[set[int]] = [set(), set()]
    for branch, way in zip(moved, ways, strict=True):
        sides[0 if way @ main >= 0.0 else 1] |= branch
    one = _tips(model, palm, sorted(sides[0]), poses)
    if sides[1]:
        other = _tips(model, palm, sorted(sides[1]), poses)
    else:
        sides[1] = set(np.flatnonzero(model.body_weldid == model.body_weldid[palm]).tolist())
        if not solid_geoms(model, sorted(sides[1])):
            return None
        other = _opposite(model, probe, sorted(sides[1]), poses, one)
    widths = np.linalg.norm(one - other, axis=1)
    if widths[0] < widths[-1]:
        poses, targets, one, other, widths = (a[::-1] for a in (poses, targets, one, other, widths))
    data = at_pose(model, poses[0])
    first = _first(model, fingers)
    base = np.mean([data.xanchor[joint] for joint in first], axis=0)
    if len(first) == 1:  # everything in the plane in which the one finger moves
        axis = np.array(data.xaxis[first[0]]) * (int(model.jnt_type[first[0]]) == HINGE)
        other = other + ((one - other) @ axis)[:, None] * axis
        base = base + ((one[0] - base) @ axis) * axis
    reach = max(np.linalg.norm(tips - base, axis=1).max() for tips in (one, other))
    closed_m = float(widths.min())
    if (
        widths[0] - closed_m < LEAST_OPENING_M
        or closed_m > MEETS * widths[0]
        or reach > LARGEST_M
        or _stands_on(model, data, sides)
    ):
        return None
    along, across = _axes(model, palm, poses[0], one - base, other - base)
    return Hand(
        palm,
        drives,
        (tuple(sorted(sides[0])), tuple(sorted(sides[1]))),
        poses,
        targets,
        tuple(fingers),
        (one + other) / 2.0,
        along,
        across,
    )


def _first(model: Model, fingers: Sequence[int]) -> list[int]:
    """The joints of a hand that no other of its joints moves."""
    bodies = [int(model.jnt_bodyid[joint]) for joint in fingers]
    moved = set[int]().union(*(_subtree(model, body) - {body} for body in bodies))
    return [joint for joint, body in zip(fingers, bodies, strict=True) if body not in moved]


def _stands_on(model: Model, data: Data, sides: Sequence[set[int]]) -> bool:
    """Whether a floating robot stands on what would be a finger: a leg."""
    if not floats(model):
        return False
    root = int(model.jnt_bodyid[0])
    lowest = vertices(model, data, sorted(_subtree(model, root)))[:, 2].min()
    return any(vertices(model, data, sorted(side))[:, 2].min() < lowest + TIP_M for side in sides)


def _axes(model: Model, palm: int, pose: Array, one: Array, other: Array) -> tuple[Array, Array]:
    """((n, 3) directions between both fingers, (n, 3) from the first to the second across them).

    one, other: (n, 3) of the fingertips from where the fingers begin.
    """

    def unit(ways: Array) -> Array:
        units: Array = ways / np.linalg.norm(ways, axis=-1, keepdims=True)
        return units

    along = np.array([_straight(way, model, pose, palm) for way in unit(unit(one) + unit(other))])
    gap = other - one
    gap = np.where(np.linalg.norm(gap, axis=1, keepdims=True) > 2e-3, gap, gap[0])
    return along, unit(gap - np.sum(gap * along, axis=1, keepdims=True) * along)


def _straight(way: Array, model: Model, pose: Array, body: int) -> Array:
    """The axis of a body that points nearly this way; the way itself where none does."""
    axes = np.array(at_pose(model, pose).xmat[body]).reshape(3, 3).T
    axes = np.concatenate([axes, -axes])
    best: Array = axes[np.argmax(axes @ way)]
    return best if best @ way > math.cos(SKEW) * np.linalg.norm(way) else way


def _palm(model: Model, fingers: Sequence[int]) -> int:
    """The last body above all these joints."""
    bodies = [int(model.jnt_bodyid[joint]) for joint in fingers]
    above = [_line(model, body) - {body} for body in bodies]
    return max(set.intersection(*above))


def _moves(model: Model, bodies: set[int], fingers: Sequence[int]) -> bool:
    return any(int(model.jnt_bodyid[joint]) in bodies for joint in fingers)


def at_pose(model: Model, pose: Array) -> Data:
    """The model's shapes where (nq,) positions put them; nothing else is computed."""
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[:] = pose
    mujoco.mj_kinematics(model, data)
    return data


def _tips(model: Model, palm: int, side: Sequence[int], poses: Array) -> Array:
    """(n, 3) middle of the outermost corners of a side in every pose, of the same material."""
    states = [at_pose(model, pose) for pose in poses]
    points = [vertices(model, data, side) for data in states]
    middle = len(poses) // 2
    far = np.linalg.norm(points[middle] - states[middle].xpos[palm], axis=1)
    outer = far > far.max() - TIP_M
    return np.array([(e[outer].min(axis=0) + e[outer].max(axis=0)) / 2.0 for e in points])


def _opposite(model: Model, probe: int, side: Sequence[int], poses: Array, tips: Array) -> Array:
    """(n, 3) in every pose the point of what stands still that the closed fingertip is nearest to.

    tips: (n, 3) of the finger, which is closed at one end.
    """
    import mujoco

    best, found = np.inf, np.zeros(3)
    for pose, tip in ((poses[0], tips[0]), (poses[-1], tips[-1])):
        data, ends = at_pose(model, pose), np.zeros(6)
        data.geom_xpos[probe] = tip
        for geom in solid_geoms(model, side):
            distance = mujoco.mj_geomDistance(model, data, probe, geom, LARGEST_M, ends)
            if distance < best:
                best, found = distance, np.array(ends[3:])
    return np.tile(found, (len(poses), 1))
