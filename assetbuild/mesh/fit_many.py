"""Several primitives that stand for one mesh together: a fit per part, then all at once.

A link is rarely one box or capsule: its parts are. Each part of a decomposition gets the kind
that covers it best; then all primitives are moved, turned and sized together until their union
has the least of what sticks out and what is missing, and lies close to the surface. Smallest
enclosing primitives of each part would cover up to twice the volume.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from assetbuild.mesh.cover import Reference
from assetbuild.mesh.fit import AS_GOOD, enclosing_each, first_best, tidy
from assetbuild.mesh.primitives import Fitted, refined, resized, volume_of
from assetbuild.mesh.quality import sobol, surface_samples
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.pose import Array
from assetbuild.robot.shapes import Capsule, Primitive, Sphere, sizes_of

POINTS = 4096
"""Sobol points that the union is fitted to: a share is known to 0.008."""
MARGIN = 0.1
"""Room around the mesh in which sticking out is seen, as a share of its size."""
SOFTNESS = (0.02, 0.005)
"""Softness of the surfaces in each round of the refinement, as a share of the diagonal."""
MISSING_WEIGHT = 1.25
"""What is missing counts more than what sticks out: contact must not be lost."""
DISTANCE_WEIGHT = 15.0
"""Weight of the mean distance between the surfaces / the diagonal, beside shares of the volume."""
SAMPLES = 1024
"""Points of the surface that the mean distance is taken from."""
SHRUNK = (1.0, 0.95, 0.9, 0.85, 0.8)
"""Sizes / those of the enclosing body that are tried for a part on its own."""
STUBBY = 2.0
"""Length / radius of a capsule, its caps left out, up to which a sphere is tried in its place."""


class Cloud:
    """Points about a mesh (n, 3), which are inside, and how far each is from the surface, m.

    The last SAMPLES of `points` lie on the surface and have no part in the volumes. Seeded.
    """

    def __init__(self, reference: Reference) -> None:
        lower, upper = reference.mesh.bounds
        room = MARGIN * (upper - lower)
        cloud = sobol(POINTS, lower - room, upper + room)
        on_surface = surface_samples(reference.mesh, SAMPLES, 0)[0]
        self.points = np.concatenate([cloud, on_surface])
        self.inside = reference.solid.contains(cloud)
        self.depth = reference.surface.distance(cloud)
        self.size = reference.diagonal

    def score(self, fits: Sequence[Fitted]) -> float:
        """Score the union of some primitives; 0 is a perfect cover."""
        distance = np.min([ConvexPiece(*fitted).distance(self.points) for fitted in fits], axis=0)
        near = np.abs(distance[:POINTS]) < SOFTNESS[-1] * self.size
        occupied = (distance <= 0.0).astype(np.float64)
        return self._score(occupied, near.astype(np.float64), distance)

    def _score(self, occupied: Array, near: Array, distance: Array) -> float:
        """1 - IoU, with more weight on what is missing, and the mean distance of the surfaces.

        occupied: (n,) 0 to 1; near: (POINTS,) weights of the points on the union's surface.
        Not over + missing alone: that would rather have nothing than cover twice too much.
        """
        covered, wrong = self._shares(occupied)
        to_union = float(np.abs(distance[POINTS:]).mean())
        to_mesh = float(near @ self.depth) / max(float(near.sum()), 1e-12)
        gap = 0.5 * (to_union + to_mesh) / self.size
        return wrong / max(covered + wrong, 1e-12) + DISTANCE_WEIGHT * gap

    def _shares(self, occupied: Array) -> tuple[float, float]:
        """(covered, wrong) in numbers of points."""
        covered = float(occupied[:POINTS][self.inside].sum())
        over = float(occupied[:POINTS].sum()) - covered
        return covered, over + MISSING_WEIGHT * (int(self.inside.sum()) - covered)

    def soft_score(self, distance: Array, softness: float) -> tuple[float, Array]:
        """The score with surfaces as soft as `softness`, m, and its slope by each distance (n,)."""
        side = np.tanh(0.5 * distance / softness)
        occupied, near = 0.5 * (1.0 - side), 1.0 - side[:POINTS] ** 2
        covered, wrong = self._shares(occupied)
        by_wrong = np.where(self.inside, -MISSING_WEIGHT, 1.0)
        by_occupied = (covered * by_wrong - wrong * self.inside) / max(covered + wrong, 1e-12) ** 2
        weight = max(float(near.sum()), 1e-12)
        to_mesh = float(near @ self.depth) / weight
        by_near = 0.5 * DISTANCE_WEIGHT / self.size * (self.depth - to_mesh) / weight
        slope = np.empty(len(distance))
        slope[:POINTS] = -near * (0.25 * by_occupied + side[:POINTS] * by_near) / softness
        slope[POINTS:] = 0.5 * DISTANCE_WEIGHT / self.size / SAMPLES * np.sign(distance[POINTS:])
        return self._score(occupied, near, distance), slope


def fit_parts(
    reference: Reference,
    parts: Sequence[TriangleMesh],
    kinds: Sequence[type[Primitive]],
) -> tuple[list[Fitted], float]:
    """One primitive per convex part, refined together; and the score of their union."""
    cloud = Cloud(reference)
    fits = [_best_for(part, kinds) for part in parts]
    for softness in SOFTNESS:
        fits = _refined(fits, cloud, softness * cloud.size)
    if Sphere in kinds:
        fits = _with_balls(fits, cloud)
    fits = [tidy(fitted) for fitted in fits]
    return fits, cloud.score(fits)


def _with_balls(fits: list[Fitted], cloud: Cloud) -> list[Fitted]:
    """Short capsules become spheres where the union is as good: a foot touches in one point.

    A part by itself is often a little better as a capsule; together with its neighbour, which
    covers one end of it, the sphere is not worse.
    """
    for number, (primitive, pose) in enumerate(fits):
        if not isinstance(primitive, Capsule) or primitive.length > STUBBY * primitive.radius:
            continue
        radius = (volume_of(primitive) / (4.0 / 3.0 * math.pi)) ** (1.0 / 3.0)
        tried = [*fits[:number], (Sphere(radius), pose), *fits[number + 1 :]]
        tried = _refined(tried, cloud, SOFTNESS[-1] * cloud.size)
        if cloud.score(tried) <= cloud.score(fits) + AS_GOOD:
            fits = tried
    return fits


# --- a part on its own ----------------------------------------------------------------------


def _best_for(part: TriangleMesh, kinds: Sequence[type[Primitive]]) -> Fitted:
    """The enclosing primitive of each kind, shrunk to the part's volume; the best of all.

    Its axis is one of the candidates: all are turned together afterwards.
    """
    reference = Reference(part)
    cloud = Cloud(reference)
    fits = (
        (resized(type(primitive), factor * np.asarray(sizes_of(primitive))), pose)
        for primitive, pose in enclosing_each(reference, kinds, rough=True)
        for factor in SHRUNK
    )
    return first_best(fits, lambda fitted: cloud.score([fitted]))


# --- all together ---------------------------------------------------------------------------


def _refined(fits: list[Fitted], cloud: Cloud, softness: float) -> list[Fitted]:
    """The union that covers best, not far from `fits`.

    Occupancy is a sigmoid of the signed distance / softness, so that the score has a slope.
    """
    made = refined(
        fits, cloud.points, cloud.size, lambda away: cloud.soft_score(away, softness), 40
    )
    return made if cloud.score(made) <= cloud.score(fits) else fits
