"""Distances between surfaces that are known by construction."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from assetbuild.mesh.cover import Reference, rough
from assetbuild.mesh.hull import convex_hull
from assetbuild.mesh.primitives import signed_distance, tessellate
from assetbuild.mesh.quality import (
    NearestSurface,
    point_triangle_distance,
    surface_distance,
    surface_samples,
)
from assetbuild.mesh.solid import ConvexPiece, Solid
from assetbuild.mesh.triangles import merged
from assetbuild.mesh.volume import area
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Sphere


def test_parallel_boxes_are_as_far_apart_as_they_were_moved():
    box = tessellate(Box((1.0, 1.0, 1.0)))
    grown = tessellate(Box((1.2, 1.2, 1.2)))
    found = surface_distance(box, grown)
    assert found.mean_m == pytest.approx(0.1, abs=0.01)
    # The corner of the larger box is sqrt(3) x 0.1 away.
    assert 0.1 <= found.max_m <= 0.1 * 3**0.5 + 1e-9


def test_a_surface_has_no_distance_to_itself():
    needles = tessellate(Cylinder(0.02, 1.0))
    found = surface_distance(needles, needles)
    assert found.p99_m < 1e-9
    assert found.max_m < 1e-3 * needles.diagonal


def test_triangle_distance_agrees_with_trimesh():
    rng = np.random.default_rng(0)
    triangles, points = rng.normal(size=(400, 3, 3)), rng.normal(size=(400, 3))
    other = trimesh.triangles.closest_point(triangles, points)
    expected = np.linalg.norm(other - points, axis=1)
    assert point_triangle_distance(points, triangles) == pytest.approx(expected, abs=1e-9)


def test_the_nearest_surface_agrees_with_the_distance_to_a_sphere():
    ball = tessellate(Sphere(1.0))
    points = np.random.default_rng(1).normal(size=(500, 3))
    expected = np.abs(np.linalg.norm(points, axis=1) - 1.0)
    assert NearestSurface(ball).distance(points) == pytest.approx(expected, abs=4e-3)


def test_samples_are_the_same_for_a_seed_and_even():
    box = tessellate(Box((1.0, 1.0, 1.0)))
    points, faces = surface_samples(box, 1200, seed=3)
    assert np.array_equal(points, surface_samples(box, 1200, seed=3)[0])
    assert np.bincount(faces).tolist() == pytest.approx([100] * 12, abs=1)
    assert np.abs(points).max() <= 0.5 + 1e-12


def test_a_lost_part_shows_in_the_area():
    box = tessellate(Box((1.0, 1.0, 1.0)))
    assert area(box.select(np.arange(6))) / area(box) == pytest.approx(0.5)


@pytest.mark.parametrize(
    "solid", [Box((1.0, 2.0, 0.5)), Sphere(0.7), Cylinder(0.5, 1.5), Capsule(0.4, 1.0)]
)
def test_inside_by_rays_and_by_formula_agree(solid):
    points = np.random.default_rng(2).uniform(-1.2, 1.2, size=(3000, 3))
    distance = signed_distance(solid, points)
    sure = np.abs(distance) > 5e-3  # the mesh is inscribed
    inside = Solid(tessellate(solid)).contains(points)
    assert np.array_equal(inside[sure], distance[sure] < 0.0)


@pytest.mark.parametrize("solid", [Box((1.0, 2.0, 0.5)), Cylinder(0.5, 1.5), Capsule(0.4, 1.0)])
def test_primitive_distances_agree_with_their_mesh(solid):
    points = np.random.default_rng(5).uniform(-1.5, 1.5, size=(300, 3))
    mesh = NearestSurface(tessellate(solid)).distance(points)
    assert np.abs(signed_distance(solid, points)) == pytest.approx(mesh, abs=4e-3)


def test_the_hull_of_an_l_shape_sticks_out_by_the_depth_of_its_notch():
    legs = [Box((2.0, 1.0, 1.0)), Box((1.0, 1.0, 1.0))]
    shape = merged([tessellate(legs[0]), tessellate(legs[1]).mapped(np.eye(3), (-0.5, 1.0, 0.0))])
    cover = rough(Reference(shape), [ConvexPiece(convex_hull(shape.vertices))])
    assert cover.over == pytest.approx(0.5 / 3.0, abs=0.02)
    # Middle of the slanted edge from (1, 0.5) to (0, 1.5), seen from the notch's walls.
    assert cover.max_outside_m == pytest.approx(0.5, abs=0.03)
    assert cover.missing < 0.01
