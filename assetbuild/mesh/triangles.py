"""The triangle mesh that all geometry code speaks: polygons, area and volume, equal vertices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from assetbuild.robot.pose import Array, Pose, Vec3, cross

Indices = NDArray[np.int64]
MIXING = np.uint64(0x9E3779B97F4A7C15)
"""Odd, with half of its bits set: a product spreads each bit of a number over the higher ones."""


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles over shared vertices; counter-clockwise seen from outside.

    What is computed from them is computed once, so nobody may change the arrays.

    vertices: (n, 3) m; faces: (m, 3) indices into them.
    uv: (m, 3, 2) and normals: (m, 3, 3) per corner of each face, so that a seam in either
    does not split the surface. None = the source states none, or nothing needs them.
    """

    vertices: Array
    faces: Indices
    uv: Array | None = None
    normals: Array | None = None

    @cached_property
    def is_used(self) -> NDArray[np.bool_]:
        """(n,) which vertices faces use."""
        is_used = np.zeros(len(self.vertices), dtype=bool)
        is_used[self.faces] = True
        return is_used

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """(lower, upper) corners, (3,) m each, of the vertices that faces use."""
        used = self.vertices[self.is_used]
        return used.min(axis=0), used.max(axis=0)

    @property
    def diagonal(self) -> float:
        """Length of the bounding box's diagonal, m: the scale of the mesh."""
        lower, upper = self.bounds
        return float(np.linalg.norm(upper - lower))

    @cached_property
    def corners(self) -> Array:
        """(m, 3, 3) positions of the corners of each face, m."""
        return self.vertices[self.faces]

    @cached_property
    def areas(self) -> Array:
        """(m,) areas of the faces, m2."""
        return np.asarray(np.linalg.norm(spanned(self.corners), axis=1) / 2.0, dtype=np.float64)

    @cached_property
    def is_closed(self) -> bool:
        """True when every edge is used exactly twice, once in each direction.

        Vertices must be welded. Stricter than "watertight" elsewhere: faces also agree on outside.
        """
        if not len(self.faces):
            return False
        start = self.faces.ravel()
        end = self.faces[:, [1, 2, 0]].ravel()
        # An edge and its opposite cancel, so most open meshes are known without a sort.
        if (start * end * (start - end)).sum() != 0:
            return False
        n = len(self.vertices)
        there = np.sort(start * n + end)
        back = np.sort(end * n + start)
        return bool(np.array_equal(there, back) and (there[1:] != there[:-1]).all())

    def select(self, faces: NDArray[np.bool_] | Indices) -> TriangleMesh:
        """The mesh of some faces, by mask (m,) or index (k,); vertices stay as they are."""
        return TriangleMesh(
            self.vertices,
            self.faces[faces],
            None if self.uv is None else self.uv[faces],
            None if self.normals is None else self.normals[faces],
        )

    def flipped(self) -> TriangleMesh:
        """The same surface seen from the other side: winding and normals reversed."""
        return TriangleMesh(
            self.vertices,
            np.ascontiguousarray(self.faces[:, ::-1]),
            None if self.uv is None else self.uv[:, ::-1],
            None if self.normals is None else -self.normals[:, ::-1],
        )

    def mapped(self, matrix: ArrayLike, offset: ArrayLike = (0.0, 0.0, 0.0)) -> TriangleMesh:
        """The mesh under p -> A p + b; a mirroring A also reverses the winding.

        matrix: (3, 3), any regular matrix; offset: (3,) m. Normals follow the inverse transpose,
        so outward stays outward. Raises ValueError for a singular matrix.
        """
        a = np.asarray(matrix, dtype=np.float64)
        b = np.asarray(offset, dtype=np.float64)
        sign = float(np.sign(np.linalg.det(a)))
        if sign == 0.0 or not np.isfinite(a).all():
            raise ValueError("a mesh cannot be scaled to zero")
        if np.array_equal(a, np.eye(3)) and not b.any():
            return self
        # A diagonal matrix multiplies each axis alone: no rounding from sums with zeros.
        diagonal = np.diagonal(a)
        straight = np.array_equal(a, np.diag(diagonal))
        moved = (self.vertices * diagonal if straight else self.vertices @ a.T) + b
        normals = self.normals
        if normals is not None:
            # Times the sign: those of a mirrored surface are outward, and `flipped` turns them.
            normals = sign * unit_vectors(normals @ np.linalg.inv(a))
        out = replace(self, vertices=moved, normals=normals)
        return out if sign > 0.0 else out.flipped()

    def placed(self, pose: Pose) -> TriangleMesh:
        """The mesh given in the child frame of `pose`, in its parent frame."""
        return self.mapped(pose.rotation, pose.xyz) if pose != Pose() else self

    def scaled(self, scale: Vec3) -> TriangleMesh:
        """The mesh scaled per axis; a mirrored one keeps outward normals."""
        return self.mapped(np.diag(scale))


