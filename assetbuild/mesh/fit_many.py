"""Several primitives that stand for one mesh together: a fit per part, then all at once.

A link is rarely one box or capsule: its parts are. Each part of a decomposition gets the kind
that covers it best; then all primitives are moved, turned and sized together until their union
has the least of what sticks out and what is missing. Smallest enclosing primitives of each part
would cover up to twice the volume.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assetbuild.mesh.cover import Reference
from assetbuild.mesh.fit import (
    AS_GOOD,
    ENCLOSING,
    SEARCHED,
    Fitted,
    candidate_axes,
    resized,
    sizes_of,
    tidy,
    turned_by,
)
from assetbuild.mesh.hull import convex_hull
from assetbuild.mesh.primitives import Primitive, signed_distance
from assetbuild.mesh.solid import sobol
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.model import Capsule, Cylinder
from assetbuild.robot.pose import Array, Pose, Vec3, vec3

POINTS = 4096
"""Sobol points that the union is fitted to: a share is known to 0.008."""
MARGIN = 0.1
"""Of the size: room about the mesh in which sticking out is seen."""
SOFTNESS = (0.02, 0.005)
"""Of the diagonal: how soft the surfaces are in each round of the refinement."""
MISSING_WEIGHT = 1.25
"""What is missing counts more than what sticks out: contact must not be lost."""
TURNS = 24
"""Directions tried per part beside those of its hull."""
BOUNDS = (0.15, 0.5, math.log(1.8))
"""How far the refinement may go: shift in diagonals, turn in rad, size by a factor of 1.8."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points about a mesh, and which of them are inside. size: the diagonal, m."""

    points: Array
    inside: NDArray[np.bool_]
    size: float

    @classmethod
    def of(cls, reference: Reference) -> Cloud:
        """Seeded; a mesh without an inside is its hull."""
        lower, upper = reference.mesh.bounds
        room = MARGIN * (upper - lower)
        points = sobol(POINTS, lower - room, upper + room)
        return cls(points, reference.solid.contains(points), reference.diagonal)

    def score(self, distance: Array) -> float:
        """1 - IoU of a union with these signed distances, but what is missing weighs more."""
        return self.weighed((distance <= 0.0).astype(np.float64))

    def weighed(self, occupied: Array) -> float:
        """The score of points occupied by 0 to 1; 1 when nothing of the mesh is covered.

        Not over + missing alone: that would rather have nothing than cover twice too much.
        """
        covered = float(occupied[self.inside].sum())
        over = float(occupied.sum()) - covered
        wrong = over + MISSING_WEIGHT * (int(self.inside.sum()) - covered)
        return wrong / max(covered + wrong, 1e-12)


def fit_parts(
    reference: Reference,
    parts: Sequence[TriangleMesh],
    kinds: Sequence[type[Primitive]],
    bones: Sequence[Vec3] = (),
) -> tuple[list[Fitted], float]:
    """One primitive per convex part, refined together; and the score of their union.

    bones: (x, y, z) from the frame's origin to the next joints, m: a leg's capsule follows them.
    """
    cloud = Cloud.of(reference)
    fits = [_best_for(part, kinds, bones) for part in parts]
    for softness in SOFTNESS:
        fits = _refined(fits, cloud, softness * cloud.size)
    fits = [tidy(fitted) for fitted in fits]
    return fits, cloud.score(_union(fits, cloud.points))


def _union(fits: Sequence[Fitted], points: Array) -> Array:
    nearest: Array = np.min([_distance(fitted, points) for fitted in fits], axis=0)
    return nearest


def _distance(fitted: Fitted, points: Array) -> Array:
    primitive, pose = fitted
    return signed_distance(primitive, pose.inverse().apply(points))


# --- a part on its own ----------------------------------------------------------------------


