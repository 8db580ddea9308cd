"""How well convex pieces stand for a mesh: volumes, distances, what they close, what they cost.

The union of the pieces is always a solid, so it is computed exactly. The mesh may be anything:
where it is a solid too, shared volumes are exact; else its inside is sampled by ray parity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from assetbuild.mesh.hull import convex_hull, manifold3d, polygon_count
from assetbuild.mesh.quality import Distance, NearestSurface, sobol, surface_samples
from assetbuild.mesh.solid import ConvexPiece, Solid
from assetbuild.mesh.triangles import TriangleMesh, signed_volume
from assetbuild.robot.pose import Array

Manifold = Any  # manifold3d.Manifold: its extension module has no types

POINTS = 2**14
"""Sobol points of the sampled volumes: 1 sigma of a ratio is about 0.004."""
SAMPLES, COARSE = 4000, 800
"""Surface samples on each side, and of the pieces alone while their number is searched."""
FILLING = 2**12
"""Samples of the volume that tell a search what is inside."""
ROOM = 0.03
"""Share of its extents by which the box of sampled volumes is wider than a mesh."""
LEAST_INSIDE = 32
"""With fewer of POINTS inside, their share says nothing."""
ENOUGH_INSIDE = 300
"""Points of FILLING inside a mesh from which on a search estimates the shared volume by them: a
share of 0.05 to within 0.013. The exact volume takes half of the time of a candidate."""
FIRST_LOOK = 128
"""Points that are looked at first for the one that lies farthest outside; then twice as many."""
CLOSE = 1e-4
"""A surface sample nearer to the mesh than this share of the diagonal lies on it."""


@dataclass(frozen=True, slots=True)
class Quality:
    """How pieces cover a mesh. Volumes are shares of the mesh's volume.

    exact: the volumes are; else they are sampled. closed: the mesh has no open edge.
    iou: common / joint volume; over: pieces outside the mesh; missing: mesh outside the pieces.
    max_outside_m: how far the pieces stick out; mean_m, p99_m, max_m: two-sided distance between
    the surfaces. flat: pieces without volume, left out. vertices, polygons: of the largest piece,
    coplanar triangles merged.
    """

    exact: bool
    closed: bool
    iou: float
    over: float
    missing: float
    max_outside_m: float
    pieces: int
    mean_m: float = 0.0
    p99_m: float = 0.0
    max_m: float = 0.0
    vertices: int = 0
    polygons: int = 0
    flat: int = 0


class Reference:
    """A mesh that pieces are compared with; what does not depend on the pieces is kept."""

    def __init__(self, mesh: TriangleMesh) -> None:
        self.mesh = mesh
        self.diagonal = mesh.diagonal
        self.hull = convex_hull(mesh.vertices)
        self._clouds: dict[bytes, NDArray[np.bool_]] = {}

    @cached_property
    def solid(self) -> Solid:
        """Which points are inside. The hull stands for a sheet: an open mesh without an inside."""
        drawn = Solid(self.mesh)
        if not self.mesh.is_closed:
            inside = drawn.contains(sobol(POINTS, *self.room))
            if int(inside.sum()) < LEAST_INSIDE:
                return Solid(self.hull)
            self._clouds[_key(*self.room)] = inside
        return drawn

    @property
    def hollow(self) -> bool:
        """Whether the hull stands for the mesh."""
        return self.solid.mesh is self.hull

    @cached_property
    def room(self) -> tuple[Array, Array]:
        """A box around the mesh in which its pieces have room: capped ones stick out a little."""
        lower, upper = self.mesh.bounds
        return lower - ROOM * (upper - lower), upper + ROOM * (upper - lower)

    @cached_property
    def filling(self) -> tuple[Array, float]:
        """(points (n, 3) evenly inside the mesh, the volume that each stands for in m3)."""
        lower, upper = self.room
        cloud, solid = sobol(POINTS, lower, upper)[:FILLING], self.solid
        known = self._clouds.get(_key(lower, upper))
        inside = solid.contains(cloud) if known is None else known[:FILLING]
        return cloud[inside], float(np.prod(upper - lower)) / FILLING

    @cached_property
    def inside(self) -> tuple[Array, float]:
        """(points (n, 3) evenly inside the mesh, the volume that they fill in m3)."""
        lower, upper = self.room
        cloud, inside = self._shares(lower, upper)
        return cloud[inside], float(np.prod(upper - lower) * inside.mean())

    @cached_property
    def exact(self) -> Manifold | None:
        """The mesh as a solid of manifold3d; None when it is not one."""
        mesh, library = self.solid.mesh, manifold3d()
        if not mesh.is_closed or signed_volume(mesh) <= 0.0:
            return None
        triangles = np.ascontiguousarray(mesh.faces, dtype=np.uint64)
        made = library.Manifold(library.Mesh64(_float64(mesh.vertices), triangles))
        is_solid = made.status() == library.Error.NoError and made.volume() > 0.0
        return made if is_solid else None

    @cached_property
    def volume(self) -> float:
        """m3; sampled unless the mesh is a solid."""
        if self.exact is not None:
            return float(self.exact.volume())
        return self.inside[1]

    @cached_property
    def convexity(self) -> float:
        """Volume / volume of the hull: 1 for a convex mesh."""
        return self.volume / signed_volume(self.hull)

    @cached_property
    def samples(self) -> Array:
        """(SAMPLES, 3) points on the surface."""
        return surface_samples(self.mesh, SAMPLES, 0)[0]

    @cached_property
    def surface(self) -> NearestSurface:
        """Distances to the mesh."""
        return NearestSurface(self.mesh)

    def _shares(self, lower: Array, upper: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Sobol points in a box, and which of them are inside; kept for equal boxes."""
        cloud, solid, key = sobol(POINTS, lower, upper), self.solid, _key(lower, upper)
        if key not in self._clouds:
            self._clouds[key] = solid.contains(cloud)
        return cloud, self._clouds[key]

    def volumes(
        self, pieces: Sequence[ConvexPiece], union: Manifold, skin: TriangleMesh, *, coarse: bool
    ) -> tuple[float, float, float]:
        """(iou, over, missing) of pieces, by their union and its surface."""
        lower, upper = skin.bounds
        if self.exact is not None:
            mine, other = self.volume, float(union.volume())
            if coarse and len(self.filling[0]) >= ENOUGH_INSIDE:
                common = mine * float(_covered(pieces, self.filling[0]).mean())
            else:
                common = float((self.exact ^ union).volume())
        else:
            low, high = self.room
            cloud, inside = self._shares(np.minimum(low, lower), np.maximum(high, upper))
            covered = _covered(pieces, cloud)
            mine, other, common = (float(n.sum()) for n in (inside, covered, inside & covered))
        return (
            common / (mine + other - common or 1.0),
            max(other - common, 0.0) / (mine or 1.0),
            max(mine - common, 0.0) / (mine or 1.0),
        )


