"""Rays, distances between surfaces, and points that fill a box."""

from __future__ import annotations

import numpy as np
import pytest

from assetbuild.mesh.primitives import signed_distance, tessellate
from assetbuild.mesh.quality import NearestSurface, sobol, surface_distance, surface_samples
from assetbuild.mesh.rays import Across, missed
from assetbuild.mesh.solid import Solid
from assetbuild.mesh.triangles import TriangleMesh, merged
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Sphere

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
    assert missed(middles - 5.0 * DOWN, Across(mesh, -DOWN)).all()


def test_rays_miss_what_lies_behind_or_beside_them():
    above, beside = np.array([[0.0, 0.0, 2.0]]), np.array([[2.0, 0.0, 0.0], [2.0, 0.0, 0.6]])
    assert not missed(above, Across(CUBE, DOWN)).any()
    assert missed(above, Across(CUBE, -DOWN)).all()
    assert missed(beside, Across(CUBE, np.array([-1.0, 0.0, 0.0]))).tolist() == [False, True]


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


def test_parallel_boxes_are_as_far_apart_as_they_were_moved():
    grown = tessellate(Box((1.2, 1.2, 1.2)))
    found = surface_distance(CUBE, grown)
    assert found.mean_m == pytest.approx(0.1, abs=0.01)
    # The corner of the larger box is sqrt(3) x 0.1 away.
    assert 0.1 <= found.max_m <= 0.1 * 3**0.5 + 1e-9


def test_samples_are_the_same_for_a_seed_and_even():
    points, faces = surface_samples(CUBE, 1200, seed=3)
    assert np.array_equal(points, surface_samples(CUBE, 1200, seed=3)[0])
    assert np.bincount(faces).tolist() == pytest.approx([100] * 12, abs=1)
    assert np.abs(points).max() <= 0.5 + 1e-12


@pytest.mark.parametrize(
    "solid", [Box((1.0, 2.0, 0.5)), Sphere(0.7), Cylinder(0.5, 1.5), Capsule(0.4, 1.0)]
)
def test_inside_by_rays_and_by_formula_agree(solid):
    points = np.random.default_rng(2).uniform(-1.2, 1.2, size=(3000, 3))
    distance = signed_distance(solid, points)
    sure = np.abs(distance) > 5e-3  # the mesh is inscribed
    inside = Solid(tessellate(solid)).contains(points)
    assert np.array_equal(inside[sure], distance[sure] < 0.0)


@pytest.mark.parametrize(
    "solid", [Box((1.0, 2.0, 0.5)), Sphere(1.0), Cylinder(0.5, 1.5), Capsule(0.4, 1.0)]
)
def test_primitive_distances_agree_with_their_mesh(solid):
    points = np.random.default_rng(5).uniform(-1.5, 1.5, size=(300, 3))
    mesh = NearestSurface(tessellate(solid)).distance(points)
    assert np.abs(signed_distance(solid, points)) == pytest.approx(mesh, abs=4e-3)


@pytest.mark.parametrize("seed", [0, 1, 123456])
@pytest.mark.parametrize("count", [1, 64, 16384])
def test_the_points_are_those_of_scipy(count, seed):
    from scipy.stats import qmc  # takes a second: not while tests are collected

    lower, upper = np.array([-1.0, 0.0, 2.0]), np.array([1.0, 0.5, 7.0])
    theirs = qmc.Sobol(3, scramble=True, rng=np.random.default_rng(seed)).random(count)
    assert np.array_equal(sobol(count, lower, upper, seed), lower + theirs * (upper - lower))


def test_a_few_rays_strike_what_they_strike_among_many():
    """They are sorted into other cells: the same strikes, number by number."""
    one = tessellate(Sphere(0.5))
    ball = merged([one, one.scaled((0.9, 0.9, 0.9))])
    assert len(ball.faces) > 5000
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
