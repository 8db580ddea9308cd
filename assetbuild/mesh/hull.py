"""Convex hulls by qhull, with outward faces and an exact cap on vertices."""

from __future__ import annotations

import functools
import os
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from assetbuild.errors import StepError
from assetbuild.mesh.triangles import Indices, TriangleMesh, in_order, spanned
from assetbuild.robot.pose import Array

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

COPLANAR = 1e-3
"""Angle between normals, rad, below which neighbouring triangles are one polygon."""
CHUNK = 500_000
"""Numbers per block of `beyond`: 4 MB, which a processor's cache holds."""
FLAT = 1e-7
"""Points whose smallest extent is below this share of the largest span no volume."""
SURELY_SOLID = 1e-10
"""From this ratio of the squared extents on, points are far from flat: no SVD is needed."""


def convex_hull(points: Array, subject: str = "mesh") -> TriangleMesh:
    """The convex hull of points (n, 3) m: outward triangles; its vertices are input points.

    Raises StepError when the points lie in a plane, on a line or in one spot.
    """
    given = np.asarray(points, dtype=np.float64)
    order, new = in_order(given + 0.0)
    distinct = given[order[new]] + 0.0
    refuse_flat(distinct, subject)
    return _hull_of(distinct, subject)


def hull_or_points(points: Array) -> TriangleMesh:
    """The hull of points (n, 3); of flat ones, which have none, all of them and no face."""
    try:
        return convex_hull(points)
    except StepError:
        return TriangleMesh(points, np.zeros((0, 3), dtype=np.int64))


