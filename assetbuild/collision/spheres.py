"""A set of spheres: the simplest contact there is, and what planners on a GPU take."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from assetbuild.collision import CollisionMethod, Fitted
from assetbuild.mesh.cover import Reference
from assetbuild.mesh.quality import sobol
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.recipe_types import Share
from assetbuild.robot.pose import Pose, vec3
from assetbuild.robot.shapes import Sphere

POINTS = 2**13
CENTRES = 400
"""Centres tried: seeded points inside the mesh."""
GROWTH = (0.0, 0.5, 1.0)
"""Radii tried: to the surface, and beyond it by these shares of `margin`."""
LEAST = 1e-3
"""A sphere that adds less than this share of the mesh's volume is left out."""


class Spheres(CollisionMethod):
    """Spheres of each source shape, chosen one by one: the one that covers most comes next.

    Greedy covering is within 1 - 1/e of the best choice (Nemhauser et al., 1978).
    """

    keeps = (Sphere,)

    max_hulls: int = Field(16, ge=1, le=1024, description="most spheres")
    margin: Share = Field(
        0.02,
        le=0.5,
        description="how far a sphere may stick out, share of the mesh's size; `max_outside` "
        "bounds it, too",
    )

    def fit(self, reference: Reference) -> Fitted:
        """Inner spheres, grown a little; volume outside counts against them."""
        beyond = self.margin * reference.diagonal
        if self.max_outside is not None:
            beyond = min(beyond, self.max_outside)
        return Fitted(covering_spheres(reference, self.max_hulls, beyond), how="spheres")


def covering_spheres(reference: Reference, most: int, beyond: float) -> tuple[ConvexPiece, ...]:
    """Cover a mesh with at most so many spheres, in its frame, rounded to a micrometre.

    beyond: how far one may stick out, m; volume outside of the mesh counts against it.
    """
    from scipy.spatial.distance import cdist

    cloud = sobol(POINTS, *reference.mesh.bounds)
    inside = reference.solid.contains(cloud)
    centres = cloud[inside][:CENTRES] if inside.any() else cloud[:CENTRES]
    deep = reference.surface.distance(centres)
    radii = np.concatenate([deep + share * beyond for share in GROWTH])
    middles = np.tile(centres, (len(GROWTH), 1))
    apart = cdist(centres, cloud)
    holds = np.concatenate([apart <= (deep + share * beyond)[:, None] for share in GROWTH])
    worth = holds.astype(np.float32)  # sums of whole numbers below 2^24: exact, and quick
    value = np.where(inside, 1.0, -1.0).astype(np.float32)
    left = np.ones(len(cloud), dtype=bool)
    chosen: list[int] = []
    while len(chosen) < most:
        gains = worth @ (value * left)
        best = int(np.argmax(gains))
        if gains[best] <= LEAST * max(int(inside.sum()), 1):
            break
        chosen.append(best)
        left &= ~holds[best]
    return tuple(
        ConvexPiece(Sphere(round(float(radii[k]), 6)), Pose(vec3(np.round(middles[k], 6))))
        for k in chosen or [int(np.argmax(radii))]
    )
