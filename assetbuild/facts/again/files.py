"""The comparer of a file, by its ending."""

from __future__ import annotations

import os
from pathlib import Path

from assetbuild.facts.again.keys import key_tree
from assetbuild.facts.again.mesh import mesh_rows
from assetbuild.facts.again.picture import picture_tree
from assetbuild.facts.again.python import python_tree
from assetbuild.facts.again.row import Row
from assetbuild.facts.again.tree import Node, tree_rows
from assetbuild.facts.again.xml import root_of, xml_tree

TREES = {
    ".xml": xml_tree, ".urdf": xml_tree, ".py": python_tree,
    ".yaml": key_tree, ".yml": key_tree, ".json": key_tree, ".xrdf": key_tree,
    ".png": picture_tree, ".jpg": picture_tree, ".jpeg": picture_tree,
}  # fmt: skip
"""Ending of a file -> what it states."""


def rows_of(again: Path, there: Path, stages: tuple[Path, ...] = ()) -> list[Row]:
    """What two files say differently; none where they mean the same. NotParsedError.

    Each lies in a folder of its own, among the same other files. stages: the files of USD that a
    layer may be part of, in the folder of `again`.
    """
    ending = there.suffix.lower()
    if ending in (".usda", ".usdc", ".usd"):
        from assetbuild.facts.again.usd import usd_rows  # pxr takes a second, which only USD needs

        roots = tuple(os.path.relpath(stage, again.parent) for stage in stages)
        return usd_rows(again, there, roots)
    if ending in (".obj", ".mtl"):
        return mesh_rows(again, there)
    if ending in (".xml", ".urdf") and root_of(there).tag == "mujoco":
        from assetbuild.facts.again.mjcf import mjcf_rows

        return mjcf_rows(again, there)
    if ending in TREES:
        return tree_rows(TREES[ending](again), TREES[ending](there))
    return tree_rows(_lines(again), _lines(there))[:1]


def _lines(path: Path) -> Node:
    """A kind of file that is known to nobody here; the first line that differs says enough."""
    lines = enumerate(path.read_bytes().splitlines(), start=1)
    parts = {f"line {n}": Node(line.decode("utf-8", "replace"), {}, n) for n, line in lines}
    return Node(None, parts, 0, ("file", path.name))