def merged(meshes: Sequence[TriangleMesh], *, surface: bool = False) -> TriangleMesh:
    """All faces in one mesh, in order; vertices are not welded.

    surface: texture coordinates and normals survive when any mesh has them; else they are left out.
    """
    if len(meshes) == 1 and (surface or (meshes[0].uv is None and meshes[0].normals is None)):
        return meshes[0]
    if not meshes:
        return TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    faces = np.concatenate([mesh.faces + k for mesh, k in zip(meshes, offsets, strict=False)])
    uv = normals = None
    if surface and any(mesh.uv is not None for mesh in meshes):
        uv = np.concatenate(
            [np.zeros((len(m.faces), 3, 2)) if m.uv is None else m.uv for m in meshes]
        )
    if surface and any(mesh.normals is not None for mesh in meshes):
        normals = np.concatenate(
            [corner_normals(mesh) if mesh.normals is None else mesh.normals for mesh in meshes]
        )
    return TriangleMesh(vertices, faces, uv, normals)


def spanned(triangles: Array) -> Array:
    """(k, 3) m2: normals of triangles (k, 3, 3), twice as long as their area."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    return cross(b - a, c - a)


def unit_vectors(vectors: Array) -> Array:
    """Vectors (..., 3) divided by their length; zero vectors stay zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0), dtype=np.float64)


def face_normals(mesh: TriangleMesh) -> Array:
    """(m, 3) unit normals of the faces; zero for degenerate ones."""
    return unit_vectors(spanned(mesh.corners))


def corner_normals(mesh: TriangleMesh) -> Array:
    """(m, 3, 3) face normals at every corner: how a part without normals is drawn."""
    return np.repeat(face_normals(mesh)[:, None, :], 3, axis=1)


TURNED = 1e-9
"""Share of the polygon's own area from which a triangle that faces the other way counts."""
SKEW = 1e-6
"""A quad is planar if six times the volume of its corners is below this share of its diagonal
cubed."""


def fan_triangles(counts: Indices) -> Indices:
    """(k, 3) corner numbers that cut polygons of `counts` corners each into fans.

    Corners are numbered through all polygons. Right for convex polygons only; polygons of fewer
    than three corners give none.
    """
    starts = np.cumsum(counts) - counts
    fans = np.maximum(counts - 2, 0)
    first = np.repeat(starts, fans)
    step = np.arange(int(fans.sum())) - np.repeat(np.cumsum(fans) - fans, fans)
    return np.stack([first, first + step + 1, first + step + 2], axis=1).astype(np.int64)


def polygon_triangles(counts: Indices, corners: Array) -> Indices:
    """(k, 3) corner numbers as `fan_triangles`, right for polygons that are not convex too.

    A fan of such a polygon covers what lies outside of it: a shin was 19 % too large.
    counts: corners of each polygon; corners: (n, 3) m, their positions, polygon by polygon.
    """
    fans = fan_triangles(counts)
    owner = np.repeat(np.arange(len(counts)), np.maximum(counts - 2, 0))
    with np.errstate(all="ignore"):  # whoever reads the file refuses what is not finite
        across = spanned(corners[fans])
        normal = np.stack([np.bincount(owner, a, len(counts)) for a in across.T], axis=1)
        size = np.einsum("ij,ij->i", normal, normal)
        is_turned = np.einsum("ij,ij->i", across, normal[owner]) < -TURNED * size[owner]
    hollow = np.unique(owner[is_turned])
    if not len(hollow):
        return fans
    is_kept = ~np.isin(owner, hollow)
    starts = np.cumsum(counts) - counts
    cut = [_ears(int(starts[i]), corners[starts[i] : starts[i] + counts[i]]) for i in hollow]
    owners = np.concatenate([owner[is_kept], np.repeat(hollow, [len(ears) for ears in cut])])
    triangles = np.concatenate([fans[is_kept], *cut])
    return triangles[np.argsort(owners, kind="stable")]


