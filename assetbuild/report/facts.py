"""What is computed from the robot for people to read: totals, poses, principal axes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from assetbuild.recipe.models import Recipe
from assetbuild.robot.inertia import matrix_of, principal_moments
from assetbuild.robot.model import Control, Inertial, Keyframe, Tree
from assetbuild.robot.pose import Quat, Vec3, quat_of, vec3
from assetbuild.robot.shapes import Shapes
from assetbuild.robot.tree import forward_kinematics


@dataclass(frozen=True)
class Subject:
    """Everything that a report reads. pin: what the lock says of the source."""

    recipe: Recipe
    pin: Mapping[str, object]
    tree: Tree
    shapes: Shapes
    control: Control


def center_of_mass(tree: Tree, keyframe: Keyframe) -> Vec3 | None:
    """Of the whole robot in the world at a keyframe, m; None without mass."""
    X_root_body = forward_kinematics(tree, dict(keyframe.joints))
    X_world_root = tree.root_pose(keyframe)
    mass, moment = 0.0, np.zeros(3)
    for body in tree.bodies:
        if body.inertial is not None:
            com = (X_world_root @ X_root_body[body.name]).apply(body.inertial.com_m)
            mass += body.inertial.mass_kg
            moment += body.inertial.mass_kg * com
    return vec3(moment / mass) if mass > 0.0 else None


def principal(inertial: Inertial) -> tuple[Vec3, Quat]:
    """(principal moments in rising order, kg m2; orientation of their axes in the body)."""
    moments = principal_moments(inertial.inertia_com_kg_m2)
    _, axes = np.linalg.eigh(matrix_of(inertial.inertia_com_kg_m2))
    if np.linalg.det(axes) < 0.0:
        axes[:, 2] *= -1.0
    return moments, quat_of(axes)


def ellipsoid(inertial: Inertial) -> Vec3 | None:
    """Semi-axes (m) of the solid ellipsoid with these principal moments; None: no such body.

    Solid ellipsoid: A = m (b^2 + c^2) / 5 and cyclic, so a^2 = 5/2 (B + C - A) / m.
    """
    a, b, c = principal_moments(inertial.inertia_com_kg_m2)
    if inertial.mass_kg <= 0.0:
        return None
    squares = [2.5 * v / inertial.mass_kg for v in (b + c - a, a + c - b, a + b - c)]
    if min(squares) < -1e-6 * max(squares):
        return None
    return vec3([math.sqrt(max(v, 0.0)) for v in squares])
