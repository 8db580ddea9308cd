"""Joint-space dynamics of a tree at rest: mass matrix, gravity, and what drives feel.

Small and dense on purpose: bodies times degrees of freedom is a few thousand numbers, and the
formulas stay readable. Coordinates: of a floating base first its linear, then its angular velocity
(world axes, at the origin of the root), then the moving joints in tree order.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from assetbuild.robot.inertia import matrix_of
from assetbuild.robot.mimic import leading, with_mimics
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import Array, Pose, cross
from assetbuild.robot.shapes import Shapes, Sphere
from assetbuild.robot.tree import forward_kinematics


@dataclass(frozen=True)
class Motion:
    """How one body moves with the coordinates: (3, nv) Jacobians at its origin, world axes."""

    pose: Pose
    linear: Array
    angular: Array

    def at(self, point: Array) -> Array:
        """(3, nv) Jacobian of the velocity of a point of the body, given in world, m."""
        arm = point - np.asarray(self.pose.xyz)
        moved: Array = self.linear + cross(self.angular.T, arm[np.newaxis]).T
        return moved


@dataclass(frozen=True)
class Motions:
    """How bodies move. joints: names by column after the base's; free: columns of the base, 6 or 0.

    Joints that mimic have no column: they move their leader's.
    """

    joints: tuple[str, ...]
    free: int
    bodies: Mapping[str, Motion]

    def column(self, joint: str) -> int:
        """Return the column of a joint's coordinate."""
        return self.free + self.joints.index(joint)


@dataclass(frozen=True)
class Dynamics(Motions):
    """mass: (nv, nv) with armature; gravity: (nv,) generalised forces that hold the robot against
    gravity, N m or N.
    """

    mass: Array
    gravity: Array

    def effective_inertia(self, ways: Array | None = None) -> dict[str, float]:
        """What a torque at one joint accelerates when nothing else pushes: 1 / (M^-1)_ii.

        kg m2 or kg; infinite where nothing moves. ways: (nv, k), the velocities that loops leave;
        None = all.
        """
        basis = np.eye(len(self.mass)) if ways is None else ways
        inverse = basis @ np.linalg.pinv(basis.T @ self.mass @ basis, hermitian=True) @ basis.T
        inertias = {}
        for joint in self.joints:
            compliance = float(inverse[self.column(joint), self.column(joint)])
            inertias[joint] = 1.0 / compliance if compliance > 0.0 else float("inf")
        return inertias


def dynamics(
    tree: Tree,
    positions: Mapping[str, float],
    armature: Mapping[str, float],
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
    base: Pose | None = None,
) -> Dynamics:
    """Mass matrix and gravity of a tree at rest in one pose.

    M = sum over bodies of m Jv^T Jv + Jw^T I Jw, Jv at the centre of mass; Featherstone, Rigid
    Body Dynamics Algorithms, 6.2 (the definition that CRBA computes recursively). positions by
    joint name, rad or m; armature by joint name, kg m2 or kg; gravity: m/s2, world.
    base: X_world_root; None = where a fixed root is held, a floating one in the origin.
    Planar and floating joints inside the tree stand still.
    """
    moving = motions(tree, positions, base)
    leaders, free = moving.joints, moving.free
    nv = free + len(leaders)
    mass, held = np.zeros((nv, nv)), np.zeros(nv)
    for body in tree.bodies:
        inertial = body.inertial
        if inertial is None:
            continue
        motion = moving.bodies[body.name]
        linear = motion.at(motion.pose.apply(inertial.com_m))
        turn = motion.pose.rotation
        tensor = turn @ matrix_of(inertial.inertia_com_kg_m2) @ turn.T
        mass += inertial.mass_kg * linear.T @ linear + motion.angular.T @ tensor @ motion.angular
        held -= inertial.mass_kg * np.asarray(gravity) @ linear
    for name, gain in _leader_gains(tree, leaders, free).items():
        mass += armature.get(name, 0.0) * np.outer(gain, gain)
    return Dynamics(leaders, free, moving.bodies, mass, held)


