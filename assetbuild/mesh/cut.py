"""Convex parts of any mesh that has an inside, by plane cuts from the top down.

A part is cut by the plane across x, y or z after which the hulls of its two sides are smallest
together, and the part whose cut saves most comes first. The search looks at samples; the parts
then hold every vertex of the mesh and every point where a plane went through a triangle, so that
their hulls cover its surface. Inside of the mesh they meet at the planes.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from assetbuild.mesh.hull import hull_volume
from assetbuild.mesh.quality import surface_samples
from assetbuild.mesh.triangles import Indices, TriangleMesh
from assetbuild.robot.pose import Array

SKIN, SEEN = 8_000, 1_000
"""Samples of the surface, and how many of its own the search of one part looks at."""
PLACES, HALVINGS, LEDGES = 8, 2, 4
"""Planes are tried at seven places along each axis, then on both sides of the best, twice, then
where most vertices near the best have their place: a face or an edge of a machined part."""
AHEAD = 8
"""Every so many samples of the surface are used where two cuts are tried at once."""
SAME = 1e-6
"""Share of the diagonal: vertices that lie closer along an axis share a place."""
DIRECTIONS = 1024
"""A ball's hull loses half a percent of its volume with so many."""
PROMISE = 0.1
"""Share of the empty part of its hull that a part may gain by later cuts."""
NOISE = 0.01
"""Share of the hull's volume; a cut that gains less gains only by sampling noise. The first
one through a ring is such a cut wherever it goes, and only a second one shows where to begin."""
LEAST_GAIN = 1e-3
"""A cut that saves less than this share of the hull's volume is not worth a part."""


def cut_parts(mesh: TriangleMesh, filling: Array, cell_m3: float, count: int) -> list[Array]:
    """Points (n, 3) of each of at most `count` parts, m; their convex hulls cover the mesh.

    filling: (n, 3) points evenly inside the mesh, each of which stands for `cell_m3`.
    """
    whole = _Part(
        skin=surface_samples(mesh, SKIN, 0)[0],
        kept=mesh.vertices if len(mesh.vertices) < SEEN // 2 else np.zeros((0, 3)),
        inner=filling,
        faces=mesh.faces,
        clipped=np.zeros((0, 3, 3)),
        reach_m=cell_m3 ** (1.0 / 3.0),
    )
    same_m = SAME * mesh.diagonal
    ledges = [_ledges(mesh.vertices[:, axis], same_m) for axis in range(3)]
    least = LEAST_GAIN * whole.hull_m3
    # What a part can gain at most, or what its cut is worth where that is known; largest first.
    queue: list[tuple[float, int, _Part, _Cut | None]] = [(-whole.hull_m3, 0, whole, None)]
    made = 1
    while len(queue) < count and -queue[0][0] > least:
        _, number, part, cut = heapq.heappop(queue)
        if cut is None:
            cut = _best_cut(part, ledges, same_m)
            gain = part.hull_m3 - cut.hulls_m3
            surely_hollow, _ = part.hollow_m3(cell_m3)
            vain = gain < NOISE * part.hull_m3 < surely_hollow
            if part is whole and vain and np.isfinite(gain):
                cut, gain = _look_ahead(part, cut)
            worth = max(gain, PROMISE * surely_hollow) if np.isfinite(gain) else 0.0
            heapq.heappush(queue, (-worth, number, part, cut))
            continue
        for side in part.cut(mesh, cut):
            heapq.heappush(queue, (-side.hollow_m3(cell_m3)[1], made, side, None))
            made += 1
    parts = [part for _, _, part, _ in sorted(queue, key=lambda entry: entry[1])]
    # On a grid, as two triangles meet a plane in one place but for rounding: MuJoCo holds float32,
    # in which the two would be one vertex, and triangles of the hull would vanish.
    return [np.round(part.points(mesh) / same_m) * same_m for part in parts]


