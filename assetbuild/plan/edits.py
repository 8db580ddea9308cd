"""The recipe's edits, one step after another, between reading and merging."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from assetbuild.engine.graph import Ref
from assetbuild.engine.planner import Planner
from assetbuild.errors import meant_pattern
from assetbuild.geometry.plan import Geometry
from assetbuild.plugin_types import Edit, MassEdit
from assetbuild.recipe.models import OneEdit
from assetbuild.recipe.validation import Key, KeyedError
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Tree
from assetbuild.robot.shapes import MeshFile, SourceShapes

AGAIN = " edited"
"""What a lint's label ends with that runs on the edited robot."""


def edits_of(entries: Sequence[OneEdit]) -> list[tuple[str, Edit, Key]]:
    """(label of its node, step, key in the recipe) of each."""
    return [
        (
            f"edit {number} {entry.name}",
            getattr(entry, entry.name),
            ("edits", number - 1, entry.name),
        )
        for number, entry in enumerate(entries, start=1)
    ]


def apply_edits(
    entries: Sequence[OneEdit], read: Mapping[str, Ref], geometry: Geometry | None, p: Planner
) -> dict[str, Ref] | None:
    """`links.json` and `shapes.json` after the last edit; None while one must wait for an answer.

    geometry: None while the meshes are not known; only an edit that reads meshes waits for it.
    """
    robot = {port: read[port] for port in ("links.json", "shapes.json")}
    for label, edit, key in edits_of(entries):
        links, shapes = p.ask(robot["links.json"]), p.ask(robot["shapes.json"])
        if links is None or shapes is None:
            return None
        tree = decode(Tree, links)
        known = {"link": list(tree.by_body), "joint": list(tree.by_joint)}
        for below, kind, pattern in edit.patterns():
            must_match((*key, *below), pattern, known[kind], kind)
        inputs = dict(robot)
        for index, shape in enumerate(edit.meshes(decode(SourceShapes, shapes))):
            if geometry is None:
                return None
            assert isinstance(shape.geometry, MeshFile)  # noqa: S101 # that is what it asked for
            node = geometry.converted(shape.geometry)
            inputs[f"mesh/{index}/parts/"] = node["parts/"]
            inputs[f"mesh/{index}/mesh.json"] = node["mesh.json"]
        node = p.add(label, edit, inputs)
        robot = {port: node[port] for port in robot}
    return robot


def guessed_links(entries: Sequence[OneEdit]) -> tuple[str, ...]:
    """Patterns of the links whose mass an edit only guesses."""
    edits = [edit for _, edit, _ in edits_of(entries) if isinstance(edit, MassEdit)]
    return tuple(edit.link for edit in edits if edit.guessed)


def must_match(key: Key, pattern: str, names: list[str], kind: str) -> None:
    """KeyedError for a pattern that matches none of the names."""
    if not any(re.fullmatch(pattern, name) for name in names):
        hint = meant_pattern(pattern, names)
        raise KeyedError(key, f"pattern `{pattern}` matches no {kind}", hint)
