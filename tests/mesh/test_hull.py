"""Hulls hold their points and keep their caps, and primitives are what they say."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from assetbuild.errors import StepError
from assetbuild.mesh.arrays import read_meshes, write_meshes
from assetbuild.mesh.cover import Reference
from assetbuild.mesh.fit_many import Cloud
from assetbuild.mesh.hull import capped, convex_hull, hull_or_points, polygon_count
from assetbuild.mesh.hulls import common_hull
from assetbuild.mesh.primitives import distance_slopes, resized, signed_distance, tessellate
from assetbuild.mesh.triangles import TriangleMesh, signed_volume, solid_moments
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Primitive, Sphere, sizes_of


def grid(n: int = 7) -> np.ndarray:
    """A full lattice in the unit cube: most points lie in faces and edges of the hull."""
    axis = np.linspace(0.0, 1.0, n)
    return np.stack(np.meshgrid(axis, axis, axis), -1).reshape(-1, 3)


def test_the_hull_of_a_lattice_is_the_cube():
    hull = convex_hull(grid())
    assert len(hull.vertices) == 8
    assert len(hull.faces) == 12
    assert hull.is_closed
    assert signed_volume(hull) == pytest.approx(1.0)
    assert polygon_count(hull) == 6
    assert capped(hull, 64, 64) is hull


@pytest.mark.parametrize("cap", [4, 8, 16, 64])
def test_a_cap_is_kept_exactly_and_the_hull_stays_inside(cap):
    ball = tessellate(Sphere(1.0))
    hull = capped(convex_hull(ball.vertices), cap)
    assert len(hull.vertices) == cap
    assert hull.is_closed
    known = {tuple(v) for v in ball.vertices}
    assert all(tuple(v) in known for v in hull.vertices)
    assert 0.0 < signed_volume(hull) < 4 / 3 * math.pi


def test_a_cap_of_polygons_is_kept_too():
    flat = capped(convex_hull(tessellate(Sphere(1.0)).vertices), 64, 64)
    assert polygon_count(flat) <= 64
    assert 30 <= len(flat.vertices) <= 64


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
    assert mesh.is_closed
    assert signed_volume(mesh) == pytest.approx(volume, rel=5e-3)
    assert polygons is None or polygon_count(mesh) == polygons


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


SQUARE = TriangleMesh(
    np.array([(0.0, 0.0, 0.1), (1.0, 0.0, 0.1), (1.0, 1.0, 0.1), (0.0, 1.0, 0.1)]),
    np.array([(0, 1, 2), (0, 2, 3)]),
)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_meshes_are_read_as_they_were_written(count: int, tmp_path: Path) -> None:
    meshes = [tessellate(Box((1.0, 2.0, 3.0))), SQUARE, tessellate(Sphere(0.1))][:count]
    write_meshes(tmp_path / "all.npz", {f"m{i}": mesh for i, mesh in enumerate(meshes)})
    found = read_meshes(tmp_path / "all.npz")
    assert list(found) == [f"m{i}" for i in range(count)]
    for mesh, read in zip(meshes, found.values(), strict=True):
        assert np.array_equal(mesh.vertices, read.vertices)
        assert np.array_equal(mesh.faces, read.faces)
        assert read.faces.dtype == np.int64


def test_a_flat_mesh_has_points_and_no_hull() -> None:
    flat = hull_or_points(SQUARE.vertices)
    for made in (flat, common_hull([flat, flat])):
        assert np.array_equal(np.unique(made.vertices, axis=0), np.unique(SQUARE.vertices, axis=0))
        assert not len(made.faces)


STEP = 1e-6
POINTS = np.random.default_rng(0).uniform(-1.0, 1.0, (200, 3))
KINDS = (Sphere(0.5), Box((0.9, 0.6, 0.4)), Capsule(0.3, 0.8), Cylinder(0.4, 0.7))


@pytest.mark.parametrize("primitive", KINDS, ids=lambda p: type(p).__name__)
def test_slopes_are_those_of_the_distance(primitive: Primitive):
    by_point, by_size = distance_slopes(primitive, POINTS)
    for axis, step in enumerate(STEP * np.eye(3)):
        there, back = (signed_distance(primitive, POINTS + side * step) for side in (1, -1))
        assert by_point[:, axis] == pytest.approx((there - back) / (2 * STEP), abs=1e-6)
    sizes = np.asarray(sizes_of(primitive))
    for number, step in enumerate(STEP * np.eye(len(sizes))):
        wide, narrow = (
            signed_distance(resized(type(primitive), sizes + side * step), POINTS)
            for side in (1, -1)
        )
        assert by_size[:, number] == pytest.approx((wide - narrow) / (2 * STEP), abs=1e-6)


def test_the_score_of_a_union_slopes_as_it_changes():
    # Any distances of any cloud: the score is a function of them alone.
    rng = np.random.default_rng(1)
    cloud = Cloud(Reference(tessellate(Box((2.0, 1.0, 1.0)))))
    distance = rng.normal(0.0, 0.05, 5120)
    _, slope = cloud.soft_score(distance, 0.02)
    direction = rng.normal(0.0, 1.0, 5120)
    there, back = (cloud.soft_score(distance + s * STEP * direction, 0.02)[0] for s in (1, -1))
    assert slope @ direction == pytest.approx((there - back) / (2 * STEP), rel=1e-5)


def test_the_hull_of_two_apart_holds_what_is_between() -> None:
    cube = tessellate(Box((1.0, 1.0, 1.0)))
    both = common_hull([cube, cube.placed(Pose((2.0, 0.0, 0.0)))])
    assert solid_moments(both)[0] == pytest.approx(3.0)
    assert common_hull([cube]) is cube