def union_of(pieces: Sequence[ConvexPiece]) -> tuple[Manifold, TriangleMesh]:
    """The union of the pieces as a solid, and its surface: no inner walls."""
    library = manifold3d()
    solids = [library.Manifold.hull_points(_float64(p.surface().vertices)) for p in pieces]
    union = library.Manifold.batch_boolean(solids, library.OpType.Add)
    mesh = union.to_mesh64()
    vertices = np.array(mesh.vert_properties, dtype=np.float64)[:, :3]  # manifold's are read-only
    return union, TriangleMesh(vertices, np.asarray(mesh.tri_verts, dtype=np.int64))


def rough(
    reference: Reference,
    pieces: Sequence[ConvexPiece],
    joined: tuple[Manifold, TriangleMesh] | None = None,
    *,
    coarse: bool = False,
    most_over: float = np.inf,
) -> Quality:
    """The figures that tolerances speak of: volumes and how far pieces stick out; others are 0.

    joined: their `union_of`. coarse: for a search, by fewer samples; else the figures are those of
    `measure`. most_over: pieces of so much more volume than the mesh are not looked at further.
    """
    union, skin = joined or union_of(pieces)
    exact, closed = reference.exact is not None, reference.mesh.is_closed
    over = (float(union.volume()) - reference.volume) / (reference.volume or 1.0)
    if over > most_over:
        return Quality(exact, closed, 0.0, over, 0.0, 0.0, len(pieces))
    volumes = reference.volumes(pieces, union, skin, coarse=coarse)
    on_skin = surface_samples(skin, COARSE if coarse else SAMPLES, 1)[0]
    farthest = outside(reference, np.concatenate([on_skin, skin.vertices]))
    return Quality(exact, closed, *volumes, farthest, len(pieces))


def measure(
    reference: Reference,
    pieces: Sequence[ConvexPiece],
    *,
    flat: int = 0,
    known: Quality | None = None,
) -> Quality:
    """All figures of `pieces` (at least one, each with a volume) against the mesh; seeded.

    known: what `rough` has found of them already.
    """
    union, skin = union_of(pieces)
    base = known or rough(reference, pieces, (union, skin))
    to_mesh = reference.surface.distance(surface_samples(skin, SAMPLES, 1)[0])
    to_skin = NearestSurface(skin).distance(reference.samples)
    hulls = [piece.solid for piece in pieces if isinstance(piece.solid, TriangleMesh)]
    return replace(
        base,
        **asdict(Distance.of(to_mesh, to_skin)),
        vertices=max((len(h.vertices) for h in hulls), default=0),
        polygons=max((polygon_count(h) for h in hulls), default=0),
        flat=flat,
    )


def _covered(pieces: Sequence[ConvexPiece], points: Array) -> NDArray[np.bool_]:
    """(n,) which of points (n, 3) lie in one of the pieces."""
    covered = np.zeros(len(points), dtype=bool)
    for piece in pieces:
        lower, upper = piece.surface().bounds
        near = np.flatnonzero(~covered & ((points >= lower) & (points <= upper)).all(axis=1))
        covered[near] = piece.distance(points[near]) <= 0.0
    return covered


def outside(reference: Reference, points: Array) -> float:
    """How far the farthest of points (n, 3) lies outside the mesh, m; 0 when none does.

    Those that may lie farthest are looked at first, and the others not at all once none of them
    can lie farther.
    """
    most = reference.surface.at_most(points)
    order = np.argsort(-most, kind="stable")
    farthest, least = 0.0, CLOSE * reference.diagonal
    start, count = 0, FIRST_LOOK
    while start < len(order) and most[order[start]] > max(farthest, least):
        some = points[order[start : start + count]]
        away = some[~reference.solid.contains(some)]
        farthest = float(reference.surface.distance(away).max(initial=farthest))
        start, count = start + count, 2 * count
    return farthest if farthest > least else 0.0


def _key(lower: Array, upper: Array) -> bytes:
    return lower.tobytes() + upper.tobytes()


def _float64(points: Array) -> Array:
    return np.ascontiguousarray(points, dtype=np.float64)
