"""Areas, volumes and centroids against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from assetbuild.mesh.triangles import TriangleMesh, fan_triangles, merged
from assetbuild.mesh.volume import area, is_closed, signed_volume, solid_moments
from assetbuild.robot.pose import Pose, quat_of_rpy


def box(size=(1.0, 1.0, 1.0), at=(0.0, 0.0, 0.0)) -> TriangleMesh:
    """Quads listed by hand, counter-clockwise from outside."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [(a, b, c) for a, b, c, _ in quads] + [(a, c, d) for a, _, c, d in quads]
    return TriangleMesh((corners - 0.5) * size + at, np.array(faces))


def torus(big=1.0, small=0.25, around=200, across=100) -> TriangleMesh:
    u, v = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = 2 * np.pi * u / around, 2 * np.pi * v / across
    ring = big + small * np.cos(b)
    points = np.stack([ring * np.cos(a), ring * np.sin(a), small * np.sin(b)], -1).reshape(-1, 3)
    i = (u * across + v).ravel()
    j = ((u + 1) % around * across + v).ravel()
    k = ((u + 1) % around * across + (v + 1) % across).ravel()
    m = (u * across + (v + 1) % across).ravel()
    faces = np.concatenate([np.stack([i, j, k], 1), np.stack([i, k, m], 1)])
    return TriangleMesh(points, faces)


def test_a_box_has_the_area_volume_and_centre_of_a_box():
    mesh = box((1.0, 2.0, 3.0), at=(5.0, 0.0, -1.0))
    assert area(mesh) == pytest.approx(22.0)
    assert signed_volume(mesh) == pytest.approx(6.0)
    assert solid_moments(mesh)[1] == pytest.approx([5.0, 0.0, -1.0])
    assert is_closed(mesh)


def test_a_torus_has_the_volume_that_pappus_gives():
    mesh = torus()
    assert signed_volume(mesh) == pytest.approx(2 * math.pi**2 * 1.0 * 0.25**2, rel=2e-3)
    assert area(mesh) == pytest.approx(4 * math.pi**2 * 1.0 * 0.25, rel=2e-3)
    assert solid_moments(mesh)[1] == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)


def test_volume_survives_a_mesh_far_from_the_origin():
    assert signed_volume(box(at=(1e6, -1e6, 1e6))) == pytest.approx(1.0, rel=1e-9)


def test_a_box_without_a_lid_and_one_with_a_turned_face_are_open():
    mesh = box()
    assert not is_closed(mesh.select(np.arange(1, 12)))
    turned = mesh.faces.copy()
    turned[0] = turned[0][::-1]
    assert not is_closed(TriangleMesh(mesh.vertices, turned))


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


def test_scale_zero_is_refused():
    with pytest.raises(ValueError, match="zero"):
        box().scaled((1.0, 0.0, 1.0))


def test_merging_adds_areas():
    assert area(merged([box(), box((2.0, 2.0, 2.0))])) == pytest.approx(30.0)


def test_polygons_are_cut_into_fans():
    fans = fan_triangles(np.array([3, 5, 2, 4]))
    expected = [[0, 1, 2], [3, 4, 5], [3, 5, 6], [3, 6, 7], [10, 11, 12], [10, 12, 13]]
    assert fans.tolist() == expected


def _normals(mesh: TriangleMesh) -> np.ndarray:
    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    n = np.cross(b - a, c - a)
    return n / np.linalg.norm(n, axis=1)[:, None]
