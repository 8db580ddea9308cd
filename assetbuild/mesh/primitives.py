"""Boxes, spheres, cylinders and capsules: distance, volume, triangles."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import astuple

import numpy as np

from assetbuild.mesh.hull import convex_hull
from assetbuild.mesh.triangles import TriangleMesh, unit_vectors
from assetbuild.robot.pose import Array, vec3
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Primitive, Sphere

BY_NAME: dict[str, type[Primitive]] = {
    kind.__name__: kind for kind in (Box, Sphere, Cylinder, Capsule)
}
SEGMENTS = 64
"""Corners of a tessellated circle: the polygon misses 0.12 % of the radius."""


def sizes_of(primitive: Primitive) -> tuple[float, ...]:
    """Edges of a box, else radius and length, m."""
    return primitive.size if isinstance(primitive, Box) else astuple(primitive)


def resized(kind: type[Primitive], sizes: Sequence[float] | Array) -> Primitive:
    """A primitive by its sizes, in the order of `sizes_of`."""
    numbers = [float(size) for size in sizes]
    return Box(vec3(numbers)) if issubclass(kind, Box) else kind(*numbers)


def signed_distance(primitive: Primitive, points: Array) -> Array:
    """(n,) exact distances of points (n, 3), in the primitive's own frame, m; negative inside."""
    if isinstance(primitive, Sphere):
        return np.asarray(np.linalg.norm(points, axis=1) - primitive.radius)
    if isinstance(primitive, Box):
        return _outside(np.abs(points) - np.asarray(primitive.size) / 2.0)
    height = np.abs(points[:, 2]) - primitive.length / 2.0
    radial = np.hypot(points[:, 0], points[:, 1])
    if isinstance(primitive, Capsule):
        return np.asarray(np.hypot(radial, np.maximum(height, 0.0)) - primitive.radius)
    return _outside(np.column_stack([radial - primitive.radius, height]))


def _outside(beyond: Array) -> Array:
    """Distance to an axis-aligned body from how far each coordinate is beyond its faces."""
    apart = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return np.asarray(apart + np.minimum(beyond.max(axis=1), 0.0))


def distance_slopes(primitive: Primitive, points: Array) -> tuple[Array, Array]:
    """How `signed_distance` changes with the points, (n, 3), and with the sizes, (n, k).

    Sizes: edges of a box, else radius and length. On an edge or an axis, where there is no slope,
    one of its neighbours'.
    """
    if isinstance(primitive, Sphere):
        return unit_vectors(points), np.full((len(points), 1), -1.0)
    if isinstance(primitive, Box):
        towards = _towards(np.abs(points) - np.asarray(primitive.size) / 2.0)
        return towards * np.sign(points), -0.5 * towards
    across, up = points[:, :2], points[:, 2:]
    height = np.abs(up) - primitive.length / 2.0
    if isinstance(primitive, Capsule):
        to_axis = np.hstack([across, np.sign(up) * np.maximum(height, 0.0)])
        slope = unit_vectors(to_axis)
        return slope, np.column_stack([np.full(len(points), -1.0), -0.5 * np.abs(slope[:, 2])])
    radial = np.linalg.norm(across, axis=1, keepdims=True)
    towards = _towards(np.hstack([radial - primitive.radius, height]))
    sideways, upwards = towards[:, :1] * unit_vectors(across), towards[:, 1:] * np.sign(up)
    return np.hstack([sideways, upwards]), towards * (-1.0, -0.5)


def _towards(beyond: Array) -> Array:
    """The slope of `_outside`, (n, k): outside to the nearest corner, inside to a face."""
    outside = unit_vectors(np.maximum(beyond, 0.0))
    face = np.eye(beyond.shape[1])[np.argmax(beyond, axis=1)]
    return np.where((beyond > 0.0).any(axis=1, keepdims=True), outside, face)


def volume_of(primitive: Primitive) -> float:
    """Volume, m3."""
    if isinstance(primitive, Box):
        return math.prod(primitive.size)
    ball = 4.0 / 3.0 * math.pi * primitive.radius**3
    if isinstance(primitive, Sphere):
        return ball
    tube = math.pi * primitive.radius**2 * primitive.length
    return tube + ball if isinstance(primitive, Capsule) else tube


@functools.lru_cache(maxsize=256)
def tessellate(primitive: Primitive) -> TriangleMesh:
    """A closed convex mesh, inscribed: its vertices lie on the primitive's surface."""
    if isinstance(primitive, Box):
        signs = np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        return convex_hull(signs * np.asarray(primitive.size))
    turn = 2.0 * math.pi * np.arange(SEGMENTS) / SEGMENTS
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    half = 0.0 if isinstance(primitive, Sphere) else primitive.length / 2.0
    if isinstance(primitive, Cylinder):
        rings = [(half, 1.0), (-half, 1.0)]
    else:
        up = math.pi / 2.0 * np.arange(SEGMENTS // 4 + 1) / (SEGMENTS // 4)
        cap = [(half + primitive.radius * math.sin(t), math.cos(t)) for t in up]
        rings = [*cap, *((-z, share) for z, share in cap)]
    points = [
        np.column_stack([circle * primitive.radius * share, np.full(SEGMENTS, z)])
        for z, share in rings
    ]
    # Rounding keeps the poles, 64 equal points but for noise of 1e-18, one vertex.
    return convex_hull(np.round(np.concatenate(points), 15))
