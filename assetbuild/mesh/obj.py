"""Wavefront OBJ: our own writer, whose bytes depend on the numbers alone, and a reader for any."""

from __future__ import annotations

import io
import re
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from assetbuild.errors import StepError
from assetbuild.mesh.triangles import (
    Indices,
    TriangleMesh,
    first_seen,
    polygon_triangles,
    with_short_diagonals,
)
from assetbuild.robot.pose import Array

WIDTHS = {b"v": 3, b"vt": 2, b"vn": 3}
"""Numbers that are read of each element: positions, texture coordinates, normals."""
BLOCK = re.compile(rb"^(vn?|vt|f)[ \t].*\n(?:\1[ \t].*\n)*+|^.*\n", re.MULTILINE)
"""Neighbouring lines of one kind that carries numbers, else any single line."""
CHUNK = 4096
"""Lines that one format call writes: fast, and the format string stays small."""


def obj_bytes(mesh: TriangleMesh) -> bytes:
    """The mesh as OBJ text: `v`, then `vt`, `vn` if there are any, then `f`.

    Numbers by shortest round-trip `repr`, so reading gives the same float64. No comments, names
    or groups: equal meshes give equal bytes.
    """
    blocks = [_lines("v %r %r %r\n", mesh.vertices + 0.0)]
    columns = [mesh.faces + 1]
    for line, values in (("vt %r %r\n", mesh.uv), ("vn %r %r %r\n", mesh.normals)):
        if values is not None:
            rows = values.reshape(-1, values.shape[2]) + 0.0
            first, number = first_seen(rows)
            blocks.append(_lines(line, rows[first]))
            columns.append(number.reshape(-1, 3) + 1)
    pattern = ("//" if mesh.uv is None else "/").join(["%d"] * len(columns))
    corners = np.stack(columns, axis=2).reshape(len(mesh.faces), -1)
    blocks.append(_lines(f"f {pattern} {pattern} {pattern}\n", corners))
    return "".join(blocks).encode("ascii")


def read_triangles(data: bytes, subject: str = "mesh") -> TriangleMesh:
    """The mesh of an OBJ file as one piece: the inverse of `obj_bytes`.

    Raises StepError naming `subject` and the line where the text is not OBJ.
    """
    obj = parse_obj(data, subject)
    meshes = [mesh for _, mesh in obj.parts]
    if len(meshes) == 1:
        return meshes[0]
    corners = [mesh.faces for mesh in meshes] or [np.zeros((0, 3), dtype=np.int64)]
    return TriangleMesh(obj.positions, np.concatenate(corners))


@dataclass(frozen=True, eq=False)
class Obj:
    """An OBJ file. parts: (material, mesh over all positions) of each `usemtl`, by appearance.

    libraries: names of the MTL files. skipped: counts of elements that are not surfaces.
    has_colours: do vertices carry colours after their positions? lost: `vt`, `vn` that faces name
    and the file lacks.
    """

    positions: Array
    parts: tuple[tuple[str | None, TriangleMesh], ...]
    libraries: tuple[str, ...] = ()
    skipped: Mapping[str, int] = field(default_factory=dict)
    has_colours: bool = False
    lost: tuple[str, ...] = ()


class _Lines(NamedTuple):
    """Neighbouring lines of one kind: the number of the first, how many, their text, and how many
    elements of each table stand before them.
    """

    first: int
    rows: int
    text: bytes
    so_far: tuple[int, ...]


def parse_obj(data: bytes, subject: str) -> Obj:
    """Any OBJ file: polygons, negative indices, `usemtl`, vertex colours (ignored).

    Raises StepError naming `subject`, the line and the defect.
    """
    tables: dict[bytes, list[_Lines]] = {key: [] for key in WIDTHS}
    faces: dict[str | None, list[_Lines]] = {}
    seen: Counter[str] = Counter()
    libraries: list[str] = []
    material: str | None = None
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    if b"\\\n" in data or b"\\\r\n" in data:
        data = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    number, so_far = 1, dict.fromkeys(WIDTHS, 0)
    for match in BLOCK.finditer(data + b"\n"):
        text = match[0]
        key, rest = (match[1], b"") if match[1] else (*text.split(None, 1), b"", b"")[:2]
        lines = _Lines(number, text.count(b"\n"), text, tuple(so_far.values()))
        number += lines.rows
        if key == b"f":
            faces.setdefault(material, []).append(lines)
        elif key in tables:
            tables[key].append(lines)
            so_far[key] += lines.rows
        elif key == b"usemtl":
            material = rest.decode("utf-8", "replace").strip() or None
        elif key == b"mtllib":
            libraries.append(rest.decode("utf-8", "replace").strip())
        elif key in (b"l", b"p", b"curv", b"surf"):
            seen[key.decode()] += 1
    read = [_table(tables[key], width, key, subject) for key, width in WIDTHS.items()]
    surfaces = {name: _surface(blocks, read, subject) for name, blocks in faces.items()}
    first = tables[b"v"][0].text.split(b"\n", 1)[0] if tables[b"v"] else b""
    lost = sorted({kind for _, missing, _ in surfaces.values() for kind in missing})
    parts = tuple((name, mesh) for name, (mesh, _, _) in surfaces.items() if len(mesh.faces))
    seen["f"] = sum(bare for _, _, bare in surfaces.values())
    return Obj(read[0], parts, tuple(libraries), dict(+seen), len(first.split()) > 6, tuple(lost))


def _lines(pattern: str, rows: NDArray[np.float64] | Indices) -> str:
    """The rows through a `%` pattern, one line each."""
    parts = []
    for start in range(0, len(rows), CHUNK):
        chunk = rows[start : start + CHUNK]
        parts.append((pattern * len(chunk)) % tuple(chunk.ravel().tolist()))
    return "".join(parts)


