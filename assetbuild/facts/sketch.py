"""Which triangles of two meshes differ, told from a sketch of each that is a few kilobytes long.

A sketch is a multiset of triangles, in whatever order they stand: each falls into one of 16 groups
by a hash of its numbers, and a group holds how many there are and their sum. Where one mesh has one
triangle more in a group than the other, the difference of the sums is that triangle. Numbers are
float32, in the frame of the file: that is what formats keep.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Words = NDArray[np.uint32]
Hashes = NDArray[np.uint64]
Bits = TypeVar("Bits", Words, Hashes)

SKETCH = "triangles of the file"
"""The quantity, behind the name of a format: `usd:triangles of the file`."""
GROUPS = 16
MIX = np.uint64(0x9E3779B97F4A7C15)
"""Odd, without a pattern: 2^64 over the golden ratio."""
WIDTHS = {9: (), 15: ("uv",), 18: ("normals",), 24: ("uv", "normals")}
"""Numbers of a triangle -> what its corners have besides a place."""


@dataclass(frozen=True)
class _Groups:
    """counts, (GROUPS,); sums, (GROUPS, w), of the numbers' bits modulo 2^32; hashes: theirs."""

    counts: NDArray[np.int64]
    sums: Words
    hashes: Hashes


def sketch_of(
    corners: ArrayLike, uv: ArrayLike | None = None, normals: ArrayLike | None = None
) -> str:
    """The sketch of (n, 3, 3) corners with (n, 3, 2) texture coordinates and (n, 3, 3) normals."""
    parts = [np.asarray(corners, dtype=np.float64).reshape(-1, 3, 3)]
    for part, width in ((uv, 2), (normals, 3)):
        flat = np.asarray(() if part is None else part, dtype=np.float64).reshape(-1, 3, width)
        if len(flat) and len(flat) == len(parts[0]):
            parts.append(flat)
    with np.errstate(over="ignore"):
        numbers = np.concatenate(parts, axis=2).astype(np.float32) + np.float32(0.0)  # no -0
    words = numbers.view(np.uint32).reshape(len(numbers), 3 * numbers.shape[2])
    hashes = _hashes(words)
    groups = (hashes >> np.uint64(60)).astype(np.uint8)
    order = np.argsort(groups, kind="stable")
    counts = np.bincount(groups, minlength=GROUPS).astype(np.int64)
    sums, totals = _sums(words[order], counts), _sums(hashes[order, None], counts)[:, 0]
    return _packed(_Groups(counts, sums, totals))


def _hashes(words: Words) -> Hashes:
    """(n,) of the (n, w) numbers of each triangle, whose order counts."""
    found = np.zeros(len(words), dtype=np.uint64)
    for column in words.T:
        found = (found ^ column) * MIX
        found ^= found >> np.uint64(29)
    return found


def _sums(rows: Bits, counts: NDArray[np.int64]) -> Bits:
    """Sum of the rows of each group, which stand together, modulo the type's range."""
    found = np.zeros((GROUPS, rows.shape[1]), dtype=rows.dtype)
    there = np.flatnonzero(counts)
    if len(there):
        starts = np.concatenate(([0], np.cumsum(counts)[:-1]))[there]
        found[there] = np.add.reduceat(rows, starts, axis=0, dtype=rows.dtype)
    return found


def _packed(groups: _Groups) -> str:
    counts = groups.counts.astype("<u4").tobytes()
    data = counts + groups.hashes.astype("<u8").tobytes() + groups.sums.astype("<u4").tobytes()
    return base64.b64encode(data).decode("ascii")


def _unpacked(sketch: str) -> _Groups | None:
    """None of a text that is no sketch."""
    try:
        data = base64.b64decode(sketch, validate=True)
    except ValueError:
        return None
    width, rest = divmod(len(data) - 12 * GROUPS, 4 * GROUPS)
    if rest or width not in WIDTHS:
        return None
    counts = np.frombuffer(data, "<u4", GROUPS).astype(np.int64)
    hashes = np.frombuffer(data, "<u8", GROUPS, 4 * GROUPS).astype(np.uint64)
    sums = np.frombuffer(data, "<u4", GROUPS * width, 12 * GROUPS).reshape(GROUPS, width)
    return _Groups(counts, sums.astype(np.uint32), hashes)


# --- what differs ---------------------------------------------------------------------------


def told(before: object, after: object) -> tuple[str, str]:
    """Both sides of a difference in words: the first triangle that only one of them has."""
    old, new = (_unpacked(text) if isinstance(text, str) else None for text in (before, after))
    if old is None or new is None:
        return tuple("none" if s is None else f"{s.counts.sum()}" for s in (old, new))  # type: ignore[return-value] # two
    if old.sums.shape != new.sums.shape:
        return _kinds(old), _kinds(new)
    rows = [[*_only(one, two)] for one, two in ((old, new), (new, old))]
    places = [[_shown(row[:, :3]) for row in some] for some in rows]
    if rows[0] and rows[1] and places[0][0] == places[1][0]:  # at one place: what it has besides
        places = [[_shown(row[:, 3:]) for row in some] for some in rows]
        where = f"at {_shown(rows[0][0][:, :3])}: "
        return f"{where}{places[0][0]}", f"{where}{places[1][0]}"
    return _said(old, places[0], before), _said(new, places[1], after)


def _kinds(groups: _Groups) -> str:
    has = WIDTHS[groups.sums.shape[1]]
    words = {"uv": "texture coordinates", "normals": "normals"}
    besides = " and ".join(words[name] for name in has)
    return f"{groups.counts.sum()}, with {besides}" if has else f"{groups.counts.sum()}, bare"


def _said(groups: _Groups, only: list[str], sketch: object) -> str:
    """`11,286, one at (0 0 1) (0 1 0) (1 0 0)`; a digest where no single one can be told."""
    count = f"{groups.counts.sum():,}"
    if only:
        return f"{count}, one at {only[0]}"
    return f"{count}, digest {hashlib.sha256(str(sketch).encode()).hexdigest()[:8]}"


def _only(one: _Groups, two: _Groups) -> Iterator[NDArray[np.float32]]:
    """(3, w) of a triangle that the first has alone, of each group where nothing else differs."""
    for group in np.flatnonzero(one.counts - two.counts == 1):
        row = (one.sums - two.sums)[[group]]
        if _hashes(row)[0] == (one.hashes - two.hashes)[group]:
            yield row.reshape(3, -1).view(np.float32)


def _shown(numbers: NDArray[np.float32]) -> str:
    return " ".join("(" + " ".join(f"{v:.6g}" for v in corner) + ")" for corner in numbers)