def capped(
    hull: TriangleMesh,
    max_vertices: int | None,
    max_polygons: int | None = None,
    *,
    subject: str = "mesh",
) -> TriangleMesh:
    """A hull of `convex_hull` within limits; itself where it is within them already.

    max_vertices: at least 4; max_polygons: at least 16, coplanar triangles counted as one. The
    hull then lies inside the full one (see `_farthest_first`).
    """
    corners, made = hull.vertices, hull
    most = min(max_vertices or len(corners), len(corners))
    too_many = most < len(corners)
    if not too_many and (max_polygons is None or polygon_count(hull) <= max_polygons):
        return hull
    order = _farthest_first(corners, most, subject)
    if too_many:
        made = _hull_of(corners[np.sort(order)], subject)
    # Each vertex less is about two polygons less; the order is the same, so it only shortens.
    while max_polygons is not None and (count := polygon_count(made)) > max_polygons:
        order = order[: max(4, len(order) - max(1, (count - max_polygons) // 2))]
        made = _hull_of(corners[np.sort(order)], subject)
    return made


def _farthest_first(points: Array, count: int, subject: str) -> Indices:
    """Indices of `count` points whose hull comes near to that of all, the widest first.

    Starts from a wide simplex, then always takes the point farthest outside; qhull's own `TA`
    option takes the farthest of the facet at hand and leaves up to three times the gap.
    """
    chosen = _wide_simplex(points)
    local = points - _middle(points)
    hull = _qhull(local[chosen], subject, incremental=True)
    columns = np.vstack([local.T, np.ones(len(local))])
    room = np.empty((2 * count, len(points)))  # a hull of n points has at most 2 n - 4 triangles
    while len(chosen) < count:
        planes = hull.equations
        outside = np.matmul(planes, columns, out=room[: len(planes)]).max(axis=0)
        outside[chosen] = -np.inf
        chosen.append(int(np.argmax(outside)))
        try:
            hull.add_points(local[chosen[-1:]])
        except RuntimeError:  # QhullError: what it grew into is too flat for it, in this order
            hull = _qhull(local[chosen], subject, incremental=True)
    return np.asarray(chosen, dtype=np.int64)


def _wide_simplex(points: Array) -> list[int]:
    """Four points that span much volume: each is the farthest from what the former span."""
    first = int(np.argmin(points[:, 0]))
    second = int(np.argmax(np.linalg.norm(points - points[first], axis=1)))
    along = points[second] - points[first]
    area = np.cross(points - points[first], along)
    third = int(np.argmax(np.linalg.norm(area, axis=1)))
    fourth = int(np.argmax(np.abs((points - points[first]) @ area[third])))
    return [first, second, third, fourth]


def hull_planes(hull: TriangleMesh) -> Array:
    """(k, 4) planes (unit outward normal, offset) of a convex mesh: n . p + d <= 0 inside.

    One per triangle; triangles without area have none.
    """
    normal, solid = _normals(hull)
    offset = -np.einsum("ij,ij->i", normal[solid], hull.corners[solid, 0])
    return np.column_stack([normal[solid], offset])


def beyond(planes: Array, points: Array) -> Array:
    """(n,) largest signed distance of each of points (n, 3) over planes (k, 4), m, in blocks."""
    rows = max(1, CHUNK // max(len(planes), 1))
    distances = np.empty(len(points))
    for start in range(0, len(points), rows):
        over = points[start : start + rows] @ planes[:, :3].T
        over += planes[:, 3]
        over.max(axis=1, out=distances[start : start + rows])
    return distances


def hull_volume(points: Array) -> float:
    """m3, by manifold3d, which takes half of qhull's time: searches ask for thousands."""
    hull_points = manifold3d().Manifold.hull_points
    return float(hull_points(points).volume()) if len(points) > 3 else 0.0


@functools.cache
def manifold3d() -> Any:  # Any: the extension module has no types
    """The library on one thread: on several, a solid's triangles come in another order each time.

    Its pool has as many threads as this process has cores when it is first used. Where a system
    cannot tell a process to use one core, the order stays as it is.
    """
    import manifold3d

    if hasattr(os, "sched_setaffinity"):
        cores = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {min(cores)})
        manifold3d.Manifold.cube()
        os.sched_setaffinity(0, cores)
    return manifold3d


def polygon_count(hull: TriangleMesh) -> int:
    """Faces of a convex mesh once coplanar triangles are merged: what PhysX counts, at most 64.

    Triangles that share an edge are coplanar when their normals are within COPLANAR.
    """
    normal, solid = _normals(hull)
    edges = np.sort(hull.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    # On a closed mesh each edge stands twice, so sorted neighbours are neighbours on the hull.
    left, right = order[0::2] // 3, order[1::2] // 3
    cosine = np.einsum("ij,ij->i", normal[left], normal[right])
    flat = (cosine > np.cos(COPLANAR)) | ~(solid[left] & solid[right])
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    faces = len(hull.faces)
    joined = coo_array((np.ones(int(flat.sum())), (left[flat], right[flat])), shape=(faces, faces))
    count, _ = connected_components(joined, directed=False)
    return int(count)


def _normals(hull: TriangleMesh) -> tuple[Array, NDArray[np.bool_]]:
    """Unit normals (m, 3), and which triangles are big enough to have one."""
    normal = spanned(hull.corners)
    size = np.linalg.norm(normal, axis=1)
    solid = size > 1e-12 * max(float(size.max(initial=0.0)), 1e-300)
    return normal / np.where(solid, size, 1.0)[:, None], solid


def refuse_flat(points: Array, subject: str) -> None:
    """Raise StepError when points (n, 3) are not finite, or span no volume."""
    if not np.isfinite(points).all():
        raise StepError(f"{subject}: not all vertices are finite numbers")
    if len(points) < 4:
        raise StepError(f"{subject}: a hull needs 4 distinct points, there are {len(points)}")
    local = points - points.mean(axis=0)
    least, _, most = np.linalg.eigvalsh(local.T @ local)
    if least > SURELY_SOLID * most:  # squares lose half of the digits
        return
    _, spread, _ = np.linalg.svd(local, full_matrices=False)
    if spread[2] <= FLAT * spread[0]:
        extents = np.ptp(points, axis=0)
        shown = " x ".join(f"{1e3 * float(e):.4g}" for e in extents)
        raise StepError(
            f"{subject}: flat, it spans no volume ({shown} mm)",
            hint="give this link another method, such as `primitive` or `none`",
        )


def _qhull(points: Array, subject: str, *, incremental: bool = False) -> ConvexHull:
    from scipy.spatial import ConvexHull, QhullError

    # Moved to the origin: qhull's tolerances grow with the largest coordinate.
    local = points if incremental else points - _middle(points)
    try:
        return ConvexHull(local, qhull_options="Qt", incremental=incremental)
    except QhullError as error:
        reason = str(error).splitlines()[0]
        raise StepError(f"{subject}: no convex hull: {reason}") from error


def _middle(points: Array) -> Array:
    return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2.0, dtype=np.float64)


def _hull_of(points: Array, subject: str) -> TriangleMesh:
    """The hull's triangles over its own vertices, outward, in canonical order."""
    hull = _qhull(points, subject)
    used = np.sort(np.asarray(hull.vertices, dtype=np.int64))
    number = np.full(len(points), -1, dtype=np.int64)
    number[used] = np.arange(len(used))
    faces: Indices = number[np.asarray(hull.simplices, dtype=np.int64)]
    vertices = points[used]
    inward = np.einsum("ij,ij->i", spanned(vertices[faces]), hull.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    start = np.argmin(faces, axis=1)[:, None] + np.arange(3)
    faces = np.take_along_axis(faces, start % 3, axis=1)
    return TriangleMesh(vertices, faces[np.lexsort(faces.T[::-1])])
