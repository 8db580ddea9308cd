"""Metrics of collision geometry on solids whose answer is known in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from assetbuild.mesh.cover import (
    Reference,
    blocked_by,
    measure,
    outside,
    outside_in,
    rough,
    union_of,
)
from assetbuild.mesh.hull import convex_hull, polygon_count
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.sources import Probe
from assetbuild.mesh.triangles import TriangleMesh, merged
from assetbuild.mesh.weld import cleaned
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Capsule, Sphere

UNIT = tessellate(Box((1.0, 1.0, 1.0)))


def box(size, at=(0.0, 0.0, 0.0)) -> ConvexPiece:
    return ConvexPiece(Box(size), Pose(at))


def open_box() -> TriangleMesh:
    """A unit box without half its top: not a solid, but most rays know its inside."""
    top = np.flatnonzero(np.isclose(UNIT.corners[:, :, 2], 0.5).all(axis=1))
    return UNIT.select(np.arange(len(UNIT.faces)) != top[0])


def portal() -> tuple[TriangleMesh, list[ConvexPiece]]:
    """Two posts of 1 x 1 x 2 m and a lintel of 3 x 1 x 1 m on them: an opening of 1 m."""
    pieces = [
        box((1.0, 1.0, 2.0), (-1.0, 0.0, 1.0)),
        box((1.0, 1.0, 2.0), (1.0, 0.0, 1.0)),
        box((3.0, 1.0, 1.0), (0.0, 0.0, 2.5)),
    ]
    return cleaned(union_of(pieces)[1]), pieces


def test_half_a_box_covers_half_of_it_exactly():
    quality = measure(Reference(UNIT), [box((0.5, 1.0, 1.0), (-0.25, 0.0, 0.0))])
    assert quality.exact and quality.closed
    assert quality.iou == pytest.approx(0.5, abs=1e-9)
    assert quality.missing == pytest.approx(0.5, abs=1e-9)
    assert quality.over == pytest.approx(0.0, abs=1e-9)
    assert quality.max_outside_m == 0.0
    assert quality.max_m == pytest.approx(0.5, abs=0.02)  # from the far face to the cut


@pytest.mark.parametrize("mesh", [portal()[0], open_box(), tessellate(Sphere(0.4))])
def test_the_farthest_point_outside_is_that_of_a_look_at_all_points(mesh):
    reference = Reference(mesh)
    for seed in range(5):
        points = np.random.default_rng(seed).normal(scale=0.6, size=(3000, 3))
        away = points[~reference.solid.contains(points)]
        most = reference.surface.at_most(points)
        assert (most >= reference.surface.distance(points) - 1e-12).all()
        assert outside(reference, points) == reference.surface.distance(away).max()
        inside = points[reference.solid.contains(points)]
        assert outside(reference, inside) == 0.0
    assert outside(reference, np.zeros((0, 3))) == 0.0


def test_a_box_that_is_a_fifth_larger_is_known_by_its_volume_and_corners():
    quality = measure(Reference(UNIT), [box((1.2, 1.2, 1.2))])
    assert quality.over == pytest.approx(1.2**3 - 1.0, rel=1e-9)
    assert quality.missing == pytest.approx(0.0, abs=1e-9)
    assert quality.max_outside_m == pytest.approx(0.1 * math.sqrt(3.0), rel=1e-6)
    assert 0.1 <= quality.mean_m <= 0.11
    assert quality.p99_m <= 0.1 * math.sqrt(3.0)


def test_overlapping_pieces_are_not_counted_twice():
    quality = measure(Reference(UNIT), [box((1.0, 1.0, 1.0)), box((1.0, 1.0, 0.5))])
    assert quality.iou == pytest.approx(1.0, abs=1e-9)
    assert quality.pieces == 2


def test_an_open_box_is_sampled_and_nearly_as_exact():
    quality = measure(Reference(open_box()), [box((0.5, 1.0, 1.0), (-0.25, 0.0, 0.0))])
    assert not quality.exact and not quality.closed
    assert quality.iou == pytest.approx(0.5, abs=0.05)
    assert quality.missing == pytest.approx(0.5, abs=0.05)


def test_a_sheet_is_compared_with_its_hull():
    turned = TriangleMesh(
        np.array([[0.0, 0, 0], [1, 0, 0.3], [1, 1, 0.0], [0, 1, 0.3]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    reference = Reference(turned)
    assert reference.hollow
    assert rough(reference, [ConvexPiece(reference.hull)]).iou == pytest.approx(1.0, abs=1e-6)


def test_a_hull_closes_a_portal_and_its_parts_leave_it_open():
    mesh, pieces = portal()
    reference = Reference(mesh)
    closed, left = measure(reference, [ConvexPiece(reference.hull)]), measure(reference, pieces)
    assert closed.see_through == 0.0
    assert left.see_through > 0.99
    assert left.rays == closed.rays > 100
    assert closed.over == pytest.approx(2.0 / 7.0, rel=1e-6)
    assert closed.max_outside_m == pytest.approx(0.5, abs=0.03)  # the middle of the opening
    assert left.iou == pytest.approx(1.0, abs=1e-6)


def test_a_probe_in_the_portal_tells_who_closes_it():
    mesh, pieces = portal()
    hull = ConvexPiece(convex_hull(mesh.vertices))
    bar = Probe((0.0, -2.0, 1.0), (0.0, 2.0, 1.0), 0.4)
    thick = Probe((0.0, -2.0, 1.0), (0.0, 2.0, 1.0), 0.6)
    assert blocked_by(hull, bar)
    assert not any(blocked_by(piece, bar) for piece in pieces)
    assert any(blocked_by(piece, thick) for piece in pieces)


def test_a_region_knows_how_far_pieces_stick_out_of_the_mesh_there():
    reference = Reference(UNIT)
    lid = [box((1.0, 1.0, 1.2), (0.0, 0.0, 0.1))]
    top, bottom = (
        Probe((0.0, 0.0, 0.7), (0.0, 0.0, 0.7), 0.3),
        Probe((0, 0, -0.7), (0, 0, -0.7), 0.3),
    )
    assert outside_in(reference, lid, top) == pytest.approx(0.2, abs=1e-3)
    assert outside_in(reference, lid, bottom) == 0.0


def test_the_distance_to_a_probe_is_that_of_a_capsule():
    probe = Probe((0.0, 0.0, -0.5), (0.0, 0.0, 0.5), 0.1)
    points = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.2], [0.0, 0.0, 0.9]])
    assert probe.distance(points) == pytest.approx([-0.1, 0.2, 0.3])


def test_a_ball_counts_its_polygons_and_keeps_the_cap():
    ball = tessellate(Sphere(0.5)).vertices
    hull = convex_hull(ball, max_vertices=64, max_polygons=64)
    assert polygon_count(hull) <= 64
    assert 30 <= len(hull.vertices) <= 64
    assert polygon_count(UNIT) == 6
    assert len(convex_hull(UNIT.vertices, max_vertices=64, max_polygons=64).vertices) == 8


def test_a_capsule_of_ours_covers_its_own_mesh():
    solid = Capsule(0.1, 0.4)
    quality = measure(Reference(tessellate(solid)), [ConvexPiece(solid)])
    assert quality.iou > 0.999
    assert quality.max_m < 1e-3


def test_two_disjoint_boxes_are_one_mesh():
    far = UNIT.mapped(np.eye(3), (3.0, 0.0, 0.0))
    reference = Reference(cleaned(merged([UNIT, far])))
    assert reference.volume == pytest.approx(2.0)
    assert rough(reference, [box((1.0, 1.0, 1.0))]).missing == pytest.approx(0.5)
