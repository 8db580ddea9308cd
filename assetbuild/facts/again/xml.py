"""XML: elements by their names, attributes as numbers or words."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from assetbuild.facts.again.tree import (
    Node,
    NotParsedError,
    Row,
    Words,
    of_one_sign,
    same,
    tree_rows,
)
from assetbuild.robot.pose import quat_of_rpy
from assetbuild.xml_text import NotXml, read_tree

if TYPE_CHECKING:
    from lxml.etree import _Element


LEFT_OUT = {"origin": ("inertial", "visual", "collision", "joint"),
            "axis": ("joint",), "dynamics": ("joint",)}  # fmt: skip
"""Elements that a URDF may leave out -> those that have one."""
URDF_DEFAULTS = {
    "origin": {"xyz": "0 0 0", "rpy": "0 0 0"}, "axis": {"xyz": "1 0 0"},
    "dynamics": {"damping": "0", "friction": "0"}, "limit": {"lower": "0", "upper": "0"},
    "mesh": {"scale": "1 1 1"}, "mimic": {"multiplier": "1", "offset": "0"},
}  # fmt: skip


def xml_rows(again: Path, there: Path) -> list[Row]:
    """What two files state differently, but for two spellings of one rotation."""
    rows = tree_rows(xml_tree(again), xml_tree(there))
    return [row for row in rows if row.attribute != "origin rpy" or not _is_one_turn(row)]


def _is_one_turn(row: Row) -> bool:
    angles = [value for value in (row.expected, row.found) if isinstance(value, tuple)]
    turns = [np.array(quat_of_rpy(*map(float, each))) for each in angles if len(each) == 3]
    return len(turns) == 2 and same(*map(of_one_sign, turns))


def xml_tree(path: Path) -> Node:
    """Comments and the order of attributes mean nothing, nor whether a URDF states a default."""
    root = root_of(path)
    if root.tag == "robot":
        _state_defaults(root)
    return _node(root, 0)


def _state_defaults(root: _Element) -> None:
    for tag, owners in LEFT_OUT.items():
        for owner in root.iter(*owners):
            if owner.find(tag) is None:
                owner.append(owner.makeelement(tag))
    for element in root.iter(*URDF_DEFAULTS):
        for name, default in URDF_DEFAULTS[str(element.tag)].items():
            element.set(name, element.get(name, default))


def root_of(path: Path) -> _Element:
    """The root element; NotParsedError, also where it is no UTF-8, which alone all readers take."""
    data = path.read_bytes()
    try:
        data.decode()
        return read_tree(data, overlook=False)[0]
    except UnicodeDecodeError as error:
        raise NotParsedError(f"not UTF-8: {error}", data.count(b"\n", 0, error.start) + 1) from None
    except NotXml as error:
        raise NotParsedError(error.message, error.line) from None


def _node(element: _Element, depth: int) -> Node:
    """What stands outside of everything with a name is about an element below the root."""
    line = cast("int | None", element.sourceline) or 0  # the stubs lack its type
    parts = {str(name): Node(Words(value), {}, line) for name, value in element.attrib.items()}
    if text := (element.text or "").strip():
        parts["text"] = Node(Words(text), {}, line)
    places = Counter(_key(child) for child in element)
    seen: Counter[str] = Counter()
    for child in element:
        key = _key(child)
        seen[key] += 1
        parts[f"{key}[{seen[key] - 1}]" if places[key] > 1 else key] = _node(child, depth + 1)
    name = _name(element) if depth else ""
    subject = (str(element.tag), name) if name or depth < 2 else None
    return Node(None, parts, line, subject)


def _key(element: _Element) -> str:
    return f"{element.tag} {_name(element)}".strip()


def _name(element: _Element) -> str:
    """A default of MJCF is called by its class."""
    is_default = element.tag == "default"
    return str(element.get("name") or (element.get("class", "") if is_default else ""))