def tips(points: Array) -> Array:
    """Those of many points (n, 3) that lie farthest in one of DIRECTIONS: nearly the whole hull."""
    if len(points) <= DIRECTIONS:
        return points
    turn = np.arange(DIRECTIONS) * np.pi * (3.0 - 5.0**0.5)  # points of a Fibonacci sphere
    height = 1.0 - (2.0 * np.arange(DIRECTIONS) + 1.0) / DIRECTIONS
    ring = np.sqrt(1.0 - height**2)
    directions = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1)
    farthest = [
        (points @ some.T).argmax(axis=0) for some in np.array_split(directions, DIRECTIONS // 64)
    ]
    return np.asarray(points[np.unique(np.concatenate(farthest))])


@dataclass(frozen=True)
class _Cut:
    """A plane across an axis (0, 1, 2), and the volume of the two hulls that it leaves."""

    axis: int
    place_m: float
    hulls_m3: float


@dataclass(frozen=True, eq=False)
class _Part:
    """Points (n, 3) each: skin, samples of the surface; kept, those inside the mesh on the planes
    around the part, and the vertices of a coarse mesh; inner, others inside.

    faces: of the mesh, whole; clipped: (m, 3, 3) corners of triangles that a plane went through;
    reach_m: how far apart points inside are.
    """

    skin: Array
    kept: Array
    inner: Array
    faces: Indices
    clipped: Array
    reach_m: float

    @cached_property
    def seen(self) -> Array:
        """(n, 3) what the search looks at."""
        return np.concatenate([self.skin[:: len(self.skin) // SEEN + 1], self.kept])

    @cached_property
    def hull_m3(self) -> float:
        """Volume of the hull of what the search sees."""
        return hull_volume(self.seen)

    def hollow_m3(self, cell_m3: float) -> tuple[float, float]:
        """(least, most) that is empty of its hull: the points inside are counted to 3 sigma."""
        count, doubt = len(self.inner), 3.0 * len(self.inner) ** 0.5
        least, most = (self.hull_m3 - cell_m3 * (count + turn * doubt) for turn in (1.0, -1.0))
        return max(least, 0.0), max(most, 0.0)

    def points(self, mesh: TriangleMesh) -> Array:
        """All that its hull must hold."""
        corners = self.clipped.reshape(-1, 3)
        return np.concatenate([mesh.vertices[np.unique(self.faces)], corners, self.kept, self.skin])

    @cached_property
    def held(self) -> Array:
        """(n, 3) points inside the mesh, or on it."""
        return np.concatenate([self.inner, self.kept])

    def caps(self, axis: int, place_m: float) -> tuple[Array, Array]:
        """Points inside the mesh below the plane and above it, moved onto it from nearby."""
        over = self.held[:, axis] - place_m
        near = np.flatnonzero(np.abs(over) <= self.reach_m)
        moved, is_above = self.held[near], over[near] > 0.0
        moved[:, axis] = place_m
        return moved[~is_above], moved[is_above]

    def cut(self, mesh: TriangleMesh, cut: _Cut) -> Iterator[_Part]:
        """The part below the plane, then the part above it."""
        below = (mesh.vertices[:, cut.axis] <= cut.place_m)[self.faces].sum(axis=1)
        crossed = mesh.vertices[self.faces[(below == 1) | (below == 2)]]
        clipped = _split(np.concatenate([crossed, self.clipped]), cut)
        for half, corners, count in zip(self.halves(cut), clipped, (3, 0), strict=True):
            yield replace(half, faces=self.faces[below == count], clipped=corners)

    def halves(self, cut: _Cut) -> Iterator[_Part]:
        """Both sides without their triangles, which a search does not look at."""
        for above, cap in enumerate(self.caps(cut.axis, cut.place_m)):
            skin, kept, inner = (
                points[(points[:, cut.axis] > cut.place_m) == above]
                for points in (self.skin, self.kept, self.inner)
            )
            kept = np.concatenate([kept, cap])
            yield _Part(skin, kept, inner, self.faces[:0], self.clipped[:0], self.reach_m)


def _ledges(places_m: Array, same_m: float) -> tuple[Array, Indices]:
    """(places along an axis in ascending order, how many vertices lie at each)."""
    _, first, count = np.unique(np.round(places_m / same_m), return_index=True, return_counts=True)
    return places_m[first], count


def _planes(part: _Part, places: int) -> tuple[list[_Cut], Array]:
    """(Planes across each axis that divide the part's extent into `places`, how far apart)."""
    lower, upper = part.seen.min(axis=0), part.seen.max(axis=0)
    step = (upper - lower) / places
    tried = [
        _tried(part, axis, float(lower[axis] + k * step[axis]))
        for axis in range(3)
        for k in range(1, places)
    ]
    return tried, step


def _look_ahead(part: _Part, best: _Cut) -> tuple[_Cut, float]:
    """(The plane after which one more cut of each side saves most, what both steps save, m3).

    The second cut of a side goes through the middle of its extent along one of the axes.
    """
    sparse = replace(part, skin=part.skin[::AHEAD])
    first, _ = _planes(sparse, PLACES)
    saved, chosen = part.hull_m3 - best.hulls_m3, best
    for cut in first:
        if not np.isfinite(cut.hulls_m3):
            continue
        left = 0.0
        for half in sparse.halves(cut):
            after = min(again.hulls_m3 for again in _planes(half, 2)[0])
            left += min(half.hull_m3, after)
        if sparse.hull_m3 - left > saved:
            saved, chosen = sparse.hull_m3 - left, cut
    return chosen, saved


def _best_cut(part: _Part, ledges: Sequence[tuple[Array, Indices]], same_m: float) -> _Cut:
    """The plane after which the hulls are smallest."""
    tried, step = _planes(part, PLACES)
    best = min(tried, key=lambda cut: cut.hulls_m3)
    for halving in range(1, HALVINGS + 1):
        aside = float(step[best.axis]) / 2**halving
        beside = [_tried(part, best.axis, best.place_m + turn * aside) for turn in (-1.0, 1.0)]
        best = min(best, *beside, key=lambda cut: cut.hulls_m3)
    places, count = ledges[best.axis]
    near = np.flatnonzero(np.abs(places - best.place_m) <= step[best.axis] / 2.0)
    most = near[np.argsort(-count[near], kind="stable")[:LEDGES]]
    # A face in the plane belongs to the side that is solid there: just below it, or just above.
    beside = [
        _tried(part, best.axis, float(place) + side * same_m)
        for place in places[most]
        for side in (-2.0, 2.0)
    ]
    return min([best, *beside], key=lambda cut: cut.hulls_m3)


def _tried(part: _Part, axis: int, place_m: float) -> _Cut:
    is_above = part.seen[:, axis] > place_m
    if not 4 <= int(is_above.sum()) <= len(is_above) - 4:
        return _Cut(axis, place_m, np.inf)
    halves = zip((part.seen[~is_above], part.seen[is_above]), part.caps(axis, place_m), strict=True)
    return _Cut(axis, place_m, sum(hull_volume(np.concatenate(side)) for side in halves))


def _split(corners: Array, cut: _Cut) -> tuple[Array, Array]:
    """Triangles (m, 3, 3) below and above the plane; one that it crosses becomes three."""
    over = corners[:, :, cut.axis] - cut.place_m
    below = over <= 0.0
    count = below.sum(axis=1)
    sides = [[corners[count == 3]], [corners[count == 0]]]
    for side, crossed in ((0, count == 1), (1, count == 2)):  # where one corner lies alone
        first = np.argmax(below[crossed] == (side == 0), axis=1)
        turned = (first[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(corners[crossed], turned[:, :, None], 1), 1, 0)
        height = np.take_along_axis(over[crossed], turned, axis=1)
        share = height[:, :1] / (height[:, :1] - height[:, 1:])
        to_b, to_c = a + share[:, :1] * (b - a), a + share[:, 1:] * (c - a)
        sides[side].append(np.stack([a, to_b, to_c], axis=1))
        sides[1 - side] += [np.stack([to_b, b, c], axis=1), np.stack([to_b, c, to_c], axis=1)]
    below_it, above_it = (np.concatenate(side) for side in sides)
    return below_it, above_it
