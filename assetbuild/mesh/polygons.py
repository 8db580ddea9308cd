"""Polygons cut into triangles: convex ones into fans, all others by ear clipping."""

from __future__ import annotations

import numpy as np

from assetbuild.mesh.triangles import Indices
from assetbuild.robot.pose import Array

TURNED = 1e-9
"""Share of the polygon's own area from which a triangle that faces the other way counts."""
SKEW = 1e-6
"""Of the cube of its diagonal: six times the volume that the corners of a skew quad span."""


def fan_triangles(counts: Indices) -> Indices:
    """(k, 3) corner numbers that cut polygons of `counts` corners each into fans.

    Corners are numbered through all polygons. Right for convex polygons only; polygons of fewer
    than three corners give none.
    """
    starts = np.cumsum(counts) - counts
    fans = np.maximum(counts - 2, 0)
    first = np.repeat(starts, fans)
    step = np.arange(int(fans.sum())) - np.repeat(np.cumsum(fans) - fans, fans)
    return np.stack([first, first + step + 1, first + step + 2], axis=1).astype(np.int64)


def polygon_triangles(counts: Indices, corners: Array) -> Indices:
    """(k, 3) corner numbers as `fan_triangles`, right for polygons that are not convex too.

    A fan of such a polygon covers what lies outside of it: a shin was 19 % too large.
    counts: corners of each polygon; corners: (n, 3) m, their positions, polygon by polygon.
    """
    fans = fan_triangles(counts)
    owner = np.repeat(np.arange(len(counts)), np.maximum(counts - 2, 0))
    with np.errstate(all="ignore"):  # whoever reads the file refuses what is not finite
        across = _areas(corners[fans])
        normal = np.stack([np.bincount(owner, a, len(counts)) for a in across.T], axis=1)
        size = np.einsum("ij,ij->i", normal, normal)
        is_turned = np.einsum("ij,ij->i", across, normal[owner]) < -TURNED * size[owner]
    hollow = np.unique(owner[is_turned])
    if not len(hollow):
        return fans
    is_kept = ~np.isin(owner, hollow)
    starts = np.cumsum(counts) - counts
    cut = [_ears(int(starts[i]), corners[starts[i] : starts[i] + counts[i]]) for i in hollow]
    owners = np.concatenate([owner[is_kept], np.repeat(hollow, [len(ears) for ears in cut])])
    triangles = np.concatenate([fans[is_kept], *cut])
    return triangles[np.argsort(owners, kind="stable")]


def with_short_diagonals(triangles: Indices, counts: Indices, corners: Array) -> Indices:
    """The same, but a quad that lies in no plane is cut along its shorter diagonal.

    MuJoCo reads an OBJ file so (tinyobjloader); the other diagonal bounds another volume.
    triangles: (k, 3), those of `polygon_triangles` for the same counts and corners.
    """
    fans = np.maximum(counts - 2, 0)
    starts, rows = ((np.cumsum(n) - n)[counts == 4] for n in (counts, fans))
    p0, p1, p2, p3 = (corners[starts + i] for i in range(4))
    spanned = np.abs(np.einsum("ij,ij->i", np.cross(p1 - p0, p2 - p0), p3 - p0))
    fan_cut, other = (np.einsum("ij,ij->i", d, d) for d in (p2 - p0, p3 - p1))
    is_fan = (triangles[rows] == np.stack([starts, starts + 1, starts + 2], axis=1)).all(axis=1)
    is_cut = is_fan & (other < fan_cut) & (spanned > SKEW * fan_cut**1.5)
    at, rows, turned = starts[is_cut], rows[is_cut], triangles.copy()
    turned[rows] = np.stack([at, at + 1, at + 3], axis=1)
    turned[rows + 1] = np.stack([at + 1, at + 2, at + 3], axis=1)
    return turned


def _areas(triangles: Array) -> Array:
    """(k, 3) m2: normals of triangles (k, 3, 3), twice as long as their area."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.cross(b - a, c - a)


def _ears(start: int, corners: Array) -> Indices:
    """(n - 2, 3) corner numbers from `start` on; the fan where ear clipping does not cover less.

    It is done in the plane that suits the polygon best, so that one whose corners lie in no plane,
    or whose edges cross, gets the triangles that cover the least.
    """
    import manifold3d

    fan = fan_triangles(np.array([len(corners)]))
    normal = _areas(corners[fan]).sum(axis=0)
    side = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    up = np.cross(normal, side)
    plane = np.stack([side / np.linalg.norm(side), up / np.linalg.norm(up)], axis=1)
    ears = np.asarray(manifold3d.triangulate([(corners - corners[0]) @ plane]), dtype=np.int64)
    whole, clipped = (np.linalg.norm(_areas(corners[t]), axis=1).sum() for t in (fan, ears))
    return start + (ears if len(ears) == len(fan) and clipped < whole else fan)
