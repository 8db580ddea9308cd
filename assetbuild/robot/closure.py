"""Do the loops of a robot close, how, and what can still move?

A loop's gap is what its constraint must bring to zero: the way from the one point to the other,
m, and of a weld also the turn between the frames, rad. Gaps and their Jacobians are in the axes of
frame a, where the base's own motion does not show.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from assetbuild.robot.dynamics import Dynamics, Motion, motions
from assetbuild.robot.loops import joints_of
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Control, Joint, Loop, Tree
from assetbuild.robot.pose import Array, Pose
from assetbuild.robot.tree import forward_kinematics

CLOSED = 1e-9
"""m and rad: a loop with a larger gap is open."""
LARGEST_STEP = 0.3
"""rad or m: of one joint, in one step of the solver."""
STEPS = 100
DAMPING = 0.1
"""Damping of a step for each metre of gap: a chain stretched towards a far point comes to rest."""
BETTER, PATIENCE = 0.99, 8
"""A start is given up after so many steps that leave this share of the gap or more."""
STARTS = 24
SEED = 7
RANK = 1e-8
"""A direction whose singular value is below this share of the largest one is not constrained."""
SLACK = 1e-4
"""A motion that opens a loop by less, m per rad, is free: CAD exports put pins and axes so far off,
simulators give way by as much, and no lever is as short."""
STILL = 1e-6
"""A joint that moves by less than this share of a free motion does not take part in it."""


@dataclass(frozen=True)
class Solution:
    """Positions of all moving joints, rad or m, and the largest gap that is left, m or rad."""

    positions: Mapping[str, float]
    residual: float

    @property
    def closed(self) -> bool:
        """Every loop is closed."""
        return self.residual < CLOSED


def gap(loop: Loop, poses: Mapping[str, Pose]) -> Array:
    """(3,) m of a `connect`, (6,) m and rad of a `weld`. poses: X_root_body by body."""
    X_root_a, X_root_b = (poses[end.body] @ end.X_body_end for end in loop.ends)
    X_a_b = X_root_a.inverse() @ X_root_b
    if loop.kind == "connect":
        return np.asarray(X_a_b.xyz)
    w, *v = X_a_b.quat
    sine = float(np.linalg.norm(v))
    turn = np.asarray(v) * (2.0 * np.arctan2(sine, w) / sine if sine > 0.0 else 2.0)
    return np.concatenate([X_a_b.xyz, turn])


def gaps(tree: Tree, loops: Sequence[Loop], q: Mapping[str, float]) -> dict[str, float]:
    """The size of each loop's gap by its name: the larger of m and rad. q: of all moving joints."""
    poses = forward_kinematics(tree, q)
    sizes = {}
    for loop in loops:
        parts = gap(loop, poses).reshape(-1, 3)
        sizes[loop.name] = float(np.linalg.norm(parts, axis=1).max())
    return sizes


def constraint_jacobian(loops: Sequence[Loop], bodies: Mapping[str, Motion]) -> Array:
    """(rows, nv) of all loops: d gap / d v, for closed loops, in the axes of each frame a."""
    rows = []
    for loop in loops:
        moving = [bodies[end.body] for end in loop.ends]
        places = [m.pose @ end.X_body_end for m, end in zip(moving, loop.ends, strict=True)]
        into_a = places[0].rotation.T
        # Of body a as well where b is: seen from there, b alone moves.
        at_b = np.asarray(places[1].xyz)
        rows.append(into_a @ (moving[1].at(at_b) - moving[0].at(at_b)))
        if loop.kind == "weld":
            rows.append(into_a @ (moving[1].angular - moving[0].angular))
    return np.vstack(rows)


def close(
    tree: Tree,
    loops: Sequence[Loop],
    start: Mapping[str, float],
    free: Collection[str],
    starts: int = STARTS,
) -> Solution:
    """Move the `free` joints from `start` until all loops close, by as little as it takes.

    Other starts within the limits are tried where this one leads nowhere, or beyond a limit; the
    same input gives the same result. Without success the smallest gap that was found.
    """
    known = with_mimics(tree, start)
    chosen = [j for j in tree.moving_joints if j.name in free and j.mimic is None]
    best = Solution(known, _residual(tree, loops, known))
    if best.closed:
        return best
    inside = False
    for guess in itertools.islice(_starts(chosen, known), starts):
        solution = _descend(tree, loops, guess, [joint.name for joint in chosen])
        fits = solution.closed and all(
            _within(joint, solution.positions[joint.name]) for joint in chosen
        )
        if (not best.closed and solution.residual < best.residual) or (fits and not inside):
            best, inside = solution, fits
        if inside or not chosen:
            break
    return best


def _residual(tree: Tree, loops: Sequence[Loop], q: Mapping[str, float]) -> float:
    return max(gaps(tree, loops, q).values(), default=0.0)


def _starts(free: Sequence[Joint], known: Mapping[str, float]) -> Iterator[dict[str, float]]:
    """The given one, then random ones within the limits, ever farther away from it."""
    yield dict(known)
    random = np.random.default_rng(SEED)
    for number in range(1, STARTS):
        width = np.pi * number / STARTS
        moved = dict(known)
        for joint in free:
            q = known[joint.name] + float(random.uniform(-width, width))
            if joint.range is not None and joint.range[0] < joint.range[1]:
                q = min(max(q, joint.range[0]), joint.range[1])
            moved[joint.name] = q
        yield moved


def _within(joint: Joint, value: float) -> bool:
    low, high = joint.bounds
    return low - CLOSED <= value <= high + CLOSED


