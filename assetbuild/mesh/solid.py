"""Which points lie in a mesh, open or closed, or in a convex piece."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assetbuild.mesh.hull import beyond, hull_or_points, hull_planes
from assetbuild.mesh.primitives import from_faces, signed_distance, tessellate
from assetbuild.mesh.rays import Across, Struck
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.pose import IDENTITY, Array, Pose
from assetbuild.robot.shapes import Primitive

RAYS = ((0.31, 0.67, 0.67), (-0.8, 0.36, 0.48), (0.1, -0.2, -0.97))
"""Directions of the parity test: skew, so that no ray runs along a wall."""
SAME = 1e-5
"""Share of the diagonal: two surfaces that lie closer and face alike are one."""


Distance = Callable[[Array], Array]
"""Points (n, 3) of a body's frame to (n,) signed distances in m, negative inside."""


class Solid:
    """The inside of a mesh by ray parity: a point is inside when two of three rays say so.

    Exact for closed meshes. For an open mesh four of six rays must say so, each of the three and
    its opposite: good for holes and gaps, and a sheet, which a ray strikes on one side only, has no
    inside.
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        self.mesh = mesh
        self._closed = mesh.is_closed
        self._same = SAME * mesh.diagonal
        self._views = functools.lru_cache(lambda ray: Across(mesh, np.asarray(ray)))

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """(n,) True for points (n, 3) inside."""
        each = 1 if self._closed else 2
        needed = len(RAYS) * each // 2 + 1
        votes = np.zeros(len(points), dtype=np.int64)
        open_ = np.arange(len(points))
        for left, ray in zip(reversed(range(len(RAYS))), RAYS, strict=True):
            struck = self._once(self._views(ray).strike(points[open_]))
            ahead = struck.depth > 0.0
            for side in (ahead, ~ahead)[:each]:
                votes[open_] += np.bincount(struck.ray[side], minlength=len(open_)) % 2
            # What the rays that are left cannot change is settled.
            open_ = open_[(votes[open_] < needed) & (votes[open_] + left * each >= needed)]
            if not len(open_):
                break
        return np.asarray(votes >= needed)

    def _once(self, struck: Struck) -> Struck:
        """Drop the second of two surfaces in one place that face alike: a face drawn twice."""
        kept = np.ones(len(struck.ray), dtype=bool)
        for front in (False, True):
            mine = np.flatnonzero(struck.front == front)
            ray, depth = struck.ray[mine], struck.depth[mine]
            again = (np.diff(ray) == 0) & (np.diff(depth) < self._same)
            kept[mine[1:][again]] = False
        return Struck(struck.ray[kept], struck.depth[kept], struck.front[kept])


@dataclass(frozen=True, eq=False)
class ConvexPiece:
    """One convex piece: a hull mesh in the common frame, or a primitive with its pose."""

    solid: TriangleMesh | Primitive
    X_frame_piece: Pose = IDENTITY

    def distance(self, points: Array) -> Array:
        """(n,) signed: exact sign; outside a hull it is a lower bound of the distance. m."""
        if isinstance(self.solid, TriangleMesh):
            return beyond_hull(self.solid)(points)
        return signed_distance(self.solid, self.X_frame_piece.inverse().apply(points))

    def surface(self) -> TriangleMesh:
        """Its triangles in the common frame."""
        if isinstance(self.solid, TriangleMesh):
            return self.solid
        return tessellate(self.solid).placed(self.X_frame_piece)


def distance_to(solid: Primitive | Array, X_body_solid: Pose) -> Distance:
    """Signed distance from a primitive, or from the convex hull of points (n, 3).

    Outside an edge of a hull the nearest plane counts, which is less than the distance; of points
    in one plane, which have no hull, the distance from their axis-aligned box.
    """
    X_solid_body = X_body_solid.inverse()
    if not isinstance(solid, np.ndarray):
        return lambda points: signed_distance(solid, X_solid_body.apply(points))
    outside = beyond_hull(hull_or_points(solid))
    return lambda points: outside(X_solid_body.apply(points))


def beyond_hull(hull: TriangleMesh) -> Distance:
    """Signed distance from a convex mesh, or from points without faces, as in `distance_to`."""
    if not len(hull.faces):
        box = np.array([hull.vertices.min(axis=0), hull.vertices.max(axis=0)])
        return lambda points: beyond_box(box, points)
    planes = hull_planes(hull)
    return lambda points: beyond(planes, points)


def beyond_box(box: Array, points: Array) -> Array:
    """(n,) distance of each of points (n, 3) from a box (2, 3), m; zero in it."""
    return np.maximum(from_faces(np.maximum(box[0] - points, points - box[1])), 0.0)
