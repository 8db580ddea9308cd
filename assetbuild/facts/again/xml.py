"""XML: elements by their names, attributes as numbers or words."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, cast

from assetbuild.facts.again.tree import Node, NotParsedError, Words
from assetbuild.xml_text import NotXml, read_tree

if TYPE_CHECKING:
    from lxml.etree import _Element


def xml_tree(path: Path) -> Node:
    """Comments and the order of attributes mean nothing."""
    return _node(root_of(path), 0)


def root_of(path: Path) -> _Element:
    """The root element; NotParsedError."""
    try:
        return read_tree(path.read_bytes(), overlook=False)[0]
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