def _table(blocks: Sequence[_Lines], width: int, key: bytes, subject: str) -> Array:
    """The first `width` numbers of each line; the rest (weights, colours) is ignored."""
    if not blocks:
        return np.zeros((0, width))
    text = b"".join(lines.text for lines in blocks)
    with suppress(ValueError):  # the loop below says what is wrong, and where
        columns = range(1, width + 1)  # after the keyword
        return np.loadtxt(io.BytesIO(text), usecols=columns, comments=None, ndmin=2)
    rows = []
    for line, words in _numbered(blocks):
        try:
            # A texture coordinate may come alone (`vt u`): v is 0 then.
            row = [float(word) for word in words[1 : width + 1]]
        except ValueError:
            row = []
        if not row or (len(row) < width and key != b"vt"):
            shown = b" ".join(words[1:]).decode("utf-8", "replace")[:40]
            stated = f"{key.decode()} {shown}"
            raise StepError(f"{subject}: line {line}: not {width} numbers: `{stated}`")
        rows.append([*row, 0.0][:width])
    return np.array(rows)


def _numbered(blocks: Sequence[_Lines]) -> Iterator[tuple[int, list[bytes]]]:
    """(number, words) of each line."""
    for lines in blocks:
        for number, line in enumerate(lines.text.split(b"\n")[:-1], lines.first):
            yield number, line.split()


def _surface(
    blocks: Sequence[_Lines], tables: Sequence[Array], subject: str
) -> tuple[TriangleMesh, list[str], int]:
    """The faces of one material; texture and normals only where all corners have them.

    tables: of positions, texture and normals. Also returns the kinds that faces name and the file
    lacks, which MuJoCo, assimp and PyBullet do without, and how many faces are but lines or points,
    which readers leave out.
    """
    counts, corners = _corners(blocks, subject)
    owner = np.repeat(np.arange(len(counts)), counts)
    if (corners < 0).any():  # they count back from what was read so far
        rows = [lines.rows for lines in blocks]
        so_far = np.repeat([lines.so_far for lines in blocks], rows, axis=0)
        corners = np.where(corners < 0, corners + so_far[owner] + 1, corners)
    kept = counts >= 3
    if not kept.all():
        corners, owner, counts = corners[kept[owner]], owner[kept[owner]], counts[kept]
    outside = (corners[:, 0] < 1) | (corners[:, 0] > len(tables[0]))
    if outside.any():
        at = int(np.argmax(outside))
        line = [number for number, _ in _numbered(blocks)][owner[at]]
        raise StepError(
            f"{subject}: line {line}: index {corners[at, 0]} of `v`, there are {len(tables[0])}"
        )
    cut = np.arange(len(corners)).reshape(-1, 3) if (counts == 3).all() else None
    if cut is None:
        points = tables[0][corners[:, 0] - 1]
        cut = with_short_diagonals(polygon_triangles(counts, points), counts, points)
    picked: list[Array | None] = []
    lost = []
    for kind, table, column in zip(("vt", "vn"), tables[1:], corners.T[1:], strict=True):
        # 0 = absent.
        if (column < 0).any() or (column > len(table)).any():
            lost.append(kind)
        is_whole = kind not in lost and (column > 0).all()
        picked.append(table[column[cut] - 1] if is_whole else None)
    mesh = TriangleMesh(tables[0], corners[cut, 0] - 1, *picked)
    return mesh, lost, int((~kept).sum())


def _corners(blocks: Sequence[_Lines], subject: str) -> tuple[Indices, Indices]:
    """(corners of each face, (k, 3) indices v/vt/vn of all of them from 1, 0 = absent)."""
    text = b"".join(lines.text for lines in blocks)
    codes = np.frombuffer(b"\n" + text, dtype=np.uint8)
    is_blank = codes <= ord(" ")
    begins = np.flatnonzero(is_blank[:-1] & ~is_blank[1:]) + 1  # of words
    counts = np.diff(np.searchsorted(begins, np.flatnonzero(codes == ord("\n")))) - 1
    slashes = np.flatnonzero(codes == ord("/"))
    each = len(slashes) // max(int(counts.sum()), 1)
    in_word = np.diff(np.searchsorted(slashes, begins), append=len(slashes))
    is_uniform = int((in_word == each).sum()) == counts.sum() + (len(counts) if not each else 0)
    if is_uniform and each < 3 and text.count(b"f") == len(counts):
        numbers = text.translate(None, b"f").replace(b"//", b"/0/").replace(b"/", b" ")
        with suppress(ValueError, DeprecationWarning), warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # of text that is no number
            values = np.fromstring(numbers, dtype=np.int64, sep=" ")
            if values.size == counts.sum() * (each + 1):
                values = values.reshape(-1, each + 1)
                return counts, np.pad(values, ((0, 0), (0, 2 - each)))
    rows: list[list[list[int]]] = []  # of words that name different things, or none
    for number, (_, *words) in _numbered(blocks):
        named = words if len(words) > 2 else [b""] * len(words)
        try:
            parts = ([int(part or 0) for part in word.split(b"/")[:3]] for word in named)
            rows.append([[*part, 0, 0][:3] for part in parts])
            np.array(rows[-1], dtype=np.int64)
        except (ValueError, OverflowError) as error:
            message = f"{subject}: line {number}: face indices are not whole numbers"
            raise StepError(message) from error
    corners = [corner for row in rows for corner in row]
    return np.array([len(row) for row in rows]), np.array(corners, dtype=np.int64).reshape(-1, 3)
