"""Boxes, spheres, cylinders and capsules: distance, volume, triangles, small changes."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from assetbuild.mesh.hull import convex_hull
from assetbuild.mesh.triangles import TriangleMesh, unit_vectors
from assetbuild.robot.pose import Array, Pose, vec3
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Primitive, Sphere, sizes_of

BY_NAME: dict[str, type[Primitive]] = {
    kind.__name__: kind for kind in (Box, Sphere, Cylinder, Capsule)
}
Fitted = tuple[Primitive, Pose]
"""A primitive, and X_frame_primitive."""
SEGMENTS = 64
"""Corners of a tessellated circle: the polygon misses 0.12 % of the radius."""


def resized(kind: type[Primitive], sizes: Sequence[float] | Array) -> Primitive:
    """A primitive by its sizes, in the order of `sizes_of`."""
    numbers = [float(size) for size in sizes]
    return Box(vec3(numbers)) if issubclass(kind, Box) else kind(*numbers)


def signed_distance(primitive: Primitive, points: Array) -> Array:
    """(n,) exact distances of points (n, 3), in the primitive's own frame, m; negative inside."""
    if isinstance(primitive, Sphere):
        return np.asarray(np.linalg.norm(points, axis=1) - primitive.radius)
    if isinstance(primitive, Box):
        return from_faces(np.abs(points) - np.asarray(primitive.size) / 2.0)
    height = np.abs(points[:, 2]) - primitive.length / 2.0
    radial = np.hypot(points[:, 0], points[:, 1])
    if isinstance(primitive, Capsule):
        return np.asarray(np.hypot(radial, np.maximum(height, 0.0)) - primitive.radius)
    return from_faces(np.column_stack([radial - primitive.radius, height]))


def from_faces(beyond: Array) -> Array:
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
    """The slope of `from_faces`, (n, k): outside to the nearest corner, inside to a face."""
    outside = unit_vectors(np.maximum(beyond, 0.0))
    face = np.eye(beyond.shape[1])[np.argmax(beyond, axis=1)]
    return np.where((beyond > 0.0).any(axis=1, keepdims=True), outside, face)


def half_height(primitive: Primitive, up: Array) -> float:
    """How far a primitive reaches from its centre towards `up`, m: its support function.

    up: (3,) unit vector in the frame of the primitive.
    """
    if isinstance(primitive, Sphere):
        return primitive.radius
    if isinstance(primitive, Box):
        return float(np.abs(up) @ np.asarray(primitive.size)) / 2
    along = abs(float(up[2])) * primitive.length / 2
    if isinstance(primitive, Capsule):
        return along + primitive.radius
    return along + primitive.radius * float(np.hypot(up[0], up[1]))


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


# --- one that changes ---

BOUNDS = (0.15, 0.5, math.log(1.8))
"""How far it may change: shift in diagonals, turn in rad, size by a factor of 1.8."""
TURN = 1e-6
"""rad; of the slope of a rotation."""


class Movable:
    """How one primitive may change: shift / scale, turn, logarithms of its sizes; 0 = as it is.

    points: (n, 3) whose distances from it are asked for, m; scale: m, of what it stands for.
    """

    def __init__(self, fitted: Fitted, points: Array, scale: float) -> None:
        self._primitive, self._pose = fitted
        self._scale = scale
        self._points = self._pose.inverse().apply(points)
        self._sizes = np.maximum(np.asarray(sizes_of(self._primitive)), 1e-3 * scale)
        self.count = 6 + len(self._sizes)

    def body(self, x: Array) -> Fitted:
        """The primitive at x (count,)."""
        primitive, shift = self._changed(x)
        return primitive, self._pose @ shift

    def _changed(self, x: Array) -> Fitted:
        shift = Pose(vec3(x[:3] * self._scale), _turned_by(x[3:6]))
        return resized(type(self._primitive), self._sizes * np.exp(x[6:])), shift

    def distance(self, x: Array) -> Array:
        """(n,) signed distances of the points."""
        primitive, shift = self._changed(x)
        return signed_distance(primitive, shift.inverse().apply(self._points))

    def slope(self, x: Array, which: NDArray[np.bool_]) -> Array:
        """(m, count) slopes of the distances of some of the points."""
        primitive, shift = self._changed(x)
        rotation, from_middle = shift.rotation, self._points[which] - np.asarray(shift.xyz)
        by_point, by_size = distance_slopes(primitive, from_middle @ rotation)
        turns = [
            (_turned_rotation(x[3:6] + step) - _turned_rotation(x[3:6] - step)) / (2.0 * TURN)
            for step in TURN * np.eye(3)
        ]
        by_turn = [np.einsum("ij,ij->i", by_point, from_middle @ turn) for turn in turns]
        sizes = by_size * np.asarray(sizes_of(primitive))
        return np.column_stack([-self._scale * by_point @ rotation.T, *by_turn, sizes])

    def bounds(self) -> list[tuple[float, float]]:
        """Return least and most of each variable; a capsule may lose its whole length."""
        shift, turn, size = BOUNDS
        longest = 2.0 * size if isinstance(self._primitive, Capsule | Cylinder) else size
        sizes = [(-size, size)] * (len(self._sizes) - 1) + [(-longest, size)]
        return [(-shift, shift)] * 3 + [(-turn, turn)] * 3 + sizes


def refined(
    fits: Sequence[Fitted],
    points: Array,
    scale: float,
    cost: Callable[[Array], tuple[float, Array]],
    steps: int,
    unit: float = 1.0,
) -> list[Fitted]:
    """The primitives whose union costs least, by L-BFGS-B within BOUNDS; `fits` if none is better.

    points, scale: as in `Movable`; cost: of the signed distances (n,) of the union, m, and its
    slope by each, counted in this unit. A point's distance, and so its slope, is that of the
    nearest primitive.
    """
    from scipy.optimize import minimize

    ways = [Movable(fitted, points, scale) for fitted in fits]
    ends = np.cumsum([way.count for way in ways])[:-1]

    def total(x: Array) -> tuple[float, Array]:
        moves = [*zip(ways, np.split(x, ends), strict=True)]
        each = np.array([way.distance(move) for way, move in moves])
        nearest = np.argmin(each, axis=0)
        here, by_distance = cost(each.min(axis=0))
        slopes = [
            by_distance[nearest == number] @ way.slope(move, nearest == number)
            for number, (way, move) in enumerate(moves)
        ]
        return here / unit, np.concatenate(slopes) / unit

    start = np.zeros(sum(way.count for way in ways))
    bounds = [bound for way in ways for bound in way.bounds()]
    result = minimize(
        total, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": steps}
    )
    if not float(result.fun) < total(start)[0]:
        return list(fits)
    x = np.asarray(result.x, dtype=np.float64)
    return [way.body(move) for way, move in zip(ways, np.split(x, ends), strict=True)]


def _turned_rotation(vector: Array) -> Array:
    """(3, 3) rotation by a rotation vector, rad."""
    return Pose(quat=_turned_by(vector)).rotation


def _turned_by(vector: Array) -> tuple[float, float, float, float]:
    """Quaternion of a rotation vector, rad."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return (1.0, 0.0, 0.0, 0.0)
    x, y, z = vec3(np.sin(angle / 2.0) * vector / angle)
    return (math.cos(angle / 2.0), x, y, z)
