"""Files of meshes: Wavefront OBJ, our own writer and a reader for any, and arrays inside the graph.

The writer's bytes depend on the numbers alone. Arrays are read much faster than text; a bundle
holds OBJ text, which is written once, when a mesh has its final shape.
"""

from __future__ import annotations

import functools
import io
import warnings
import zipfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

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
    piece = _read_own(data)
    if piece is not None:
        return piece
    obj = parse_obj(data, subject)
    meshes = [mesh for _, mesh in obj.parts]
    if len(meshes) == 1:
        return meshes[0]
    corners = [mesh.faces for mesh in meshes] or [np.zeros((0, 3), dtype=np.int64)]
    return TriangleMesh(obj.positions, np.concatenate(corners))


def _read_own(data: bytes) -> TriangleMesh | None:
    """A mesh in the layout of `obj_bytes`, read in a few passes; None for any other layout."""
    uv_at, normals_at, faces_at = (data.find(key) + 1 for key in (b"\nvt ", b"\nvn ", b"\nf "))
    starts = [0, *(at for at in (uv_at, normals_at) if at), faces_at]
    if not data.startswith(b"v ") or not faces_at or starts != sorted(starts):
        return None
    ends = dict(zip(starts, [*starts[1:], len(data)], strict=True))
    columns = 1 + bool(uv_at) + bool(normals_at)
    vertices = _numbers(data[: ends[0]], 3)
    uv = _numbers(data[uv_at : ends[uv_at]], 2) if uv_at else None
    normals = _numbers(data[normals_at : ends[normals_at]], 3) if normals_at else None
    corners = _numbers(data[faces_at:].replace(b"/", b" "), 3 * columns, np.int64)
    if vertices is None or corners is None or (uv_at and uv is None):
        return None
    index = corners.reshape(-1, 3, columns) - 1
    sizes = [len(table) for table in (vertices, uv, normals) if table is not None]
    if len(sizes) != columns or (index < 0).any() or (index.max(axis=(0, 1)) >= sizes).any():
        return None  # the careful reader says what is wrong, and where
    return TriangleMesh(
        vertices,
        np.ascontiguousarray(index[:, :, 0]),
        None if uv is None else uv[index[:, :, 1]],
        None if normals is None else normals[index[:, :, columns - 1]],
    )


def _numbers(block: bytes, width: int, kind: type = np.float64) -> NDArray[Any] | None:
    """Rows of `width` numbers, one a line after its keyword; None when a line differs."""
    text = block.translate(None, b"vntf")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # of text that is no number
            values: NDArray[Any] = np.fromstring(text, dtype=kind, sep=" ")
    except (ValueError, DeprecationWarning):
        return None
    return values.reshape(-1, width) if values.size == width * block.count(b"\n") else None


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


class _Face(NamedTuple):
    """A face: its line, its corners as `v/vt/vn`, and how many of each were read before it."""

    line: int
    words: list[bytes]
    so_far: tuple[int, int, int]


def parse_obj(data: bytes, subject: str) -> Obj:
    """Any OBJ file: polygons, negative indices, `usemtl`, vertex colours (ignored).

    Raises StepError naming `subject`, the line and the defect.
    """
    tables: dict[bytes, list[bytes]] = {key: [] for key in WIDTHS}
    faces: dict[str | None, list[_Face]] = {}
    seen: dict[str, int] = {}
    libraries: list[str] = []
    material: str | None = None
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    if b"\\\n" in data or b"\\\r\n" in data:
        data = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    for number, line in enumerate(data.split(b"\n"), start=1):
        key, rest = (*line.split(None, 1), b"", b"")[:2]
        if key == b"f":
            words = rest.split()
            if len(words) < 3:  # a line or a point, which readers leave out
                seen["f"] = seen.get("f", 0) + 1
                continue
            so_far = (len(tables[b"v"]), len(tables[b"vt"]), len(tables[b"vn"]))
            faces.setdefault(material, []).append(_Face(number, words, so_far))
        elif key in tables:
            tables[key].append(rest)
        elif key == b"usemtl":
            material = rest.decode("utf-8", "replace").strip() or None
        elif key == b"mtllib":
            libraries.append(rest.decode("utf-8", "replace").strip())
        elif key in (b"l", b"p", b"curv", b"surf"):
            seen[key.decode()] = seen.get(key.decode(), 0) + 1
    read = [_table(tables[key], width, data, key, subject) for key, width in WIDTHS.items()]
    surfaces = {name: _surface(rows, read, subject) for name, rows in faces.items()}
    has_colours = bool(tables[b"v"]) and len(tables[b"v"][0].split()) >= 6
    lost = sorted({kind for _, missing in surfaces.values() for kind in missing})
    parts = tuple((name, mesh) for name, (mesh, _) in surfaces.items())
    return Obj(read[0], parts, tuple(libraries), seen, has_colours, tuple(lost))


