"""Polygons are cut into triangles that cover what the polygon covers, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from assetbuild.mesh.triangles import fan_triangles, polygon_triangles

SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]
ARROW = [[0, 2], [0, 0], [2, 0], [0.2, 0.2]]
"""A quad with a corner that points inwards: the fan from its first corner covers too much."""
STAR = [
    [(1.0 + i % 2) * f(i * np.pi / 5) for f in (np.cos, np.sin)] for i in range(10)
]  # begins at an inner corner
KEYHOLE = [[0, 0], [4, 0], [4, 4], [0, 4], [0, 0], [1, 1], [1, 3], [3, 3], [3, 1], [1, 1]]
"""A square with a square hole, as exporters write it: a bridge leads in and out."""


def covered(polygon, turn) -> tuple[float, float, int]:
    """(area of the triangles, area by the shoelace formula, how many triangles)."""
    flat = np.array(polygon, dtype=np.float64)
    x, y = flat.T
    shoelace = 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))
    corners = np.column_stack([flat, np.full(len(flat), 3.0)]) @ np.asarray(turn).T
    cut = polygon_triangles(np.array([len(flat)]), corners)
    a, b, c = np.moveaxis(corners[cut], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2), shoelace, len(cut)


@pytest.mark.parametrize("polygon", [SQUARE, ARROW, STAR, KEYHOLE])
@pytest.mark.parametrize("is_mirrored", [False, True])
def test_triangles_cover_the_polygon(polygon, is_mirrored):
    turn, _ = np.linalg.qr(np.array([[1.0, 2, 3], [0, 1, 4], [5, 6, 0]]))
    area, shoelace, count = covered(polygon[::-1] if is_mirrored else polygon, turn)
    assert area == pytest.approx(shoelace, rel=1e-12)
    assert count == len(polygon) - 2


def test_convex_polygons_stay_fans_and_keep_their_place():
    polygons = [[[0, 0], [1, 0], [0, 1]], ARROW, SQUARE]
    flat = np.concatenate([np.array(p, dtype=np.float64) for p in polygons])
    corners = np.column_stack([flat, np.zeros(len(flat))])
    counts = np.array([3, 4, 4])
    cut, fans = polygon_triangles(counts, corners), fan_triangles(counts)
    assert cut[0].tolist() == fans[0].tolist()
    assert cut[3:].tolist() == fans[3:].tolist()
    assert sorted(np.unique(cut[1:3]).tolist()) == [3, 4, 5, 6]
    assert cut[1:3].tolist() != fans[1:3].tolist()


def test_a_polygon_without_area_or_numbers_is_a_fan():
    for corners in (np.zeros((5, 3)), np.full((5, 3), np.nan)):
        cut = polygon_triangles(np.array([5]), corners)
        assert cut.tolist() == fan_triangles(np.array([5])).tolist()
