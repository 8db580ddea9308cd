"""Welding keeps the surface and joins what is equal."""

from __future__ import annotations

import numpy as np

from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.mesh.volume import is_closed
from assetbuild.mesh.weld import cleaned, drop_collapsed, drop_repeated, first_seen, weld
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
