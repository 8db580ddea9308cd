"""Cuts by planes: the hulls of the parts cover the mesh, and machined shapes fall apart exactly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from assetbuild.mesh.cover import Reference, rough, union_of
from assetbuild.mesh.cut import DIRECTIONS, cut_parts, tips
from assetbuild.mesh.hull import convex_hull
from assetbuild.mesh.merge import hulls_of
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import TriangleMesh, merged
from assetbuild.mesh.volume import signed_volume
from assetbuild.mesh.weld import cleaned
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Sphere


def solid(*boxes: tuple[tuple[float, float, float], tuple[float, float, float]]) -> TriangleMesh:
    """The union of boxes (size, centre)."""
    return cleaned(union_of([ConvexPiece(Box(size), Pose(at)) for size, at in boxes])[1])


def parts_of(mesh: TriangleMesh, count: int) -> list[TriangleMesh]:
    return hulls_of(cut_parts(mesh, *Reference(mesh).filling, count))


def test_an_l_falls_apart_at_its_inner_corner():
    mesh = solid(((2, 1, 1), (1, 0.5, 0.5)), ((1, 2, 1), (0.5, 1, 0.5)))
    parts = parts_of(mesh, 2)
    assert len(parts) == 2
    assert sum(map(signed_volume, parts)) == pytest.approx(3.0, rel=1e-5)


def test_the_inner_corner_may_lie_anywhere():
    """A step at 0.377 of the length, which no grid of places meets."""
    mesh = solid(((1, 1, 0.3), (0.5, 0.5, 0.15)), ((0.377, 1, 1), (0.1885, 0.5, 0.5)))
    assert sum(map(signed_volume, parts_of(mesh, 2))) == pytest.approx(
        0.377 + 0.623 * 0.3, rel=1e-5
    )


@pytest.mark.parametrize("middle", [(0.0, 0.0), (0.1, -0.1)])
def test_the_first_cut_of_a_frame_gains_nothing_and_the_second_one_shows_where_it_goes(middle):
    """A frame of four bars: any single plane leaves two hulls that are as large as its own."""
    x, y = middle
    left, right, low, high = x - 0.3, x + 0.3, y - 0.25, y + 0.25
    bars = [((-0.5, left), (-0.4, 0.4)), ((right, 0.5), (-0.4, 0.4)),
            ((left, right), (-0.4, low)), ((left, right), (high, 0.4))]  # fmt: skip
    mesh = solid(*(
        ((b - a, d - c, 0.2), ((a + b) / 2.0, (c + d) / 2.0, 0.0)) for (a, b), (c, d) in bars
    ))  # fmt: skip
    hulls = parts_of(mesh, 16)
    free = 0.6 * 0.5 * 0.2
    assert sum(map(signed_volume, hulls)) == pytest.approx(1.0 * 0.8 * 0.2 - free, rel=0.05)


def test_two_bodies_apart_come_apart():
    ball = tessellate(Sphere(0.1))
    two = merged([ball, ball.placed(Pose((1.0, 0.0, 0.0)))])
    parts = parts_of(two, 2)
    assert [part.bounds[1][0] < 0.5 for part in parts].count(True) == 1


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(st.lists(st.tuples(*(st.floats(0.2, 1.0) for _ in range(6))), min_size=2, max_size=4))
def test_the_hulls_of_the_parts_cover_every_vertex_and_nearly_the_whole_volume(boxes):
    mesh = solid(*((tuple(b[:3]), tuple(b[3:])) for b in boxes))
    parts = parts_of(mesh, 8)
    pieces = [ConvexPiece(part) for part in parts]
    away = np.min([piece.distance(mesh.vertices) for piece in pieces], axis=0)
    assert away.max() <= 1e-5
    assert rough(Reference(mesh), pieces).missing < 0.02


def test_more_parts_cover_less_that_is_outside():
    ring = solid(*(((0.2, 1.0, 0.2), (x, 0, 0)) for x in (-0.4, 0.4)),
                 *(((1.0, 0.2, 0.2), (0, y, 0)) for y in (-0.4, 0.4)))  # fmt: skip
    over = [
        rough(Reference(ring), [ConvexPiece(p) for p in parts_of(ring, count)]).over
        for count in (1, 2, 8)
    ]
    assert over[0] > 0.5
    assert over[0] >= over[1] > over[2]  # one cut through a ring gains nothing
    assert over[2] == pytest.approx(0.0, abs=0.01)


def test_the_same_parts_come_twice():
    mesh = solid(((2, 1, 1), (1, 0.5, 0.5)), ((1, 2, 1), (0.5, 1, 0.5)))
    first, second = (cut_parts(mesh, *Reference(mesh).filling, 6) for _ in range(2))
    assert [a.tobytes() for a in first] == [b.tobytes() for b in second]


def test_tips_stand_for_the_hull():
    ball = tessellate(Sphere(1.0)).vertices
    many = np.concatenate([ball * scale for scale in np.linspace(0.1, 1.0, 12)])
    assert len(tips(many)) <= DIRECTIONS < len(many)
    whole, some = (signed_volume(convex_hull(points)) for points in (many, tips(many)))
    assert some == pytest.approx(whole, rel=5e-3)
    assert tips(ball[:10]) is not None
    assert len(tips(ball[:10])) == 10


def test_no_two_points_of_a_part_are_one_to_float32():
    """A ball's edges meet the planes in places that differ by rounding alone."""
    ball = tessellate(Sphere(0.1)).placed(Pose((0.3, 0.2, 0.1)))
    two = merged([ball, ball.placed(Pose((0.15, 0.0, 0.0)))])
    for points in cut_parts(two, *Reference(two).filling, 8):
        held = np.unique(points.astype(np.float32), axis=0)
        assert len(held) == len(np.unique(points, axis=0))
