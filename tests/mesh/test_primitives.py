"""Slopes of the distance to a primitive, against differences of the distance itself."""

from __future__ import annotations

import numpy as np
import pytest

from assetbuild.mesh.fit_many import Cloud
from assetbuild.mesh.primitives import distance_slopes, resized, signed_distance, sizes_of
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Primitive, Sphere

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


@pytest.mark.parametrize("primitive", KINDS, ids=lambda p: type(p).__name__)
def test_slopes_where_there_is_none_are_finite(primitive: Primitive):
    by_point, by_size = distance_slopes(primitive, np.zeros((1, 3)))
    assert np.isfinite(by_point).all()
    assert np.isfinite(by_size).all()


def test_the_score_of_a_union_slopes_as_it_changes():
    # Any distances of any cloud: the score is a function of them alone.
    rng = np.random.default_rng(1)
    inside = rng.random(4096) < 0.3
    cloud = Cloud(np.zeros((5120, 3)), inside, rng.random(4096), 2.0)
    distance = rng.normal(0.0, 0.05, 5120)
    _, slope = cloud.soft_score(distance, 0.02)
    direction = rng.normal(0.0, 1.0, 5120)
    there, back = (cloud.soft_score(distance + s * STEP * direction, 0.02)[0] for s in (1, -1))
    assert slope @ direction == pytest.approx((there - back) / (2 * STEP), rel=1e-5)
