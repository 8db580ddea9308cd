"""The mass matrix of a robot whose loops are closed, by two libraries.

MuJoCo's side: the Jacobian of the equality constraints that our MJCF compiles to, and its mass
matrix. Pinocchio's: its Jacobians of the frames at both ends, on the links of the source. Both
reduce M to N^T M N, N spanning the null space of the Jacobian and scaled so that the same
independent coordinates are the identity in both.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from assetbuild.checks.oracle.sides import MujocoSide, PinocchioSide
from assetbuild.robot.closure import close, coordinates, free_motions
from assetbuild.robot.dynamics import dynamics, leader_gains, motions
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.loops import path_of
from assetbuild.robot.model import Control, Loop, Tree
from assetbuild.robot.pose import Array

SEED = 5
STEP = 0.2
"""rad or m: how far a pose lies from the initial one, along a free motion of the closed robot."""


def closed_poses(tree: Tree, loops: Sequence[Loop], count: int) -> Iterator[dict[str, float]]:
    """The closed pose nearest to 0, and others beside it in which every loop is closed."""
    chain = {joint.name for loop in loops for joint in path_of(tree, loop)}
    start = dict(initial_pose(tree, Control()).joints)
    nearest = close(tree, loops, start, chain)
    random, robot = np.random.default_rng(SEED), motions(tree, nearest.positions)
    basis = free_motions(loops, robot.bodies)[robot.free :]
    for number in range(count if nearest.closed else 0):
        way = basis @ random.normal(size=basis.shape[1])
        size = float(np.abs(way).max(initial=0.0))
        moved = dict(nearest.positions)
        if number and size:
            steps = zip(robot.joints, STEP * way / size, strict=True)
            moved |= {name: moved[name] + float(step) for name, step in steps}
        found = close(tree, loops, moved, chain, 1)
        if found.closed:
            yield dict(found.positions)


def constrained_error(
    pin: PinocchioSide, mj: MujocoSide, loops: Sequence[Loop], q: Mapping[str, float]
) -> float:
    """Largest |difference| / sqrt(M_ii M_jj) of the two reduced matrices in one closed pose.

    Both robots stand there already. The base stays where it is.
    """
    held = replace(mj.tree, base="fixed")
    robot = dynamics(held, q, {})
    chosen = list(coordinates(loops, robot, ()))
    gains = leader_gains(held, robot.joints)
    reduced = [
        _reduced(side.mass_matrix(), jacobian, [side.dof[name] for name in gains], chosen, gains)
        for side, jacobian in (
            (mj, mj.constraint_jacobian()),
            (pin, pin.constraint_jacobian(loops)),
        )
    ]
    root = np.sqrt(np.diag(reduced[1]))
    return float((np.abs(reduced[0] - reduced[1]) / np.outer(root, root)).max(initial=0.0))


def _reduced(
    mass: Array,
    jacobian: Array,
    columns: Sequence[int],
    chosen: Sequence[int],
    gains: Mapping[str, Array],
) -> Array:
    """N^T M N over the joints' columns, mimics folded into their leaders; N is 1 in the chosen."""
    leaders = np.array(list(gains.values()))
    mass = leaders.T @ mass[np.ix_(columns, columns)] @ leaders
    jacobian = jacobian[:, columns] @ leaders
    _, sizes, rows = np.linalg.svd(jacobian, full_matrices=True)
    rank = int((sizes > 1e-8 * max(float(sizes.max(initial=0.0)), 1.0)).sum())
    basis = rows[rank:].T
    moved = basis @ np.linalg.pinv(basis[list(chosen)])
    reduced: Array = moved.T @ mass @ moved
    return reduced
