"""Numbers computed from the bodies for people to read: principal axes, the centre of mass, a size.

A step, so that the report, which is written in the process that builds, computes none itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.inertia import matrix_of, principal_moments
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Control, Inertial, Keyframe, Tree
from assetbuild.robot.pose import Quat, Vec3, quat_of, vec3
from assetbuild.robot.tree import forward_kinematics


@dataclass(frozen=True)
class MeasuredBody:
    """A body with mass. moments_kg_m2: principal, rising; axes: their orientation in the body.

    semi_axes_m: of the solid ellipsoid with these moments; None: there is no such body.
    """

    name: str
    moments_kg_m2: Vec3
    axes: Quat
    semi_axes_m: Vec3 | None


@dataclass(frozen=True)
class Measured:
    """`bodies.json`. com_m: of the robot in the world at its initial pose; None without mass.

    size_m: from the root's frame at zero to the farthest body frame, 0.1 at least.
    """

    bodies: tuple[MeasuredBody, ...]
    com_m: Vec3 | None
    size_m: float

    @cached_property
    def by_body(self) -> dict[str, MeasuredBody]:
        """Bodies by name."""
        return {body.name: body for body in self.bodies}


class MeasureBodies(Step):
    """`tree.json` and the keyframes in `control.json` -> `bodies.json`."""

    shares = True
    outputs = ("bodies.json",)

    def run(self, files: Files) -> Iterable[Finding]:
        """Writes `Measured`."""
        robot = RobotFiles(files.inputs)
        measured = encode(measure(robot.tree, robot.control))
        (files.outputs / "bodies.json").write_bytes(measured)
        return ()


def measure(tree: Tree, control: Control) -> Measured:
    """All that the report shows of the bodies and cannot read in the tree."""
    bodies = [
        MeasuredBody(body.name, *principal(body.inertial), ellipsoid(body.inertial))
        for body in tree.bodies
        if body.inertial is not None
    ]
    com = center_of_mass(tree, initial_pose(tree, control))
    points = [pose.xyz for pose in forward_kinematics(tree, {}).values()]
    size = max([0.1, *(math.dist(points[0], point) for point in points)])
    return Measured(tuple(bodies), com, size)


def center_of_mass(tree: Tree, keyframe: Keyframe) -> Vec3 | None:
    """Return the whole robot's centre of mass in the world at a keyframe, m; None without mass."""
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
