"""Which points lie in a mesh, open or closed, and how well convex pieces cover it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assetbuild.mesh.hull import hull_planes
from assetbuild.mesh.primitives import Primitive, signed_distance, tessellate
from assetbuild.mesh.quality import NearestSurface, surface_samples
from assetbuild.mesh.triangles import TriangleMesh, face_normals
from assetbuild.robot.pose import IDENTITY, Array, Pose

RAYS = ((0.31, 0.67, 0.67), (-0.8, 0.36, 0.48), (0.1, -0.2, -0.97))
"""Directions of the parity test: skew, so that no ray runs along a wall."""
STEP = 1e-5
"""Of the diagonal, beyond a surface just struck, so that float32 does not strike it again."""
CROSSINGS = 64
"""Most surfaces that one ray is followed through."""


CHUNK = 512
"""Points tested against all planes at once: a table of 512 x 24,000 numbers is 100 MB."""


class Solid:
    """The inside of a mesh by ray parity: a point is inside when two of three rays say so.

    Exact for closed meshes up to the ray tracer's float32. For an open mesh it is a majority
    vote: good for small holes and gaps, meaningless for a sheet.
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh as EmbreeMesh

        lower, upper = mesh.bounds
        self._middle = (lower + upper) / 2.0
        self._size = max(mesh.diagonal, 1e-300)
        self._scene = rtcore_scene.EmbreeScene()
        local = (mesh.corners - self._middle) / self._size
        # Parts that touch share a wall, twice in one place, and a ray would see it once: each
        # face moves inwards by less than matters and more than a step.
        corners = (local - 2.0 * STEP * face_normals(mesh)[:, None]).astype(np.float32)
        self._keep = EmbreeMesh(self._scene, corners)

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """(n,) True for points (n, 3) inside."""
        votes = np.zeros(len(points), dtype=np.int64)
        for ray in RAYS:
            votes += self._crossings(points, np.asarray(ray) / np.linalg.norm(ray)) % 2
        return votes >= 2

    def _crossings(self, points: Array, direction: Array) -> NDArray[np.int64]:
        """(n,) surfaces that rays from the points cross; in units of the diagonal."""
        origins = ((points - self._middle) / self._size).astype(np.float32)
        found = np.zeros(len(points), dtype=np.int64)
        active = np.arange(len(points))
        for _ in range(CROSSINGS):
            if not len(active):
                break
            rays = np.repeat(direction[None].astype(np.float32), len(active), axis=0)
            hit = self._scene.run(origins[active], rays, output=True)
            struck = hit["primID"] != -1
            active = active[struck]
            found[active] += 1
            step = hit["tfar"][struck][:, None] + np.float32(STEP)
            origins[active] += step * rays[struck]
        return found


@dataclass(frozen=True, eq=False)
class ConvexPiece:
    """One convex piece: a hull mesh, or a primitive with its pose."""

    hull: TriangleMesh | None = None
    primitive: Primitive | None = None
    X_frame_piece: Pose = IDENTITY

    def distance(self, points: Array) -> Array:
        """(n,) signed: exact sign; outside a hull it is a lower bound of the distance. m."""
        if self.primitive is not None:
            return signed_distance(self.primitive, self.X_frame_piece.inverse().apply(points))
        if self.hull is None:
            raise ValueError("a piece is a hull or a primitive")
        planes = hull_planes(self.hull)
        chunks = [
            (points[k : k + CHUNK] @ planes[:, :3].T + planes[:, 3]).max(axis=1)
            for k in range(0, len(points), CHUNK)
        ]
        return np.concatenate([np.zeros(0), *chunks])

    def surface(self) -> TriangleMesh:
        """Its triangles in the common frame."""
        if self.primitive is not None:
            return tessellate(self.primitive).placed(self.X_frame_piece)
        if self.hull is None:
            raise ValueError("a piece is a hull or a primitive")
        return self.hull


def sobol(count: int, lower: Array, upper: Array, seed: int = 0) -> Array:
    """(count, 3) scrambled Sobol points in a box; count: a power of two."""
    from scipy.stats import qmc

    sampler = qmc.Sobol(3, scramble=True, rng=np.random.default_rng(seed))
    return np.asarray(lower + sampler.random(count) * (upper - lower), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Cover:
    """How pieces cover a mesh, by sampling.

    over, under: volume of pieces outside, of mesh not covered, / volume of the mesh;
    iou: common volume / joint volume; max_outside_m: how far pieces stick out of the surface.
    """

    iou: float
    over: float
    under: float
    max_outside_m: float


def measure_cover(
    mesh: TriangleMesh, pieces: Sequence[ConvexPiece], *, points: int = 4096, samples: int = 2000
) -> Cover:
    """Cover of `mesh` by the union of `pieces`; seeded, 1 sigma of the ratios about 0.01."""
    surfaces = [piece.surface() for piece in pieces]
    corners = np.concatenate([mesh.vertices, *(surface.vertices for surface in surfaces)])
    cloud = sobol(points, corners.min(axis=0), corners.max(axis=0))
    solid = Solid(mesh)
    inside = solid.contains(cloud)
    covered = np.zeros(points, dtype=bool)
    for piece in pieces:
        covered |= piece.distance(cloud) <= 0.0
    whole = max(int(inside.sum()), 1)
    per_piece = max(samples // max(len(pieces), 1), 50)
    skin = [surface_samples(surface, per_piece, seed)[0] for seed, surface in enumerate(surfaces)]
    outer = np.concatenate([*skin, *(s.vertices for s in surfaces)]) if surfaces else cloud[:0]
    outer = outer[~solid.contains(outer)] if len(outer) else outer
    gaps = NearestSurface(mesh).distance(outer)
    return Cover(
        iou=float((inside & covered).sum() / max(int((inside | covered).sum()), 1)),
        over=float((covered & ~inside).sum() / whole),
        under=float((inside & ~covered).sum() / whole),
        max_outside_m=float(gaps.max(initial=0.0)),
    )
