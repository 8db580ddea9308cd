"""Polygons become triangles, equal vertices one, and area and volume are the textbook's."""

from __future__ import annotations

import math
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from assetbuild.mesh import triangles
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.triangles import (
    TriangleMesh,
    area,
    cleaned,
    drop_collapsed,
    drop_repeated,
    fan_triangles,
    first_seen,
    polygon_triangles,
    signed_volume,
    solid_moments,
    weld,
)
from assetbuild.robot.pose import Pose, quat_of_rpy
from assetbuild.robot.shapes import Box

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


def soup(mesh: TriangleMesh) -> TriangleMesh:
    """Each triangle with corners of its own, as an STL file has them."""
    corners = mesh.corners.reshape(-1, 3)
    return TriangleMesh(corners, np.arange(len(corners)).reshape(-1, 3))


@pytest.mark.parametrize("uv", [None, np.random.default_rng(0).random((12, 3, 2))])
def test_the_triangles_of_a_box_share_eight_vertices_and_close(uv):
    """Though a seam in the texture parts them."""
    box = tessellate(Box((1.0, 2.0, 3.0)))
    welded = weld(replace(soup(box), uv=uv))
    assert len(welded.vertices) == 8
    assert welded.is_closed
    assert np.array_equal(welded.corners, box.corners)
    assert welded.uv is uv


def test_vertices_are_numbered_by_first_appearance_and_unused_ones_go():
    points = np.array([[9.0, 9, 9], [1, 0, 0], [0, 0, 0], [0, 1, 0], [1, 0, 0]])
    mesh = weld(TriangleMesh(points, np.array([[2, 1, 3], [3, 4, 2]])))
    assert mesh.faces.tolist() == [[1, 0, 2], [2, 0, 1]]
    assert mesh.vertices.tolist() == [[1, 0, 0], [0, 0, 0], [0, 1, 0]]


@given(
    st.lists(st.tuples(*[st.sampled_from([0.0, -0.0, 1.0, 1e-300, np.pi])] * 3), max_size=40),
    st.sampled_from([triangles.MIXING, np.uint64(0)]),
)
def test_rows_are_counted_as_a_dictionary_counts_them(rows, mixing):
    with patch.object(triangles, "MIXING", mixing):  # of 0, all rows share a key
        first, number = first_seen(np.array(rows, dtype=np.float64).reshape(-1, 3))
    distinct = list(dict.fromkeys(rows))
    assert first.tolist() == [rows.index(row) for row in distinct]
    assert number.tolist() == [distinct.index(row) for row in rows]


def test_collapsed_and_repeated_faces_go_and_the_back_side_stays():
    points = np.eye(3)
    faces = np.array([[0, 1, 2], [1, 2, 0], [2, 1, 0], [0, 1, 1]])
    mesh = TriangleMesh(points, faces)
    assert drop_collapsed(mesh).faces.tolist() == faces[:3].tolist()
    assert drop_repeated(mesh).faces.tolist() == [[0, 1, 2], [2, 1, 0], [0, 1, 1]]
    assert len(cleaned(mesh).faces) == 2


def box(size=(1.0, 1.0, 1.0), at=(0.0, 0.0, 0.0)) -> TriangleMesh:
    """Quads listed by hand, counter-clockwise from outside."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [(a, b, c) for a, b, c, _ in quads] + [(a, c, d) for a, _, c, d in quads]
    return TriangleMesh((corners - 0.5) * size + at, np.array(faces))


def test_a_box_has_the_area_volume_and_centre_of_a_box():
    mesh = box((1.0, 2.0, 3.0), at=(5.0, 0.0, -1.0))
    assert area(mesh) == pytest.approx(22.0)
    assert signed_volume(mesh) == pytest.approx(6.0)
    assert solid_moments(mesh)[1] == pytest.approx([5.0, 0.0, -1.0])
    assert mesh.is_closed


def test_a_box_without_a_lid_and_one_with_a_turned_face_are_open():
    mesh = box()
    assert not mesh.select(np.arange(1, 12)).is_closed
    turned = mesh.faces.copy()
    turned[0] = turned[0][::-1]
    assert not TriangleMesh(mesh.vertices, turned).is_closed


def test_a_mirroring_scale_keeps_outward_faces_and_normals():
    mesh = box((1.0, 2.0, 3.0), at=(1.0, 2.0, 3.0))
    outward = np.repeat(_normals(mesh)[:, None], 3, axis=1)
    mirrored = TriangleMesh(mesh.vertices, mesh.faces, None, outward).scaled((1.0, -1.0, 2.0))
    assert signed_volume(mirrored) == pytest.approx(12.0)
    assert mirrored.bounds[0] == pytest.approx([0.5, -3.0, 3.0])
    assert mirrored.normals[:, 0] == pytest.approx(_normals(mirrored))


def test_placing_turns_and_moves():
    pose = Pose((1.0, 0.0, 0.0), quat_of_rpy(0.0, 0.0, math.pi / 2))
    lower, upper = box((4.0, 2.0, 2.0)).placed(pose).bounds
    assert lower == pytest.approx([0.0, -2.0, -1.0])
    assert upper == pytest.approx([2.0, 2.0, 1.0])


def _normals(mesh: TriangleMesh) -> np.ndarray:
    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    n = np.cross(b - a, c - a)
    return n / np.linalg.norm(n, axis=1)[:, None]


def test_scale_zero_is_refused():
    with pytest.raises(ValueError, match="zero"):
        box().scaled((1.0, 0.0, 1.0))