def _lines(pattern: str, rows: NDArray[np.float64] | Indices) -> str:
    """The rows through a `%` pattern, one line each."""
    parts = []
    for start in range(0, len(rows), CHUNK):
        chunk = rows[start : start + CHUNK]
        parts.append((pattern * len(chunk)) % tuple(chunk.ravel().tolist()))
    return "".join(parts)


def _table(rows: Sequence[bytes], width: int, data: bytes, key: bytes, subject: str) -> Array:
    """The first `width` numbers of each row; the rest (weights, colours) is ignored."""
    if not rows:
        return np.zeros((0, width))
    with suppress(ValueError):  # the loop below says what is wrong, and where
        values = np.loadtxt(rows, usecols=range(width), comments=None, ndmin=2)
        if len(values) == len(rows):
            return values
    out = np.zeros((len(rows), width))
    for number, row in enumerate(rows):
        try:
            # A texture coordinate may come alone (`vt u`): v is 0 then.
            coordinates = [float(word) for word in row.split()[:width]]
            out[number, : len(coordinates)] = coordinates
        except ValueError:
            coordinates = []
        if not coordinates or (len(coordinates) < width and key != b"vt"):
            line = _line_of(data, key, number)
            text = row.decode("utf-8", "replace")[:40]
            raise StepError(f"{subject}: line {line}: not {width} numbers: `{key.decode()} {text}`")
    return out


def _line_of(data: bytes, key: bytes, number: int) -> int:
    """Line, from 1, of element `number` (from 0) of a kind."""
    count = -1
    for line, text in enumerate(data.split(b"\n"), start=1):
        if text.strip().partition(b" ")[0] == key:
            count += 1
            if count == number:
                return line
    return 0


def _surface(
    faces: Sequence[_Face], tables: Sequence[Array], subject: str
) -> tuple[TriangleMesh, list[str]]:
    """The faces of one material; texture and normals only where all corners have them.

    tables: of positions, texture and normals. Also returns the kinds that faces name and the file
    lacks: MuJoCo, assimp and PyBullet do without them.
    """
    counts = np.array([len(face.words) for face in faces], dtype=np.int64)
    corners = _corners([word for face in faces for word in face.words])
    if corners is None:
        bad = next((face.line for face in faces if _corners(face.words) is None), 0)
        raise StepError(f"{subject}: line {bad}: face indices are not whole numbers")
    if (corners < 0).any():  # they count back from what was read so far
        so_far = np.repeat(np.array([face.so_far for face in faces]), counts, axis=0)
        corners = np.where(corners < 0, corners + so_far + 1, corners)
    outside = (corners[:, 0] < 1) | (corners[:, 0] > len(tables[0]))
    if outside.any():
        at = int(np.argmax(outside))
        line = int(np.repeat([face.line for face in faces], counts)[at])
        raise StepError(
            f"{subject}: line {line}: index {corners[at, 0]} of `v`, there are {len(tables[0])}"
        )
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
    return TriangleMesh(tables[0], corners[cut, 0] - 1, *picked), lost


def _corners(words: Sequence[bytes]) -> Indices | None:
    """(k, 3) indices v/vt/vn from 1, 0 = absent; None when a word is no index."""
    text = b" ".join(words)
    out = np.zeros((len(words), 3), dtype=np.int64)
    try:
        slashes = words[0].count(b"/")
        if all(word.count(b"/") == slashes for word in words):
            filled = text.replace(b"//", b"/0/").replace(b"/", b" ").split()
            if len(filled) == len(words) * (slashes + 1):
                out[:, : slashes + 1] = np.array(filled, dtype=np.int64).reshape(len(words), -1)
                return out
        for number, word in enumerate(words):
            values = [int(part or 0) for part in word.split(b"/")[:3]]
            out[number, : len(values)] = values
    except (ValueError, OverflowError):
        return None
    return out


SUFFIX = ".npz"


def array_bytes(mesh: TriangleMesh) -> bytes:
    """The arrays of a mesh as an npz file; zeros have no sign, as in OBJ text."""
    tables = {"vertices": mesh.vertices, "uv": mesh.uv, "normals": mesh.normals}
    arrays: dict[str, Any] = {"faces": mesh.faces}  # Any: `savez` has other keywords, too
    arrays |= {name: table + 0.0 for name, table in tables.items() if table is not None}
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def read_part(path: Path, subject: str = "mesh") -> TriangleMesh:
    """A part of a converted mesh, arrays or OBJ. StepError where the file is neither."""
    if path.suffix != SUFFIX:
        return read_triangles(path.read_bytes(), subject)
    try:
        with np.load(path, allow_pickle=False) as file:
            return TriangleMesh(
                file["vertices"], file["faces"], file.get("uv"), file.get("normals")
            )
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise StepError(f"{subject}: `{path.name}` holds no mesh: {error}") from error


@functools.lru_cache(16)
def obj_of(path: Path) -> bytes:
    """A part of a converted mesh as OBJ text, made once for all links that show it."""
    return obj_bytes(read_part(path)) if path.suffix == SUFFIX else path.read_bytes()
