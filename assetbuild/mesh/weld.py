"""Equal vertices become one; faces without area and faces said twice go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from assetbuild.mesh.triangles import Indices, TriangleMesh
from assetbuild.robot.pose import Array


def first_seen(rows: Array) -> tuple[Indices, Indices]:
    """(index of the first row of each distinct value, number of each row's value).

    rows: (n, k), compared exactly; values are numbered in the order of first appearance.
    """
    # Adding zero turns -0.0 into 0.0, which are equal numbers but different bits.
    bits = np.ascontiguousarray(rows + 0.0).view(np.int64)
    order = np.lexsort(bits.T[::-1])
    new = np.ones(len(rows), dtype=bool)
    new[1:] = (bits[order[1:]] != bits[order[:-1]]).any(axis=1)
    group = np.cumsum(new) - 1
    first = order[new]  # lexsort is stable: the first of equal rows comes first
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first, kind="stable")] = np.arange(len(first))
    number = np.empty(len(rows), dtype=np.int64)
    number[order] = rank[group]
    return np.sort(first), number


def weld(mesh: TriangleMesh) -> TriangleMesh:
    """Vertices that are exactly equal become one, unused ones go; faces are all kept."""
    used, faces = np.unique(mesh.faces, return_inverse=True)
    first, number = first_seen(mesh.vertices[used])
    vertices = mesh.vertices[used][first] + 0.0
    return replace(mesh, vertices=vertices, faces=number[faces.reshape(-1, 3)])


def drop_collapsed(mesh: TriangleMesh) -> TriangleMesh:
    """Without faces that use one vertex twice: they have no area and no direction."""
    a, b, c = mesh.faces.T
    return mesh.select((a != b) & (b != c) & (c != a))


def drop_repeated(mesh: TriangleMesh) -> TriangleMesh:
    """Without faces that repeat an earlier face with the same winding."""
    turned = np.argmin(mesh.faces, axis=1)[:, None] + np.arange(3)
    canonical = np.take_along_axis(mesh.faces, turned % 3, axis=1)
    first, _ = first_seen(canonical.astype(np.float64))
    return mesh if len(first) == len(mesh.faces) else mesh.select(first)


def cleaned(mesh: TriangleMesh) -> TriangleMesh:
    """Welded, without collapsed and repeated faces: what geometry code wants as input."""
    return weld(drop_repeated(drop_collapsed(weld(mesh))))
