"""By how much a surface would have to move to lie on another one: registration by translation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from assetbuild.mesh.triangles import Indices
from assetbuild.robot.pose import Array

STEPS = 40
OVER = 1.5
"""Steps are this much longer than the mean way: points slide along walls, which shortens it."""
SETTLED_M = 2e-4


@dataclass(frozen=True)
class Move:
    """shift_m: (x, y, z); before_m, after_m: mean distance of the points from the surface."""

    shift_m: tuple[float, float, float]
    before_m: float
    after_m: float

    @property
    def length_m(self) -> float:
        """How far."""
        return float(np.linalg.norm(self.shift_m))


class Target:
    """A surface as samples (n, 3), m, that others are moved onto."""

    def __init__(self, samples: Array) -> None:
        from scipy.spatial import cKDTree

        self._samples = samples
        self._tree = cKDTree(samples, balanced_tree=False, compact_nodes=False)

    def fit(self, points: Array) -> Move:
        """Iterated closest points without turning (Besl and McKay, 1992). points: (k, 3) m.

        It finds the next place where the points fit, so a part that fits as well where it is, as a
        rod that slides along a rod, stays.
        """
        shift = np.zeros(3)
        apart, nearest = self._nearest(points)
        before = float(apart.mean())
        for _ in range(STEPS):
            step = OVER * (self._samples[nearest] - points - shift).mean(axis=0)
            shift = shift + step
            apart, nearest = self._nearest(points + shift)
            if float(np.linalg.norm(step)) < SETTLED_M:
                break
        x, y, z = (float(v) for v in shift)
        return Move((x, y, z), before, float(apart.mean()))

    def _nearest(self, points: Array) -> tuple[Array, Indices]:
        """(distances (k,) m, numbers (k,) of the nearest samples)."""
        apart, nearest = self._tree.query(points)
        return np.asarray(apart), np.asarray(nearest)
