"""Welding keeps the surface and joins what is equal."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.mesh.volume import is_closed
from assetbuild.mesh.weld import (
    _mixed,
    cleaned,
    drop_collapsed,
    drop_repeated,
    first_seen,
    weld,
)
from assetbuild.robot.shapes import Box


def soup(mesh: TriangleMesh) -> TriangleMesh:
    """Each triangle with corners of its own, as an STL file has them."""
    corners = mesh.corners.reshape(-1, 3)
    return TriangleMesh(corners, np.arange(len(corners)).reshape(-1, 3))


def test_the_triangles_of_a_box_share_eight_vertices_and_close():
    box = tessellate(Box((1.0, 2.0, 3.0)))
    welded = weld(soup(box))
    assert len(welded.vertices) == 8
    assert is_closed(welded)
    assert np.array_equal(welded.corners, box.corners)


def test_vertices_are_numbered_by_first_appearance_and_unused_ones_go():
    points = np.array([[9.0, 9, 9], [1, 0, 0], [0, 0, 0], [0, 1, 0], [1, 0, 0]])
    mesh = weld(TriangleMesh(points, np.array([[2, 1, 3], [3, 4, 2]])))
    assert mesh.faces.tolist() == [[1, 0, 2], [2, 0, 1]]
    assert mesh.vertices.tolist() == [[1, 0, 0], [0, 0, 0], [0, 1, 0]]


def test_minus_zero_is_zero():
    first, number = first_seen(np.array([[0.0, 1.0], [-0.0, 1.0], [0.0, 2.0]]))
    assert first.tolist() == [0, 2]
    assert number.tolist() == [0, 0, 1]


def test_two_rows_of_one_hash_stay_two():
    first, other = np.array([[0.25, 0.5]]).view(np.uint64), np.uint64(0x3FF0000000000000)
    before = _mixed(np.array([[first[0, 0]], [other]]))
    collides = first[0, 1] ^ before[0] ^ before[1]
    rows = np.array([[other, collides], first[0], first[0]], dtype=np.uint64)
    assert len(set(_mixed(rows).tolist())) == 1
    found, number = first_seen(rows.view(np.float64))
    assert found.tolist() == [0, 1]
    assert number.tolist() == [0, 1, 1]


@given(st.lists(st.tuples(*[st.sampled_from([0.0, -0.0, 1.0, 1e-300, np.pi])] * 3), max_size=40))
def test_rows_are_counted_as_a_dictionary_counts_them(rows):
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


def test_a_seam_in_texture_does_not_split_the_surface():
    box = soup(tessellate(Box((1.0, 1.0, 1.0))))
    uv = np.random.default_rng(0).random((12, 3, 2))
    welded = weld(TriangleMesh(box.vertices, box.faces, uv))
    assert len(welded.vertices) == 8
    assert np.array_equal(welded.uv, uv)
