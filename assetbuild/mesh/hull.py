"""Convex hulls by qhull, with outward faces and an exact cap on vertices."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from assetbuild.errors import StepError
from assetbuild.mesh.triangles import Indices, TriangleMesh
from assetbuild.robot.pose import Array

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

FLAT = 1e-7
"""Points whose smallest extent is below this share of the largest span no volume."""


def convex_hull(points: Array, *, max_vertices: int | None = None, subject: str = "mesh") -> (
    TriangleMesh
):
    """The convex hull of points (n, 3) m: outward triangles; its vertices are input points.

    max_vertices: at least 4; qhull then takes the farthest point next and stops in time, so
    the hull lies inside the full one and the cap is never exceeded.
    Raises StepError when the points lie in a plane, on a line or in one spot.
    """
    finite = np.asarray(points, dtype=np.float64)
    if not np.isfinite(finite).all():
        raise StepError(f"{subject}: not all vertices are finite numbers")
    distinct = np.unique(finite + 0.0, axis=0)
    _refuse_flat(distinct, subject)
    hull = _qhull(distinct, "Qt", subject)
    if max_vertices is not None and len(hull.vertices) > max_vertices:
        # "TAn" stops after n points beyond the first simplex of four (MuJoCo's maxhullvert).
        kept = _qhull(distinct, f"Qt TA{max_vertices - 4}", subject).vertices
        distinct = distinct[np.sort(kept)]
        hull = _qhull(distinct, "Qt", subject)
    return _outward(distinct, hull)


def hull_planes(hull: TriangleMesh) -> Array:
    """(k, 4) distinct planes (unit outward normal, offset) of a convex mesh: n . p + d <= 0 inside.

    Coplanar triangles are one plane: k is the number of polygons that PhysX counts.
    """
    corners = hull.corners
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1)
    solid = size > 1e-12 * max(float(size.max(initial=0.0)), 1e-300)
    normal = normal[solid] / size[solid, None]
    offset = -np.einsum("ij,ij->i", normal, corners[solid, 0])
    # The biggest faces speak first; a face within 0.06 degrees and 1e-6 D of one joins it.
    planes: list[Array] = []
    rest = np.column_stack([normal, offset])[np.argsort(-size[solid], kind="stable")]
    reach = 1e-6 * hull.diagonal
    while len(rest):
        plane = rest[0]
        planes.append(plane)
        same = (rest[:, :3] @ plane[:3] > 1.0 - 5e-7) & (
            np.abs(rest[:, 3] - plane[3]) <= reach + 1e-3 * hull.diagonal * _angle(rest, plane)
        )
        same[0] = True
        rest = rest[~same]
    return np.asarray(planes, dtype=np.float64).reshape(-1, 4)


def _angle(planes: Array, plane: Array) -> Array:
    """(k,) sines of the angles between plane normals, rad for small ones."""
    return np.asarray(np.linalg.norm(np.cross(planes[:, :3], plane[:3]), axis=1))


def _refuse_flat(points: Array, subject: str) -> None:
    if len(points) < 4:
        raise StepError(f"{subject}: a hull needs 4 distinct points, there are {len(points)}")
    _, spread, _ = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    if spread[2] <= FLAT * spread[0]:
        extents = np.ptp(points, axis=0)
        shown = " x ".join(f"{1e3 * float(e):.4g}" for e in extents)
        raise StepError(
            f"{subject}: flat, it spans no volume ({shown} mm)",
            hint="give this link another method, such as `primitive` or `none`",
        )


def _qhull(points: Array, options: str, subject: str) -> ConvexHull:
    from scipy.spatial import ConvexHull, QhullError

    # Moved to the origin: qhull's tolerances grow with the largest coordinate.
    try:
        return ConvexHull(points - points.mean(axis=0), qhull_options=options)
    except QhullError as error:
        reason = str(error).splitlines()[0]
        raise StepError(f"{subject}: no convex hull: {reason}") from error


def _outward(points: Array, hull: ConvexHull) -> TriangleMesh:
    """The hull's triangles over its own vertices, outward, in canonical order."""
    used = np.sort(np.asarray(hull.vertices, dtype=np.int64))
    number = np.full(len(points), -1, dtype=np.int64)
    number[used] = np.arange(len(used))
    faces: Indices = number[np.asarray(hull.simplices, dtype=np.int64)]
    vertices = points[used]
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    start = np.argmin(faces, axis=1)[:, None] + np.arange(3)
    faces = np.take_along_axis(faces, start % 3, axis=1)
    return TriangleMesh(vertices, faces[np.lexsort(faces.T[::-1])])
