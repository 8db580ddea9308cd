"""How far apart two surfaces are: seeded samples, exact distances to the nearest triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from assetbuild.mesh.triangles import Indices, TriangleMesh
from assetbuild.mesh.volume import area, face_areas
from assetbuild.robot.pose import Array

SAMPLES = 6000
"""Samples of a surface; the spread of a mean distance is then below 1 % of it."""
ANCHORS = 24000
"""Samples that lead a query to its nearest triangles; denser than the queries."""
NEIGHBOURS = 8
"""Anchors whose triangles are tried: the nearest triangle may own only the second anchor."""


@dataclass(frozen=True, slots=True)
class Distance:
    """Two-sided distance between surfaces, m; the larger of both sides each."""

    mean_m: float
    p99_m: float
    max_m: float


def surface_samples(mesh: TriangleMesh, count: int, seed: int) -> tuple[Array, Indices]:
    """(points (count, 3) m, their faces (count,)): stratified by area, the same for a seed.

    Stratified: sample i lies in the i-th of `count` equal shares of the area. Uniform in each
    triangle by 1 - sqrt(r) (Osada et al., Shape distributions, 2002).
    """
    rng = np.random.default_rng(seed)
    reach = np.cumsum(face_areas(mesh))
    where = (np.arange(count) + rng.random(count)) / count * reach[-1]
    face = np.minimum(np.searchsorted(reach, where), len(reach) - 1)
    root, r = np.sqrt(rng.random(count))[:, None], rng.random(count)[:, None]
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces[face]], 1, 0)
    return (1 - root) * a + root * (1 - r) * b + root * r * c, face


class NearestSurface:
    """Distances to one mesh, for many points.

    A kd-tree over seeded samples finds candidate triangles; the distance to those is exact. So
    the answer is never too small, and too large by less than the spacing of the samples, rarely.
    """

    def __init__(self, mesh: TriangleMesh, seed: int = 0) -> None:
        from scipy.spatial import cKDTree

        self._corners = mesh.corners
        points, self._faces = surface_samples(mesh, ANCHORS, seed)
        # The middle of every face too: in finely meshed corners most faces own no sample.
        points = np.concatenate([points, self._corners.mean(axis=1)])
        self._faces = np.concatenate([self._faces, np.arange(len(mesh.faces))])
        self._tree = cKDTree(points, balanced_tree=False)

    def distance(self, points: Array) -> Array:
        """(n,) unsigned distances of points (n, 3), m."""
        if not len(points):
            return np.zeros(0)
        _, near = self._tree.query(points, k=NEIGHBOURS)
        tried = self._faces[np.asarray(near)]
        flat = point_triangle_distance(
            np.repeat(points, NEIGHBOURS, axis=0), self._corners[tried.ravel()]
        )
        return np.asarray(flat.reshape(-1, NEIGHBOURS).min(axis=1), dtype=np.float64)


def point_triangle_distance(points: Array, corners: Array) -> Array:
    """(n,) distances of points (n, 3) to triangles (n, 3, 3): to the face, else to its edges."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = np.cross(b - a, c - a)
    squared = np.einsum("ij,ij->i", normal, normal)
    solid = squared > 0.0
    safe = np.where(solid, squared, 1.0)
    inside = solid.copy()
    nearest = np.full(len(points), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge, to = end - start, points - start
        inside &= np.einsum("ij,ij->i", np.cross(edge, to), normal) >= 0.0
        length = np.einsum("ij,ij->i", edge, edge)
        along = np.einsum("ij,ij->i", to, edge) / np.where(length > 0.0, length, 1.0)
        off = to - np.clip(along, 0.0, 1.0)[:, None] * edge
        nearest = np.minimum(nearest, np.einsum("ij,ij->i", off, off))
    height = np.abs(np.einsum("ij,ij->i", points - a, normal)) / np.sqrt(safe)
    return np.where(inside, height, np.sqrt(nearest))


def surface_distance(a: TriangleMesh, b: TriangleMesh, *, samples: int = SAMPLES) -> Distance:
    """Two-sided distance between surfaces from `samples` points on each, seeds 0 and 1."""
    from_a = NearestSurface(b).distance(surface_samples(a, samples, 0)[0])
    from_b = NearestSurface(a).distance(surface_samples(b, samples, 1)[0])
    return Distance(
        mean_m=float(from_a.mean() + from_b.mean()) / 2.0,
        p99_m=float(max(np.quantile(from_a, 0.99), np.quantile(from_b, 0.99))),
        max_m=float(max(from_a.max(), from_b.max())),
    )


def area_ratio(changed: TriangleMesh, original: TriangleMesh) -> float:
    """Area of one surface / area of the other; 0.0 when the original has none."""
    whole = area(original)
    return area(changed) / whole if whole > 0.0 else 0.0
