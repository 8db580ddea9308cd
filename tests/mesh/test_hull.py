"""Hulls are closed, outward, exact, and keep to their cap."""

from __future__ import annotations

import math

import numpy as np
import pytest

from assetbuild.errors import StepError
from assetbuild.mesh.hull import convex_hull, hull_planes, polygon_count
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.volume import is_closed, signed_volume
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Sphere


def grid(n: int = 7) -> np.ndarray:
    """A full lattice in the unit cube: most points lie in faces and edges of the hull."""
    axis = np.linspace(0.0, 1.0, n)
    return np.stack(np.meshgrid(axis, axis, axis), -1).reshape(-1, 3)


def test_the_hull_of_a_lattice_is_the_cube():
    hull = convex_hull(grid())
    assert len(hull.vertices) == 8
    assert len(hull.faces) == 12
    assert is_closed(hull)
    assert signed_volume(hull) == pytest.approx(1.0)
    assert polygon_count(hull) == 6


@pytest.mark.parametrize("cap", [4, 8, 16, 64])
def test_a_cap_is_kept_exactly_and_the_hull_stays_inside(cap):
    ball = tessellate(Sphere(1.0))
    hull = convex_hull(ball.vertices, max_vertices=cap)
    assert len(hull.vertices) == cap
    assert is_closed(hull)
    known = {tuple(v) for v in ball.vertices}
    assert all(tuple(v) in known for v in hull.vertices)
    assert 0.0 < signed_volume(hull) < 4 / 3 * math.pi


def test_sixty_four_vertices_are_most_of_a_ball():
    hull = convex_hull(tessellate(Sphere(1.0)).vertices, max_vertices=64)
    assert signed_volume(hull) > 0.89 * 4 / 3 * math.pi


@pytest.mark.parametrize(
    ("solid", "volume", "polygons"),
    [
        (Box((1.0, 2.0, 3.0)), 6.0, 6),
        (Sphere(1.0), 4 / 3 * math.pi, None),
        (Cylinder(0.5, 2.0), math.pi / 2, 66),
        (Capsule(0.5, 2.0), math.pi / 2 + math.pi / 6, None),
    ],
)
def test_tessellated_primitives_have_the_volume_of_the_formula(solid, volume, polygons):
    mesh = tessellate(solid)
    assert is_closed(mesh)
    assert signed_volume(mesh) == pytest.approx(volume, rel=5e-3)
    assert polygons is None or polygon_count(mesh) == polygons


def test_planes_have_every_vertex_inside():
    hull = convex_hull(np.random.default_rng(1).normal(size=(200, 3)))
    planes = hull_planes(hull)
    assert (hull.vertices @ planes[:, :3].T + planes[:, 3]).max() < 1e-12


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_scale_and_offset_do_not_matter(scale):
    points = grid(3) * scale + 1e3 * scale
    hull = convex_hull(points)
    assert len(hull.vertices) == 8
    assert signed_volume(hull) == pytest.approx(scale**3, rel=1e-6)


@pytest.mark.parametrize(
    ("points", "says"),
    [
        (np.zeros((3, 3)), "4 distinct points"),
        (np.column_stack([grid(3)[:, :2], np.zeros(27)]), "flat"),
        (np.outer(np.arange(9.0), [1, 2, 3]), "flat"),
        (np.array([[np.nan, 0, 0], *np.eye(3)]), "finite"),
    ],
)
def test_points_without_a_volume_are_an_error_that_says_so(points, says):
    with pytest.raises(StepError, match=says):
        convex_hull(points, subject="mesh thin.stl")


def test_the_same_points_in_another_order_give_the_same_hull():
    points = np.random.default_rng(2).normal(size=(300, 3))
    a = convex_hull(points, max_vertices=32)
    b = convex_hull(points[::-1], max_vertices=32)
    assert np.array_equal(a.vertices, b.vertices)
    assert np.array_equal(a.faces, b.faces)
