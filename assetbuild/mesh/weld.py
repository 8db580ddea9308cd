"""Equal vertices become one; faces without area and faces said twice go."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from assetbuild.mesh.triangles import Indices, TriangleMesh
from assetbuild.robot.pose import Array

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
"""2^64 / the golden ratio: multiplying by it spreads bits well (Knuth)."""


def first_seen(rows: Array) -> tuple[Indices, Indices]:
    """(index of the first row of each distinct value, number of each row's value).

    rows: (n, k), compared exactly; values are numbered in the order of first appearance.
    """
    # Adding zero turns -0.0 into 0.0, which are equal numbers but different bits.
    bits = np.ascontiguousarray(rows + 0.0).view(np.uint64)
    groups = _grouped(_mixed(bits))
    if (bits[groups.order] != bits[groups.first[groups.number]]).any():  # two values, one hash
        groups = _grouped(np.unique(bits, axis=0, return_inverse=True)[1].ravel())
    by_first = np.argsort(groups.first)
    rank = np.empty(len(by_first), dtype=np.int64)
    rank[by_first] = np.arange(len(by_first))
    number = np.empty(len(rows), dtype=np.int64)
    number[groups.order] = rank[groups.number]
    return groups.first[by_first], number


class _Groups(NamedTuple):
    """Rows sorted by their key. order: (n,) row numbers; number: (n,) group of each of these;
    first: (groups,) least row number of each."""

    order: Indices
    number: Indices
    first: Indices


def _grouped(keys: NDArray[Any]) -> _Groups:
    order = np.argsort(keys)
    ordered = keys[order]
    new = np.ones(len(keys), dtype=bool)
    new[1:] = ordered[1:] != ordered[:-1]
    starts = np.flatnonzero(new)
    first = np.minimum.reduceat(order, starts) if len(starts) else order
    return _Groups(order, np.cumsum(new) - 1, first)


def _mixed(bits: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """(n,) a hash of each row of (n, k): one key sorts faster than k."""
    keys = np.zeros(len(bits), dtype=np.uint64)
    for column in bits.T:
        keys = (keys ^ column) * GOLDEN
        keys ^= keys >> np.uint64(32)
    return keys


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
