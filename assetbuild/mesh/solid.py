"""Which points lie in a mesh, open or closed, or in a convex piece."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assetbuild.errors import StepError
from assetbuild.mesh.hull import beyond, convex_hull, hull_planes
from assetbuild.mesh.primitives import signed_distance, tessellate
from assetbuild.mesh.triangles import TriangleMesh, face_normals
from assetbuild.mesh.volume import is_closed
from assetbuild.robot.pose import IDENTITY, Array, Pose
from assetbuild.robot.shapes import Primitive

RAYS = ((0.31, 0.67, 0.67), (-0.8, 0.36, 0.48), (0.1, -0.2, -0.97))
"""Directions of the parity test: skew, so that no ray runs along a wall."""
STEP = 1e-5
"""A ray goes on this share of the diagonal behind a surface: float32 must not hit it twice."""
CROSSINGS = 64
"""Most surfaces that one ray is followed through."""


Distance = Callable[[Array], Array]
"""Points (n, 3) of a body's frame to (n,) signed distances in m, negative inside."""


class Solid:
    """The inside of a mesh by ray parity: a point is inside when two of three rays say so.

    Exact for closed meshes up to the ray tracer's float32. For an open mesh four of six rays
    must say so, each of the three and its opposite: good for holes and gaps, and a sheet, which
    a ray strikes on one side only, has no inside.
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh as EmbreeMesh

        lower, upper = mesh.bounds
        self._middle = (lower + upper) / 2.0
        self._size = max(mesh.diagonal, 1e-300)
        self._rays = [np.asarray(ray) / np.linalg.norm(ray) for ray in RAYS]
        if not is_closed(mesh):
            self._rays += [-ray for ray in self._rays]
        self._scene = rtcore_scene.EmbreeScene()
        local = (mesh.corners - self._middle) / self._size
        # Parts that touch share a wall, twice in one place, and a ray would see it once: each
        # face moves inwards by less than matters and more than a step.
        corners = (local - 2.0 * STEP * face_normals(mesh)[:, None]).astype(np.float32)
        self._keep = EmbreeMesh(self._scene, corners)

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """(n,) True for points (n, 3) inside."""
        votes = np.zeros(len(points), dtype=np.int64)
        for ray in self._rays:
            votes += self._crossings(points, ray) % 2
        return np.asarray(votes > len(self._rays) // 2)

    def _crossings(self, points: Array, direction: Array) -> NDArray[np.int64]:
        """(n,) surfaces that rays from the points cross; in units of the diagonal."""
        origins = ((points - self._middle) / self._size).astype(np.float32)
        found = np.zeros(len(points), dtype=np.int64)
        active = np.arange(len(points))
        for _ in range(CROSSINGS):
            if not len(active):
                break
            rays = np.repeat(direction[None].astype(np.float32), len(active), axis=0)
            hit = self._scene.run(origins[active], rays, output=True)
            struck = hit["primID"] != -1
            active = active[struck]
            found[active] += 1
            step = hit["tfar"][struck][:, None] + np.float32(STEP)
            origins[active] += step * rays[struck]
        return found


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
    try:
        outside = beyond_hull(convex_hull(solid))
    except StepError:  # flat: no inside
        lower, upper = solid.min(axis=0), solid.max(axis=0)
        return lambda points: _beyond_box(lower, upper, X_solid_body.apply(points))
    return lambda points: outside(X_solid_body.apply(points))


def beyond_hull(hull: TriangleMesh) -> Distance:
    """Signed distance from a convex mesh; outside an edge as `distance_to`."""
    planes = hull_planes(hull)
    return lambda points: beyond(planes, points)


def _beyond_box(lower: Array, upper: Array, points: Array) -> Array:
    """(n,) distance of each point from a box without inside; zero in it."""
    apart = np.maximum(np.maximum(lower - points, points - upper), 0.0)
    distance: Array = np.linalg.norm(apart, axis=1)
    return distance


def sobol(count: int, lower: Array, upper: Array, seed: int = 0) -> Array:
    """(count, 3) scrambled Sobol points in a box; count: a power of two."""
    from scipy.stats import qmc

    sampler = qmc.Sobol(3, scramble=True, rng=np.random.default_rng(seed))
    return np.asarray(lower + sampler.random(count) * (upper - lower), dtype=np.float64)
