"""Samples of boxes and surfaces, the same on every machine, and how far apart two surfaces are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from assetbuild.mesh.triangles import Indices, TriangleMesh
from assetbuild.robot.pose import Array, cross

Numbers = NDArray[np.uint32]

BITS = 30
BIT = np.arange(BITS, dtype=np.uint32)


def sobol(count: int, lower: Array, upper: Array, seed: int = 0) -> Array:
    """(count, 3) scrambled Sobol points in a box; count: a power of two.

    Direction numbers of S. Joe and F. Y. Kuo (2008), scrambled by J. Matousek's linear matrices and
    a digital shift (1998): number by number what `scipy.stats.qmc.Sobol` gives, whose import takes
    longer than most robots' collision geometry.
    """
    return np.asarray(lower + _unit_points(count, seed) * (upper - lower), dtype=np.float64)


@lru_cache(4)
def _unit_points(count: int, seed: int) -> Array:
    """(count, 3) in [0, 1)."""
    random = np.random.default_rng(np.random.SeedSequence(seed).spawn(1)[0])
    shift = random.integers(2, size=(3, BITS), dtype=np.uint32) @ (np.uint32(1) << BIT)
    lower = np.tril(random.integers(2, size=(3, BITS, BITS), dtype=np.uint32))
    lower[:, BIT, BIT] = 1
    digits = _directions()[:, None, :] >> BIT[::-1, None] & np.uint32(1)  # the highest come first
    scrambled = lower @ digits % 2
    directions = (np.uint32(1) << BIT[::-1]) @ scrambled
    index = np.arange(count, dtype=np.uint32)
    gray = index ^ (index >> np.uint32(1))
    numbers = np.tile(shift, (count, 1))
    for bit in range(count.bit_length()):
        chosen = gray >> np.uint32(bit) & np.uint32(1)
        numbers ^= chosen[:, None] * directions[:, bit]
    return numbers / 2.0**BITS


def _directions() -> Numbers:
    """(3, 30) direction numbers; in the third dimension of the polynomial x^2 + x + 1."""
    numbers: Numbers = np.ones((3, BITS), dtype=np.uint32)
    numbers[2, 1] = 3
    for n in range(1, BITS):
        numbers[1, n] = numbers[1, n - 1] ^ numbers[1, n - 1] << np.uint32(1)
    for n in range(2, BITS):
        one, two = numbers[2, n - 1], numbers[2, n - 2]
        numbers[2, n] = two ^ one << np.uint32(1) ^ two << np.uint32(2)
    return numbers << BIT[::-1]


SAMPLES = 6000
"""Samples of a surface; the spread of a mean distance is then below 1 % of it."""
LEVELS = (160.0, 640.0)
"""Edges longer than diagonal / 160, than diagonal / 640, and the rest: see `NearestSurface`."""
NEIGHBOURS = 8
"""Anchors of each level whose triangles are tried."""


@dataclass(frozen=True, slots=True)
class Distance:
    """Two-sided distance between surfaces, m; the larger of both sides each."""

    mean_m: float
    p99_m: float
    max_m: float

    @classmethod
    def of(cls, there: Array, back: Array) -> Distance:
        """Make it from the distances of samples of each surface to the other, m."""
        return cls(
            mean_m=float(there.mean() + back.mean()) / 2.0,
            p99_m=float(max(np.quantile(there, 0.99), np.quantile(back, 0.99))),
            max_m=float(max(there.max(), back.max())),
        )


def surface_samples(mesh: TriangleMesh, count: int, seed: int) -> tuple[Array, Indices]:
    """(points (count, 3) m, their faces (count,)): stratified by area, the same for a seed.

    Stratified: sample i lies in the i-th of `count` equal shares of the area. Uniform in each
    triangle by 1 - sqrt(r) (Osada et al., Shape distributions, 2002).
    """
    rng = np.random.default_rng(seed)
    reach = np.cumsum(mesh.areas)
    where = (np.arange(count) + rng.random(count)) / count * reach[-1]
    face = np.minimum(np.searchsorted(reach, where), len(reach) - 1)
    root, r = np.sqrt(rng.random(count))[:, None], rng.random(count)[:, None]
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces[face]], 1, 0)
    return (1 - root) * a + root * (1 - r) * b + root * r * c, face


class NearestSurface:
    """Distances to one mesh, for many points.

    A kd-tree finds candidate triangles by anchor points on them; the distance to those is exact,
    so an answer is never too small; 99 % of the samples of Go1's trunk find the very triangle
    they lie on within 0.04 % of the diagonal. Triangles are sorted by size into levels with a
    tree each: otherwise a cluster of tiny ones hides the long needle that the query lies on.
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        from scipy.spatial import cKDTree

        self._corners = mesh.corners
        edges = np.linalg.norm(self._corners - self._corners[:, [1, 2, 0]], axis=2)
        self._longest = longest = edges.max(axis=1)
        coarse, fine = mesh.diagonal / LEVELS[0], mesh.diagonal / LEVELS[1]
        sizes = [longest > coarse, (longest <= coarse) & (longest > fine), longest <= fine]
        self._levels = []
        for level in (np.flatnonzero(size) for size in sizes):
            if len(level):
                points, owner = _anchors(self._corners[level], edges[level], coarse)
                tree = cKDTree(points, balanced_tree=False, compact_nodes=False)
                self._levels.append((tree, level[owner]))

    def at_most(self, points: Array) -> Array:
        """(n,) upper bounds of the distances of points (n, 3), quickly; m."""
        nearest = np.full(len(points), np.inf)
        for tree, _ in self._levels if len(points) else ():
            nearest = np.minimum(nearest, tree.query(points)[0])
        return nearest

    def distance(self, points: Array) -> Array:
        """(n,) unsigned distances of points (n, 3), m."""
        nearest = np.full(len(points), np.inf)
        for tree, owner in self._levels if len(points) else ():
            tries = range(1, min(NEIGHBOURS, len(owner)) + 1)
            apart, near = map(np.asarray, tree.query(points, k=tries))
            tried = owner[near]
            # No triangle reaches farther from its anchor than its longest edge is long.
            may_win = apart - self._longest[tried] <= np.minimum(nearest, apart[:, 0])[:, None]
            may_win[:, 1:] &= tried[:, 1:] != tried[:, :-1]
            of, faces = np.nonzero(may_win)[0], tried[may_win]
            distances = np.full(tried.shape, np.inf)
            distances[may_win] = point_triangle_distance(points[of], self._corners[faces])
            nearest = np.minimum(nearest, distances.min(axis=1))
        return nearest