def _best_for(
    part: TriangleMesh, kinds: Sequence[type[Primitive]], bones: Sequence[Vec3]
) -> Fitted:
    """The enclosing primitive of each kind, shrunk to the part's volume; the best of all."""
    own = Reference(part)
    cloud = Cloud.of(own)
    search = convex_hull(part.vertices, max_vertices=SEARCHED)
    axes = np.concatenate([candidate_axes(part, search), _directions(bones)])
    best: tuple[float, Fitted] | None = None
    for kind in kinds:
        primitive, pose = ENCLOSING[kind](search.vertices, search.vertices, axes)
        for factor in (1.0, 0.95, 0.9, 0.85, 0.8):
            fitted = (resized(primitive, factor * np.asarray(sizes_of(primitive))), pose)
            value = cloud.score(_distance(fitted, cloud.points))
            if best is None or value < best[0] - AS_GOOD:
                best = (value, fitted)
    if best is None:
        raise ValueError("no kinds of primitives to choose from")
    return best[1]


def _directions(bones: Sequence[Vec3]) -> Array:
    along = np.asarray(bones, dtype=np.float64).reshape(-1, 3)
    length = np.linalg.norm(along, axis=1, keepdims=True)
    return np.asarray(along[length[:, 0] > 0.0] / length[length[:, 0] > 0.0])


# --- all together ---------------------------------------------------------------------------


def _refined(fits: list[Fitted], cloud: Cloud, softness: float) -> list[Fitted]:
    """The union that covers best, by L-BFGS-B within BOUNDS of `fits`.

    Occupancy is a sigmoid of the signed distance / softness, so that the score has a slope.
    Slopes are differences: a step of one primitive leaves the distances of the others alone.
    """
    from scipy.optimize import minimize

    ways = [_Way(fitted, cloud.size) for fitted in fits]
    ends = np.cumsum([0, *(way.count for way in ways)])

    def cost(distance: Array) -> float:
        return cloud.weighed(0.5 * (1.0 - np.tanh(0.5 * distance / softness)))

    def slope(x: Array) -> tuple[float, Array]:
        each = np.array(
            [
                way.distance(x[a:b], cloud.points)
                for way, a, b in zip(ways, ends, ends[1:], strict=False)
            ]
        )
        here = cost(each.min(axis=0))
        found = np.zeros(len(x))
        for number, way in enumerate(ways):
            others = np.delete(each, number, axis=0)
            rest = others.min(axis=0) if len(others) else np.full(len(cloud.points), np.inf)
            for k in range(way.count):
                moved = np.array(x[ends[number] : ends[number + 1]])
                moved[k] += STEP
                there = cost(np.minimum(rest, way.distance(moved, cloud.points)))
                found[ends[number] + k] = (there - here) / STEP
        return here, found

    bounds = [bound for way in ways for bound in way.bounds()]
    result = minimize(
        slope, np.zeros(ends[-1]), jac=True, method="L-BFGS-B", bounds=bounds,
        options={"maxiter": 40},
    )  # fmt: skip
    x = np.asarray(result.x, dtype=np.float64)
    made = [way.body(x[a:b]) for way, a, b in zip(ways, ends, ends[1:], strict=False)]
    before = cloud.score(_union(fits, cloud.points))
    return made if cloud.score(_union(made, cloud.points)) <= before else fits


STEP = 1e-4
"""Of a slope, in units of the variables: diagonals, radians, logarithms of sizes."""


class _Way:
    """How one primitive may change: shift / size, turn, logarithms of its sizes; 0 = as it is."""

    def __init__(self, fitted: Fitted, scale: float) -> None:
        self._primitive, self._pose = fitted
        self._scale = scale
        self._sizes = np.maximum(np.asarray(sizes_of(self._primitive)), 1e-3 * scale)
        self.count = 6 + len(self._sizes)

    def body(self, x: Array) -> Fitted:
        """The primitive at x (count,)."""
        shift = Pose(vec3(x[:3] * self._scale), turned_by(x[3:6]))
        return resized(self._primitive, self._sizes * np.exp(x[6:])), self._pose @ shift

    def distance(self, x: Array, points: Array) -> Array:
        """(n,) signed distances of points (n, 3)."""
        return _distance(self.body(x), points)

    def bounds(self) -> list[tuple[float, float]]:
        """Of each variable; a capsule may lose its length altogether."""
        shift, turn, size = BOUNDS
        longest = 2.0 * size if isinstance(self._primitive, Capsule | Cylinder) else size
        sizes = [(-size, size)] * (len(self._sizes) - 1) + [(-longest, size)]
        return [(-shift, shift)] * 3 + [(-turn, turn)] * 3 + sizes