def _descend(
    tree: Tree, loops: Sequence[Loop], start: Mapping[str, float], free: Sequence[str]
) -> Solution:
    """Levenberg and Marquardt: damped by the gap, so that it ends as fast as Newton."""
    q = with_mimics(tree, start)
    best, since = Solution(q, _residual(tree, loops, q)), 0
    for _ in range(STEPS):
        moving = motions(tree, q)
        poses = {name: motion.pose for name, motion in moving.bodies.items()}
        open_by = np.concatenate([gap(loop, poses) for loop in loops])
        columns = [moving.column(name) for name in free]
        jacobian = constraint_jacobian(loops, moving.bodies)[:, columns]
        damping = DAMPING * float(np.linalg.norm(open_by)) * np.eye(len(free))
        rows = np.vstack([jacobian, damping])
        step = -np.linalg.lstsq(rows, np.pad(open_by, (0, len(free))), rcond=RANK**2)[0]
        largest = float(np.abs(step).max(initial=0.0))
        step *= min(1.0, LARGEST_STEP / largest) if largest else 1.0
        moved = {name: q[name] + float(d) for name, d in zip(free, step, strict=True)}
        q = with_mimics(tree, {**q, **moved})
        solution = Solution(q, _residual(tree, loops, q))
        since = 0 if solution.residual < best.residual * BETTER else since + 1
        best = solution if solution.residual < best.residual else best
        if since and (best.closed or since > PATIENCE or largest < CLOSED * RANK):
            break
    return best


# --- what can move ------------------------------------------------------------------------------


def free_motions(loops: Sequence[Loop], bodies: Mapping[str, Motion]) -> Array:
    """(nv, k): an orthonormal basis of the velocities that keep all loops closed."""
    jacobian = constraint_jacobian(loops, bodies)
    _, sizes, rows = np.linalg.svd(jacobian, full_matrices=True)
    rank = int((sizes > SLACK * max(float(sizes.max(initial=0.0)), 1.0)).sum())
    basis: Array = rows[rank:].T.copy()
    basis[np.linalg.norm(basis, axis=1) < STILL] = 0.0
    return basis


def locked_joints(
    tree: Tree, loops: Sequence[Loop], q: Mapping[str, float], joints: Collection[str]
) -> tuple[str, ...]:
    """Those of `joints` that the loops keep from moving, at q and wherever they lead from there.

    A crank at its dead centre stands still for a moment, so each free motion is followed a little.
    """
    locked = _still(tree, loops, q, joints)
    if not locked:
        return ()
    names = [joint.name for joint in tree.moving_joints if joint.mimic is None]
    moving = motions(tree, q)
    for motion in free_motions(loops, moving.bodies)[moving.free :].T:
        size = float(np.abs(motion).max(initial=0.0))
        if size < STILL:
            continue
        moved = {
            name: q[name] + 0.05 * float(d) / size for name, d in zip(names, motion, strict=True)
        }
        solution = close(tree, loops, {**q, **moved}, names, 1)
        if solution.closed:
            locked = _still(tree, loops, solution.positions, locked)
    return locked


def _still(
    tree: Tree, loops: Sequence[Loop], q: Mapping[str, float], joints: Collection[str]
) -> tuple[str, ...]:
    moving = motions(tree, q)
    basis = free_motions(loops, moving.bodies)[moving.free :]
    held = joints_of(tree, loops)
    return tuple(
        name
        for name in joints
        if name in held and name in moving.joints and not basis[moving.joints.index(name)].any()
    )


def coordinates(loops: Sequence[Loop], robot: Dynamics, first: Collection[str]) -> tuple[int, ...]:
    """Columns that describe the motion of the closed robot: the base's, then of joints.

    Joints of `first`, the driven ones, are taken before all others as long as they are independent.
    """
    basis = free_motions(loops, robot.bodies)
    order = [*range(robot.free)]
    order += [robot.column(name) for name in robot.joints if name in first]
    order += [column for column in range(len(basis)) if column not in set(order)]
    chosen: list[int] = []
    for column in order:
        rows = basis[[*chosen, column]]
        if len(chosen) < basis.shape[1] and np.linalg.svd(rows, compute_uv=False)[-1] > 1e-6:
            chosen.append(column)
    return tuple(chosen)


STEPS_ASIDE = 8
"""Poses that are looked at to either side of the first one."""
REACH = {True: 0.1, False: 1.5}
"""m of a slide, rad of a hinge: no farther from the first pose, within the limits."""


def felt_inertia(loops: Sequence[Loop], robot: Dynamics) -> dict[str, float]:
    """The inertia that each joint feels, kg m2 or kg; infinite where the loops lock the joint."""
    return robot.effective_inertia(free_motions(loops, robot.bodies) if loops else None)


def poses_along(
    tree: Tree, control: Control, home: Mapping[str, float], joint: Joint, free: set[str]
) -> Iterator[dict[str, float]]:
    """Closed ones while one joint moves away from home, the first included; `free` ones follow."""
    first = with_mimics(tree, home)
    yield first
    reach = REACH[joint.kind == "prismatic"]
    lower, upper = joint.bounds
    for end in (-reach, reach):
        pose = first
        for step in range(1, STEPS_ASIDE + 1):
            asked = first[joint.name] + end * step / STEPS_ASIDE
            if not lower <= asked <= upper:
                break
            solved = close(tree, control.loops, {**pose, joint.name: asked}, free, 1)
            if not solved.closed:
                break
            pose = dict(solved.positions)
            yield pose