def _anchors(corners: Array, edges: Array, spacing: float) -> tuple[Array, Indices]:
    """(points (k, 3), number of their triangle (k,)): a grid on each, about `spacing` apart.

    Columns stand on the longest edge, `spacing` apart; each is filled up to the other two edges.
    """
    rows = np.arange(len(corners))
    start = np.argmax(edges, axis=1)  # edge i joins corners i and i + 1
    a, b, c = (corners[rows, (start + k) % 3] for k in range(3))
    length = np.where(edges[rows, start] > 0.0, edges[rows, start], 1.0)
    base = (b - a) / length[:, None]
    foot = np.clip(np.einsum("ij,ij->i", c - a, base) / length, 1e-9, 1.0 - 1e-9)
    up = c - a - (foot * length)[:, None] * base
    along = np.clip(np.ceil(length / spacing), 1, 1000).astype(np.int64)
    across = np.clip(np.ceil(np.linalg.norm(up, axis=1) / spacing), 1, 1000).astype(np.int64)
    count = along * across
    owner = np.repeat(rows, count)
    of = owner if len(owner) > len(rows) else slice(None)  # nothing to copy where each has one
    cell = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    x = (cell % along[of] + 0.5) / along[of]
    top = np.minimum(x / foot[of], (1.0 - x) / (1.0 - foot[of]))
    y = (cell // along[of] + 0.5) / across[of] * top
    return a[of] + (x * length[of])[:, None] * base[of] + y[:, None] * up[of], owner


def point_triangle_distance(points: Array, corners: Array) -> Array:
    """(n,) distances of points (n, 3) to triangles (n, 3, 3): to the face, else to its edges."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = cross(b - a, c - a)
    squared = np.einsum("ij,ij->i", normal, normal)
    solid = squared > 0.0
    safe = np.where(solid, squared, 1.0)
    inside = solid.copy()
    nearest = np.full(len(points), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge, to = end - start, points - start
        inside &= np.einsum("ij,ij->i", cross(edge, to), normal) >= 0.0
        length = np.einsum("ij,ij->i", edge, edge)
        along = np.einsum("ij,ij->i", to, edge) / np.where(length > 0.0, length, 1.0)
        off = to - np.clip(along, 0.0, 1.0)[:, None] * edge
        nearest = np.minimum(nearest, np.einsum("ij,ij->i", off, off))
    height = np.abs(np.einsum("ij,ij->i", points - a, normal)) / np.sqrt(safe)
    return np.asarray(np.where(inside, height, np.sqrt(nearest)), dtype=np.float64)


def surface_distance(a: TriangleMesh, b: TriangleMesh) -> Distance:
    """Two-sided distance between surfaces from SAMPLES points on each, seeds 0 and 1."""
    from_a = NearestSurface(b).distance(surface_samples(a, SAMPLES, 0)[0])
    from_b = NearestSurface(a).distance(surface_samples(b, SAMPLES, 1)[0])
    return Distance.of(from_a, from_b)
