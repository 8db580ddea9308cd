"""Parallel rays strike what lies on their way, an edge once, and the inside follows from parity."""

from __future__ import annotations

import numpy as np
import pytest

from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.rays import Across, missed
from assetbuild.mesh.solid import Solid
from assetbuild.mesh.triangles import TriangleMesh, merged
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Sphere

CUBE = tessellate(Box((1.0, 1.0, 1.0)))
DOWN = np.array([0.0, 0.0, -1.0])


def test_a_ray_strikes_the_lid_and_the_bottom_of_a_box():
    struck = Across(CUBE, DOWN).strike(np.array([[0.1, 0.2, 2.0], [0.9, 0.0, 2.0]]))
    assert struck.ray.tolist() == [0, 0]
    assert struck.depth == pytest.approx([1.5, 2.5])
    assert struck.front.tolist() == [True, False]


def test_a_ray_along_a_shared_edge_strikes_one_of_its_triangles():
    """Both diagonals of the faces, their middle, and the vertices of a fan."""
    steps = np.linspace(-0.49, 0.49, 99)
    on_diagonals = np.array([[x, s * x, 2.0] for x in steps for s in (1.0, -1.0)])
    struck = Across(CUBE, DOWN).strike(on_diagonals)
    assert np.bincount(struck.ray).tolist() == [2] * len(on_diagonals)


def test_long_slivers_are_found_wherever_they_lie():
    """Each of 400 thin triangles in the plane is struck in its middle, whatever its direction."""
    turns = np.linspace(0.0, np.pi, 400, endpoint=False)
    far, side = np.stack([np.cos(turns), np.sin(turns), 0 * turns], 1), 1e-3
    across = np.stack([-np.sin(turns), np.cos(turns), 0 * turns], 1)
    corners = np.stack([-far, far - side * across, far + side * across], axis=1)
    mesh = TriangleMesh(corners.reshape(-1, 3), np.arange(1200).reshape(-1, 3))
    middles = corners.mean(axis=1) - DOWN
    struck = Across(mesh, DOWN).strike(middles)
    assert set(struck.ray.tolist()) == set(range(400))
    assert missed(middles - 5.0 * DOWN, np.tile(-DOWN, (400, 1)), mesh).all()


def test_a_few_rays_strike_what_they_strike_among_many():
    """Few rays look at the triangles near them alone: the same strikes, number by number."""
    ball = tessellate(Sphere(0.5))
    while len(ball.faces) < 5000:
        ball = split(ball)
    rng = np.random.default_rng(3)
    origins = np.column_stack(
        [rng.uniform(-0.6, 0.6, (len(ball.faces), 2)), np.full(len(ball.faces), 2.0)]
    )
    origins[:3, :2] = ball.vertices[:3, :2]  # and through corners
    view = Across(ball, np.array([0.2, 0.1, -1.0]))
    many, few = view.strike(origins), view.strike(origins[:40])
    first = many.ray < 40
    for name in ("ray", "depth", "front"):
        assert np.array_equal(getattr(many, name)[first], getattr(few, name))


def split(mesh: TriangleMesh) -> TriangleMesh:
    """Four triangles for each."""
    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    ab, bc, ca = (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0
    corners = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    points = np.concatenate([np.stack(three, axis=1) for three in corners]).reshape(-1, 3)
    return TriangleMesh(points, np.arange(len(points)).reshape(-1, 3))


def test_rays_of_several_directions_miss_what_lies_behind_or_beside_them():
    origins = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 2.0], [2.0, 0.0, 0.0], [2.0, 0.0, 0.6]])
    directions = np.array([DOWN, -DOWN, [-1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    assert missed(origins, directions, CUBE).tolist() == [False, True, False, True]


@pytest.mark.parametrize(
    "mesh",
    [
        merged([CUBE, CUBE]),  # drawn twice
        merged([CUBE, CUBE.placed(Pose((1.0, 0.0, 0.0)))]),  # a wall shared
        merged([tessellate(Sphere(0.5)), CUBE.placed(Pose((0.0, 0.0, 5.0)))]),
    ],
    ids=["twice", "touching", "apart"],
)
def test_the_middle_of_a_part_is_inside_whatever_else_there_is(mesh):
    points = np.array([[0.01, 0.02, 0.03], [0.01, 0.02, 1.03], [-0.7, 0.0, 0.0]])
    assert Solid(mesh).contains(points).tolist() == [True, False, False]
