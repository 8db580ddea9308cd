"""From many convex parts to fewer: each part on the surface again, then merged pair by pair."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress

import numpy as np

from assetbuild.errors import StepError
from assetbuild.mesh.hull import beyond, convex_hull, hull_planes, hull_volume
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.pose import Array

NEAR = 0.005
"""Parts whose bounds are nearer than this share of the size of all are neighbours."""
SPARSE = 4
"""Every so many of two parts' points say what joining them adds at least."""


def hulls_of(parts: Sequence[Array]) -> list[TriangleMesh]:
    """The hull of each part's points (n, 3); parts without volume are left out."""
    hulls = []
    for points in parts:
        with suppress(StepError):
            hulls.append(convex_hull(points))
    return hulls


def grown_to(parts: Sequence[TriangleMesh], surface: Array, reach: float) -> list[TriangleMesh]:
    """Hulls that also hold the surface points just outside of them.

    surface: (n, 3) points of the mesh; reach: m, about the size of a voxel. V-HACD's parts end
    up to a voxel inside the mesh: each takes the points that no part holds and that lie within
    reach of its planes. Parts without volume are left out.
    """
    hulls = hulls_of([part.vertices for part in parts])
    away = np.stack([beyond(hull_planes(hull), surface) for hull in hulls], axis=1)
    bare = away.min(axis=1) > 0.0
    grown = []
    for number, hull in enumerate(hulls):
        near = bare & (away[:, number] <= reach)
        points = np.concatenate([hull.vertices, surface[near]])
        grown.append(convex_hull(points) if near.any() else hull)
    return grown


def merge_steps(parts: Sequence[TriangleMesh]) -> Iterator[list[Array]]:
    """Vertices of the parts, then of one part fewer, down to one: a nested family.

    Always joins the pair whose common hull adds the least volume to the sum of the two, of those
    whose bounds (nearly) touch: to join others adds more. When none touch, of all.
    """
    forest = _Forest([part.vertices for part in parts])
    yield forest.points()
    while len(forest.alive) > 1:
        forest.join()
        yield forest.points()


class _Forest:
    """Parts that are still apart, and what joining two of them would add."""

    def __init__(self, points: Sequence[Array]) -> None:
        self._points = list(points)
        self._volumes = [hull_volume(p - p.mean(axis=0)) for p in points]
        self._bounds = [(p.min(axis=0), p.max(axis=0)) for p in points]
        corners = np.concatenate(self._points)
        self._reach = NEAR * float(np.linalg.norm(np.ptp(corners, axis=0)))
        self.alive = list(range(len(points)))
        self._at_least: set[tuple[int, int]] = set()
        self._added = self._costs([(b, a) for a in self.alive for b in range(a)])

    def points(self) -> list[Array]:
        """Vertices of each part."""
        return [self._points[k] for k in self.alive]

    def join(self) -> None:
        """The cheapest pair becomes one part."""
        from scipy.spatial import ConvexHull

        if not self._added:
            pairs = [(a, b) for a in self.alive for b in self.alive if a < b]
            self._added = self._costs(pairs, near=False)
        while (cheapest := min(self._added, key=lambda p: (self._added[p], p))) in self._at_least:
            self._at_least.remove(cheapest)
            self._added[cheapest] = self._cost(*cheapest, 1)
        first, second = cheapest
        joined = np.concatenate([self._points[first], self._points[second]])
        hull = ConvexHull(joined - joined.mean(axis=0), qhull_options="Qt")
        self._points.append(joined[np.sort(hull.vertices)])
        self._volumes.append(self._volumes[first] + self._volumes[second] + self._added[cheapest])
        self._bounds.append((joined.min(axis=0), joined.max(axis=0)))
        new, gone = len(self._points) - 1, {first, second}
        self.alive = [k for k in self.alive if k not in gone]
        kept = {pair: value for pair, value in self._added.items() if not gone & set(pair)}
        self._added = kept | self._costs([(k, new) for k in self.alive])
        self.alive.append(new)

    def _costs(
        self, pairs: Sequence[tuple[int, int]], *, near: bool = True
    ) -> dict[tuple[int, int], float]:
        close = [pair for pair in pairs if not near or self._touch(*pair)]
        self._at_least |= {*close}
        return {pair: self._cost(*pair, SPARSE) for pair in close}

    def _touch(self, a: int, b: int) -> bool:
        (low, high), (lower, upper) = self._bounds[a], self._bounds[b]
        return bool((low <= upper + self._reach).all() and (lower <= high + self._reach).all())

    def _cost(self, a: int, b: int, every: int) -> float:
        both = np.concatenate([self._points[k][::every] for k in (a, b)])
        # Relative to the middle: between pairs that add almost nothing, rounding decides.
        joined = hull_volume(both - both.mean(axis=0))
        return joined - self._volumes[a] - self._volumes[b]
