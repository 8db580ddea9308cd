"""Wavefront files: lines by their keyword locate, triangles with their looks decide."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from assetbuild.facts.again.row import NotParsedError, Row, numbers_of, same_text, value_of

ELEMENTS = ("v", "vt", "vn")


@dataclass(frozen=True)
class _Line:
    """One statement. number: from 1; text: behind the keyword."""

    number: int
    text: str


def mesh_rows(again: Path, there: Path) -> list[Row]:
    """What two meshes, or two libraries of their materials, say differently."""
    ours, theirs = (_lines(path.read_bytes()) for path in (again, there))
    name = there.stem
    rows = [row for word in dict.fromkeys((*ours, *theirs))
            for row in _rows(name, word, ours.get(word, ()), theirs.get(word, ()))]  # fmt: skip
    if there.suffix == ".obj":
        one, other = _triangles(again.read_bytes()), _triangles(there.read_bytes())
        if one == other:
            return []
        if not rows:
            rows = [Row("mesh", name, "order of lines", "", "another")]
    return rows


def _lines(data: bytes) -> dict[str, list[_Line]]:
    """Statements by their keyword, comments left out."""
    found: dict[str, list[_Line]] = {}
    for number, line in enumerate(_text(data).splitlines(), start=1):
        word, _, rest = line.strip().partition(" ")
        if word and not word.startswith("#"):
            found.setdefault(word, []).append(_Line(number, rest))
    return found


def _text(data: bytes) -> str:
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise NotParsedError(f"not readable as text: {error}") from None


def _rows(name: str, word: str, ours: Sequence[_Line], theirs: Sequence[_Line]) -> Iterator[Row]:
    """The first line of a keyword that differs, and how many there are."""
    if len(ours) != len(theirs):
        line = theirs[-1].number if theirs else 0
        yield Row("mesh", name, f"{word} lines", float(len(ours)), float(len(theirs)), line)
    for index, (one, other) in enumerate(zip(ours, theirs, strict=False)):
        if one.text != other.text and not same_text(one.text, other.text):
            attribute = f"{word}[{index}]"
            yield Row(
                "mesh", name, attribute, value_of(one.text), value_of(other.text), other.number
            )
            return


def _triangles(data: bytes) -> list[tuple[object, ...]]:
    """Look and corners of every face by value; what is no index stays a text."""
    rows: dict[str, list[tuple[float, ...] | str]] = {word: [] for word in ELEMENTS}
    faces: list[tuple[object, ...]] = []
    look: tuple[str, ...] = ()
    for line in _text(data).splitlines():
        word, _, rest = line.strip().partition(" ")
        if word in rows:
            rows[word].append(numbers_of(rest) or rest)
        elif word in ("usemtl", "mtllib"):
            look = (*look, rest.strip())[-2:]
        elif word == "f":
            faces.append((look, *(_corner(corner, rows) for corner in rest.split())))
    return faces


def _corner(corner: str, rows: dict[str, list[tuple[float, ...] | str]]) -> tuple[object, ...]:
    """Place, texture coordinates and normal of a corner."""
    found: list[object] = []
    for word, index in zip(ELEMENTS, corner.split("/"), strict=False):
        known = rows[word]
        is_index = index.lstrip("-").isdigit() and 0 < abs(int(index)) <= len(known)
        found.append(known[int(index) - (int(index) > 0)] if is_index else index)
    return tuple(found)
