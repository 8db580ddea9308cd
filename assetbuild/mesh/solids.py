"""How far points are from a convex solid: a primitive, or the hull of a mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from assetbuild.errors import StepError
from assetbuild.mesh.hull import convex_hull, hull_planes
from assetbuild.mesh.primitives import Primitive, signed_distance
from assetbuild.robot.pose import Array, Pose

CHUNK = 2_000_000
"""Numbers per block: 16 MB."""
Distance = Callable[[Array], Array]
"""Points (n, 3) of a body's frame to (n,) signed distances in m, negative inside."""


def distance_to(solid: Primitive | Array, X_body_solid: Pose) -> Distance:
    """Signed distance from a primitive, or from the convex hull of points (n, 3).

    Outside an edge of a hull the nearest plane is told, which is less than the distance.
    """
    X_solid_body = X_body_solid.inverse()
    if not isinstance(solid, np.ndarray):
        return lambda points: signed_distance(solid, X_solid_body.apply(points))
    try:
        planes = hull_planes(convex_hull(solid))
    except StepError:  # flat: no inside
        return lambda points: np.full(len(points), np.inf)
    return lambda points: beyond(planes, X_solid_body.apply(points))


def beyond(planes: Array, points: Array) -> Array:
    """(n,) largest distance of each point over the planes (k, 4), in blocks."""
    rows = max(1, CHUNK // max(len(planes), 1))
    blocks: Sequence[Array] = [
        (points[start : start + rows] @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        for start in range(0, len(points), rows)
    ]
    return np.concatenate(blocks) if blocks else np.zeros(0)
