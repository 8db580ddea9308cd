"""The convex hulls of a robot's shapes, by body."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from assetbuild.mesh.arrays import read_meshes
from assetbuild.mesh.hull import hull_or_points
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.triangles import TriangleMesh, solid_moments
from assetbuild.robot.contradictions import Extent
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.pose import Array
from assetbuild.robot.shapes import Mesh, Role


def hulls_by_body(robot: RobotFiles) -> Mapping[tuple[str, Role], list[TriangleMesh]]:
    """(body, role) -> the hull of each of its shapes in the body's frame, m."""
    hulls = read_meshes(robot.hulls)
    by_body: dict[tuple[str, Role], list[TriangleMesh]] = {}
    for shape in robot.shapes.shapes:
        body, X_body_shape = robot.tree.shape_placement(shape)
        geometry = shape.geometry
        hull = hulls[geometry.mesh] if isinstance(geometry, Mesh) else tessellate(geometry)
        by_body.setdefault((body, shape.role), []).append(hull.placed(X_body_shape))
    return by_body


def common_hull(hulls: Sequence[TriangleMesh]) -> TriangleMesh:
    """The hull of several; where they lie in one plane, all their vertices and no face."""
    if len(hulls) == 1:
        return hulls[0]
    return hull_or_points(np.concatenate([hull.vertices for hull in hulls]))


def extent_of(points: Sequence[Array]) -> Extent:
    """What points (n, 3) of one body's shapes span; without volume where they lie in a plane."""
    hull = hull_or_points(np.concatenate(points))
    if not len(hull.faces):
        return Extent(hull.vertices, 0.0, np.zeros(3))
    volume, _, inertia = solid_moments(hull)
    return Extent(hull.vertices, float(volume), np.asarray(np.linalg.eigvalsh(inertia), np.float64))