def with_short_diagonals(triangles: Indices, counts: Indices, corners: Array) -> Indices:
    """Triangles in which each quad that is not planar is cut along its shorter diagonal.

    MuJoCo cuts the quads of an OBJ file like this (tinyobjloader); the volume depends on it.
    triangles: (k, 3), those of `polygon_triangles` for the same counts and corners.
    """
    fans = np.maximum(counts - 2, 0)
    starts, rows = ((np.cumsum(n) - n)[counts == 4] for n in (counts, fans))
    p0, p1, p2, p3 = (corners[starts + i] for i in range(4))
    spanned = np.abs(np.einsum("ij,ij->i", np.cross(p1 - p0, p2 - p0), p3 - p0))
    fan_cut, other = (np.einsum("ij,ij->i", d, d) for d in (p2 - p0, p3 - p1))
    is_fan = (triangles[rows] == np.stack([starts, starts + 1, starts + 2], axis=1)).all(axis=1)
    is_cut = is_fan & (other < fan_cut) & (spanned > SKEW * fan_cut**1.5)
    at, rows, turned = starts[is_cut], rows[is_cut], triangles.copy()
    turned[rows] = np.stack([at, at + 1, at + 3], axis=1)
    turned[rows + 1] = np.stack([at + 1, at + 2, at + 3], axis=1)
    return turned


def _ears(start: int, corners: Array) -> Indices:
    """(n - 2, 3) corner numbers from `start` on; the fan where ear clipping does not cover less.

    It is done in the plane that suits the polygon best, so that one whose corners lie in no plane,
    or whose edges cross, gets the triangles that cover the least.
    """
    import manifold3d

    fan = fan_triangles(np.array([len(corners)]))
    normal = spanned(corners[fan]).sum(axis=0)
    side = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    up = np.cross(normal, side)
    plane = np.stack([side / np.linalg.norm(side), up / np.linalg.norm(up)], axis=1)
    ears = np.asarray(manifold3d.triangulate([(corners - corners[0]) @ plane]), dtype=np.int64)
    whole, clipped = (np.linalg.norm(spanned(corners[t]), axis=1).sum() for t in (fan, ears))
    return start + (ears if len(ears) == len(fan) and clipped < whole else fan)


def area(mesh: TriangleMesh) -> float:
    """Area of the surface, m2."""
    return float(mesh.areas.sum())


def signed_volume(mesh: TriangleMesh) -> float:
    """Enclosed volume, m3, by the divergence theorem; negative when the mesh is inside out.

    Of an open mesh it depends on where the hole is: ask `is_closed` first.
    """
    return float(_cone_volumes(mesh)[0].sum())


def solid_moments(mesh: TriangleMesh) -> tuple[float, Array, Array]:
    """Volume m3, centroid (3,) m, and inertia (3, 3) m5 about it, of a closed mesh of density 1.

    Exact: each face and a point span a tetrahedron, whose second moments are polynomials of its
    corners (Tonon, "Explicit exact formulas for the 3-D tetrahedron inertia tensor", 2004). A
    mesh that is inside out gives the same as when it is turned.
    """
    cones, about = _cone_volumes(mesh)
    volume = float(cones.sum())
    corners = mesh.corners - about
    total = corners.sum(axis=1)
    first = cones @ total / 4.0
    second = (
        np.einsum("n,ni,nj->ij", cones, total, total)
        + np.einsum("n,nci,ncj->ij", cones, corners, corners)
    ) / 20.0
    middle = first / volume
    second = second - volume * np.outer(middle, middle)
    inertia = np.trace(second) * np.eye(3) - second
    return abs(volume), about + middle, np.sign(volume) * inertia


