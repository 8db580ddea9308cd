"""How pieces cover a mesh, what is said about it, and cuts by planes."""

from __future__ import annotations

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solids import UNIT, solid

from assetbuild.mesh.cover import Reference, measure, outside, rough
from assetbuild.mesh.cut import DIRECTIONS, cut_parts, tips
from assetbuild.mesh.hull import convex_hull
from assetbuild.mesh.merge import hulls_of
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import TriangleMesh, signed_volume
from assetbuild.mesh.verdict import Probe, blocked_by, outside_in, verdict
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Sphere


def box(size, at=(0.0, 0.0, 0.0)) -> ConvexPiece:
    return ConvexPiece(Box(size), Pose(at))


def open_box() -> TriangleMesh:
    """A unit box without half its top: not a solid, but most rays know its inside."""
    top = np.flatnonzero(np.isclose(UNIT.corners[:, :, 2], 0.5).all(axis=1))
    return UNIT.select(np.arange(len(UNIT.faces)) != top[0])


def portal() -> tuple[TriangleMesh, list[ConvexPiece]]:
    """Two posts of 1 x 1 x 2 m and a lintel of 3 x 1 x 1 m on them: an opening of 1 m."""
    boxes = ((1, 1, 2), (-1, 0, 1)), ((1, 1, 2), (1, 0, 1)), ((3, 1, 1), (0, 0, 2.5))
    return solid(*boxes), [box(*each) for each in boxes]


def test_half_a_box_covers_half_of_it_exactly():
    quality = measure(Reference(UNIT), [box((0.5, 1.0, 1.0), (-0.25, 0.0, 0.0))])
    assert quality.exact and quality.closed
    assert quality.iou == pytest.approx(0.5, abs=1e-9)
    assert quality.missing == pytest.approx(0.5, abs=1e-9)
    assert quality.over == pytest.approx(0.0, abs=1e-9)
    assert quality.max_outside_m == 0.0
    assert quality.max_m == pytest.approx(0.5, abs=0.02)  # from the far face to the cut


@pytest.mark.parametrize("mesh", [portal()[0], open_box()])
def test_the_farthest_point_outside_is_that_of_a_look_at_all_points(mesh):
    reference = Reference(mesh)
    for seed in range(2):
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


def test_a_hull_fills_a_portal_that_its_parts_leave_open():
    mesh, pieces = portal()
    reference = Reference(mesh)
    closed, left = measure(reference, [ConvexPiece(reference.hull)]), measure(reference, pieces)
    assert closed.over == pytest.approx(2.0 / 7.0, rel=1e-6)
    assert closed.max_outside_m == pytest.approx(0.5, abs=0.03)  # the middle of the opening
    assert left.iou == pytest.approx(1.0, abs=1e-6)


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


CUBE = Reference(UNIT)


@pytest.mark.parametrize(
    ("width", "flat", "rules"),
    [
        (1.0, 0, []),
        (0.51, 0, []),
        (0.49, 0, ["collision.missing"]),
        (1.0, 2, ["collision.flat_piece"]),
    ],
)
def test_a_slab_of_a_cube_covers_its_width(width: float, flat: int, rules: list[str]):
    """1 m - `width` of the cube's 1 m is missing; half of it is the limit."""
    slab = ConvexPiece(Box((width, 1.0, 1.0)), Pose((width / 2 - 0.5, 0.0, 0.0)))
    quality = measure(CUBE, [slab], flat=flat)
    found = verdict(
        "mesh a", CUBE, [slab], quality,
        how="hull", tolerances={}, places=(), max_hulls=None, usual={},
    )  # fmt: skip
    told = {f.rule: f.data for f in found if f.rule != "collision.gap"}
    assert list(told) == rules
    if flat:
        assert told["collision.flat_piece"] == {"flat": 2, "pieces": 3}


def parts_of(mesh: TriangleMesh, count: int) -> list[TriangleMesh]:
    return hulls_of(cut_parts(mesh, *Reference(mesh).filling, count))


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


def test_a_probe_in_the_portal_tells_who_closes_it():
    mesh, pieces = portal()
    hull = ConvexPiece(convex_hull(mesh.vertices))
    bar = Probe((0.0, -2.0, 1.0), (0.0, 2.0, 1.0), 0.4)
    thick = Probe((0.0, -2.0, 1.0), (0.0, 2.0, 1.0), 0.6)
    assert blocked_by(hull, bar)
    assert not any(blocked_by(piece, bar) for piece in pieces)
    assert any(blocked_by(piece, thick) for piece in pieces)


def test_tips_stand_for_the_hull():
    ball = tessellate(Sphere(1.0)).vertices
    many = np.concatenate([ball * scale for scale in np.linspace(0.1, 1.0, 12)])
    assert len(tips(many)) <= DIRECTIONS < len(many)
    whole, some = (signed_volume(convex_hull(points)) for points in (many, tips(many)))
    assert some == pytest.approx(whole, rel=5e-3)
    assert tips(ball[:10]) is not None
    assert len(tips(ball[:10])) == 10


ORDER = """
import hashlib
from assetbuild.mesh.cover import union_of
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.robot.shapes import Sphere
faces = union_of([ConvexPiece(tessellate(Sphere(0.02)))])[1].faces
print(hashlib.sha256(faces.tobytes()).hexdigest())
"""


def test_triangles_of_a_union_come_in_one_order_in_every_process():
    """Samples on it are drawn by that order; the environment is that of a step."""
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", ORDER]
    runs = [subprocess.run(command, env=environment, stdout=subprocess.PIPE) for _ in range(3)]
    assert all(run.returncode == 0 for run in runs)
    assert len({run.stdout for run in runs}) == 1
