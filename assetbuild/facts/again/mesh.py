"""Wavefront files: lines by their keyword locate, triangles with their looks decide."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from assetbuild.errors import StepError
from assetbuild.facts.again.row import NotParsedError, Row
from assetbuild.facts.again.tree import Node, Words, same, tree_rows
from assetbuild.mesh.obj import parse_obj


def mesh_rows(again: Path, there: Path) -> list[Row]:
    """The first line of each keyword that two meshes, or two libraries of materials, differ in."""
    first: dict[str, Row] = {}
    for row in tree_rows(_tree(again), _tree(there)):
        first.setdefault(row.attribute.partition("[")[0], row)
    return [] if there.suffix == ".obj" and _same_triangles(again, there) else [*first.values()]


def _tree(path: Path) -> Node:
    """Statements by their keyword, comments left out."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise NotParsedError(f"not readable as text: {error}") from None
    parts: dict[str, Node] = {}
    seen: Counter[str] = Counter()
    for number, line in enumerate(lines, start=1):
        word, _, rest = line.strip().partition(" ")
        if word and not word.startswith("#"):
            parts[f"{word}[{seen[word]}]"] = Node(Words(rest.strip()), {}, number)
            seen[word] += 1
    return Node(None, parts, 0, ("mesh", path.stem))


def _same_triangles(again: Path, there: Path) -> bool:
    """Whether all corners have the same place, texture coordinates, normal and look."""
    try:
        ours, theirs = (parse_obj(path.read_bytes(), path.name) for path in (again, there))
    except StepError:
        return False
    looks = [(obj.libraries, [look for look, _ in obj.parts]) for obj in (ours, theirs)]
    return looks[0] == looks[1] and all(
        same(one.corners, other.corners) and same(one.uv, other.uv)
        and same(one.normals, other.normals)
        for (_, one), (_, other) in zip(ours.parts, theirs.parts, strict=True)
    )  # fmt: skip
