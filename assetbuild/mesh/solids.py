"""How far points are from a convex solid: a primitive, or the hull of a mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from assetbuild.errors import StepError
from assetbuild.mesh.hull import convex_hull, hull_planes
from assetbuild.mesh.primitives import signed_distance
from assetbuild.robot.model import Primitive
from assetbuild.robot.pose import Array, Pose

CHUNK = 2_000_000
"""Numbers per block: 16 MB."""
Distance = Callable[[Array], Array]
"""Points (n, 3) of a body's frame to (n,) signed distances in m, negative inside."""


def distance_to(solid: Primitive | Array, X_body_solid: Pose) -> Distance:
    """Signed distance from a primitive, or from the convex hull of points (n, 3).

    Outside an edge of a hull the nearest plane is told, which is less than the distance; of points
    in one plane, which have no hull, the distance from their axis-aligned box.
    """
    X_solid_body = X_body_solid.inverse()
    if not isinstance(solid, np.ndarray):
        return lambda points: signed_distance(solid, X_solid_body.apply(points))
    try:
        planes = hull_planes(convex_hull(solid))
    except StepError:  # flat: no inside
        lower, upper = solid.min(axis=0), solid.max(axis=0)
        return lambda points: _beyond_box(lower, upper, X_solid_body.apply(points))
    return lambda points: beyond(planes, X_solid_body.apply(points))


def _beyond_box(lower: Array, upper: Array, points: Array) -> Array:
    """(n,) distance of each point from a box without inside; zero in it."""
    apart = np.maximum(np.maximum(lower - points, points - upper), 0.0)
    distance: Array = np.linalg.norm(apart, axis=1)
    return distance


def beyond(planes: Array, points: Array) -> Array:
    """(n,) largest distance of each point over the planes (k, 4), in blocks."""
    rows = max(1, CHUNK // max(len(planes), 1))
    blocks: Sequence[Array] = [
        (points[start : start + rows] @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        for start in range(0, len(points), rows)
    ]
    return np.concatenate(blocks) if blocks else np.zeros(0)