def _cone_volumes(mesh: TriangleMesh) -> tuple[Array, Array]:
    """Signed volumes (m,) of the cones from a point to each face, and that point.

    The point is the middle of the bounds: a mesh far from its origin loses no digits.
    """
    if not len(mesh.faces):
        return np.zeros(0), np.zeros(3)
    lower, upper = mesh.bounds
    about = (lower + upper) / 2.0
    a, b, c = np.moveaxis(mesh.corners - about, 1, 0)
    return np.einsum("ij,ij->i", a, cross(b, c)) / 6.0, about


def first_seen(rows: Array) -> tuple[Indices, Indices]:
    """(index of the first row of each distinct value, number of each row's value).

    rows: (n, k), compared exactly; values are numbered in the order of first appearance.
    """
    # Adding zero turns -0.0 into 0.0, which are equal numbers but different bits.
    order, new = _grouped(np.ascontiguousarray(rows + 0.0).view(np.uint64))
    first = np.minimum.reduceat(order, np.flatnonzero(new)) if len(order) else order
    by_first = np.argsort(first)
    rank = np.empty(len(first), dtype=np.int64)
    rank[by_first] = np.arange(len(first))
    number = np.empty(len(rows), dtype=np.int64)
    number[order] = rank[np.cumsum(new) - 1]
    return first[by_first], number


def _grouped(rows: NDArray[np.uint64]) -> tuple[Indices, NDArray[np.bool_]]:
    """Put equal rows side by side, as `in_order` does, but in no order of meaning: much quicker."""
    keys = np.zeros(len(rows), dtype=np.uint64)
    for column in rows.T:
        keys = (keys ^ column) * MIXING
        keys ^= keys >> np.uint64(29)
    order = np.argsort(keys)
    ordered = rows[order]
    new = np.ones(len(rows), dtype=bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    is_shared = np.diff(keys[order]) == 0
    return in_order(rows) if (new[1:] & is_shared).any() else (order, new)


def in_order(rows: NDArray[Any]) -> tuple[Indices, NDArray[np.bool_]]:
    """(numbers of rows (n, k) by value, which of these differ from the one before).

    Much quicker than `np.unique` of rows.
    """
    order = np.lexsort(rows.T[::-1])
    ordered = rows[order]
    new = np.ones(len(rows), dtype=bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    return order, new


def weld(mesh: TriangleMesh) -> TriangleMesh:
    """Vertices that are exactly equal become one, unused ones go; faces are all kept."""
    used = mesh.vertices[mesh.is_used]
    first, number = first_seen(used)
    if len(first) == len(mesh.vertices) and not np.signbit(used[used == 0.0]).any():
        return mesh
    faces = number[(np.cumsum(mesh.is_used) - 1)[mesh.faces]]
    return replace(mesh, vertices=used[first] + 0.0, faces=faces)


def drop_collapsed(mesh: TriangleMesh) -> TriangleMesh:
    """Drop faces that use one vertex twice: they have no area and no direction."""
    a, b, c = mesh.faces.T
    kept = (a != b) & (b != c) & (c != a)
    return mesh if kept.all() else mesh.select(kept)


def drop_repeated(mesh: TriangleMesh) -> TriangleMesh:
    """Drop faces that repeat an earlier face with the same winding."""
    turned = np.argmin(mesh.faces, axis=1)[:, None] + np.arange(3)
    canonical = np.take_along_axis(mesh.faces, turned % 3, axis=1)
    first, _ = first_seen(canonical.astype(np.float64))
    return mesh if len(first) == len(mesh.faces) else mesh.select(first)


def cleaned(mesh: TriangleMesh) -> TriangleMesh:
    """Welded, without collapsed and repeated faces: what geometry code wants as input."""
    welded = weld(mesh)
    kept = drop_repeated(drop_collapsed(welded))
    return kept if kept is welded else weld(kept)