def motions(tree: Tree, positions: Mapping[str, float], base: Pose | None = None) -> Motions:
    """Jacobians of every body in one pose; the arguments are those of `dynamics`."""
    free = 6 if tree.base == "floating" else 0
    leaders = tuple(joint.name for joint in tree.moving_joints if joint.mimic is None)
    gains = _leader_gains(tree, leaders, free)
    q, X_world_root = with_mimics(tree, positions), base or tree.X_world_root
    poses = {name: X_world_root @ pose for name, pose in forward_kinematics(tree, q).items()}
    nv = free + len(leaders)
    linear, angular = np.zeros((3, nv)), np.zeros((3, nv))
    if free:
        linear[:, :3], angular[:, 3:6] = np.eye(3), np.eye(3)
    bodies = {tree.root: Motion(poses[tree.root], linear, angular)}
    for joint in tree.joints:
        parent, pose = bodies[joint.parent], poses[joint.child]
        linear = parent.at(np.asarray(pose.xyz))
        angular = parent.angular.copy()
        if joint.name in gains:
            X_world_joint = parent.pose @ joint.X_parent_joint
            axis = X_world_joint.rotation @ np.asarray(joint.axis)
            step = np.outer(axis, gains[joint.name])
            if joint.kind == "prismatic":
                linear = linear + step
            else:
                angular += step  # the child's origin lies on the axis
        bodies[joint.child] = Motion(pose, linear, angular)
    return Motions(leaders, free, bodies)


def _leader_gains(tree: Tree, leaders: Sequence[str], free: int) -> dict[str, Array]:
    """Return dq of each moving joint over d of all coordinates, (nv,), in tree order."""
    gains: dict[str, Array] = {}
    for joint in tree.moving_joints:
        leader, factor, _ = leading(tree, joint)
        row = np.zeros(free + len(leaders))
        row[free + leaders.index(leader.name)] = factor
        gains[joint.name] = row
    return gains


def holding_torques(
    robot: Dynamics, feet: Sequence[tuple[str, Array]]
) -> tuple[dict[str, float], float]:
    """Torque of each joint that holds the pose with the feet on the ground, N m or N.

    feet: (body, point in world) of the contacts. The ground pushes against gravity and never
    pulls; of the forces that balance the base best the most even ones are taken, so left and right
    share a load. No force is therefore above the weight, however near the feet are to one line.
    The second value is the part of the base's weight that no foot can take, relative: 0 is balance.
    """
    forces = np.zeros(len(robot.gravity))
    left_over = 0.0
    if robot.free:
        weight = robot.gravity[: robot.free]
        size = float(np.linalg.norm(weight)) or 1.0
        if feet:
            up = weight[:3] / (float(np.linalg.norm(weight[:3])) or 1.0)
            rows = np.vstack([up @ robot.bodies[body].at(point) for body, point in feet])
            forces = rows.T @ _pushes(rows[:, : robot.free].T, weight)
        left_over = float(np.linalg.norm(weight - forces[: robot.free])) / size
    torque = robot.gravity - forces
    return {joint: float(torque[robot.column(joint)]) for joint in robot.joints}, left_over


EVEN = 1e-5
"""Weight of a force against what it leaves unbalanced: enough to make equal feet push equally."""


def _pushes(wrenches: Array, weight: Array) -> Array:
    """(n,) N, none negative; wrenches: (6, n) of a push of 1 N by each foot, weight: (6,).

    Least squares with a small penalty on uneven forces; a foot that would have to pull is lifted,
    the worst first, until all push. (SciPy's `nnls` would cost half a second of import.)
    """
    pushes = np.zeros(wrenches.shape[1])
    standing = np.arange(len(pushes))
    while len(standing):
        rows = np.vstack([wrenches[:, standing], EVEN * np.eye(len(standing))])
        target = np.concatenate([weight, np.zeros(len(standing))])
        forces = np.linalg.lstsq(rows, target, rcond=None)[0]
        if forces.min() >= 0.0:
            pushes[standing] = forces
            break
        standing = np.delete(standing, int(forces.argmin()))
    return pushes


def soles(
    tree: Tree, shapes: Shapes, robot: Dynamics, feet: str | None
) -> Sequence[tuple[str, Array]]:
    """(body, world point) where each foot's shapes touch the ground: below their centres."""
    points = []
    for shape in shapes.of("collision"):
        if feet is not None and re.fullmatch(feet, shape.link) is None:
            continue
        body, X_body_link = tree.placement(shape.link)
        X_world_shape = robot.bodies[body].pose @ X_body_link @ shape.X_link_shape
        # Other shapes touch at their centres: no mesh is read here.
        drop = shape.geometry.radius if isinstance(shape.geometry, Sphere) else 0.0
        points.append((body, np.asarray(X_world_shape.xyz) - (0.0, 0.0, drop)))
    if feet is None and points:
        ground = min(point[2] for _, point in points)
        points = [(body, point) for body, point in points if point[2] - ground < 0.01]
    return points
