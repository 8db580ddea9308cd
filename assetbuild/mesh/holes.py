"""Holes that one sees through a mesh, and what other geometry leaves of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assetbuild.mesh.rays import SIDES, grids, missed
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.pose import Vec3, vec3

GRID = 64
"""Rays along each edge of a square that holds the mesh, for six directions."""
LEAST = 8
"""Rays: less is a slit between parts. A round hole of a twentieth of the size has as many."""


@dataclass(frozen=True)
class Hole:
    """A way through, with mesh all around it when seen along `direction`.

    middle_m: (3,) the point of its axis nearest to the middle of the mesh. open: the share of it
    that the other geometry leaves.
    """

    middle_m: Vec3
    direction: Vec3
    area_m2: float
    open: float


def holes(seen: TriangleMesh, solid: TriangleMesh) -> list[Hole]:
    """Holes of `seen`, largest first, and how `solid` leaves them; both in one frame, m.

    Seen along the axes and the principal axes of the vertices; one hole may come up in several
    directions. A notch is none: it is open on one side.
    """
    reach = 1.05 * seen.diagonal
    if reach == 0.0:
        return []
    start, along = grids(seen, GRID, reach)
    through = missed(start, along, seen)  # all at once: what costs is the tree over the triangles
    patches = [
        number * GRID * GRID + rays
        for number in range(SIDES)
        for rays in _enclosed(through[number * GRID * GRID :][: GRID * GRID])
    ]
    found = []
    for rays in patches:
        left = float(missed(start[rays], along[rays], solid).mean())
        at = vec3(start[rays].mean(axis=0) + reach * along[rays[0]])
        area = len(rays) * (reach / GRID) ** 2
        found.append(Hole(at, vec3(along[rays[0]]), area, left))
    return sorted(found, key=lambda hole: -hole.area_m2)


def _enclosed(through: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Numbers of the rays of each patch that does not reach the edge of the picture."""
    from scipy import ndimage

    patches, _ = ndimage.label(through.reshape(GRID, GRID))
    edge = {0, *patches[[0, -1]].ravel().tolist(), *patches[:, [0, -1]].ravel().tolist()}
    flat = patches.ravel()
    sizes = np.bincount(flat)
    return [
        np.flatnonzero(flat == patch)
        for patch in range(len(sizes))
        if patch not in edge and sizes[patch] >= LEAST
    ]
