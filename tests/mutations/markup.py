"""Mutations of XML: every attribute, every element and its text, of MJCF and URDF alike."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

from lxml import etree

from tests.mutations.change import Mutation, pools, text_changes

SEVERAL = {"visual", "collision", "transmission", "sensor", "gazebo"}
"""Elements of which a URDF may have one more; of an MJCF MuJoCo decides."""


def walk(path: Path, file: str, random_: random.Random) -> Iterator[Mutation]:
    """All mutations of one file."""
    elements = _elements(etree.parse(str(path)))
    pairs = [(_named(e, str(name)), text) for e in elements for name, text in e.attrib.items()]
    texts = pools([(str(name), str(text)) for name, text in pairs])
    for index, element in enumerate(elements):
        where = _where(element)
        for name, text in element.attrib.items():
            label, text = _named(element, str(name)), str(text)
            for what, new in text_changes(text, texts[label], random_):
                key = ("set", index, str(name), new)
                yield Mutation(file, where, label, what, text, new, key)
            key = ("drop", index, str(name), "")
            yield Mutation(file, where, label, "attribute deleted", text, "", key)
        if element.text and element.text.strip():
            label = f"{element.tag}/text()"
            for what, new in text_changes(element.text.strip(), [], random_):
                key = ("text", index, "", new)
                yield Mutation(file, where, label, what, element.text.strip(), new, key)
        yield from _structure(element, index, file, where)


def _structure(element: etree._Element, index: int, file: str, where: str) -> Iterator[Mutation]:
    parent = element.getparent()
    if parent is None:
        return
    whole = " ".join(etree.tostring(element, encoding="unicode", with_tail=False).split())
    tag = str(element.tag)
    yield Mutation(file, where, tag, "element deleted", whole, "", ("delete", index, "", ""))
    if not file.endswith(".urdf") or tag in SEVERAL:
        key = ("double", index, "", "")
        yield Mutation(file, where, tag, "element duplicated", whole, whole, key)


def apply(path: Path, key: tuple[object, ...]) -> None:
    """Makes the change of a mutation's key in the file."""
    tree = etree.parse(str(path))
    what, index, name, new = key
    element = _elements(tree)[int(str(index))]
    parent = element.getparent()
    if what == "set":
        element.set(str(name), str(new))
    elif what == "drop":
        del element.attrib[str(name)]
    elif what == "text":
        element.text = str(new)
    elif parent is None:
        raise ValueError("the root of a file stays")
    elif what == "delete":
        parent.remove(element)
    else:
        parent.insert(parent.index(element) + 1, _copy(element))
    tree.write(str(path), encoding="utf-8")


def _copy(element: etree._Element) -> etree._Element:
    """The same under other names, where it and its children have names of their own."""
    copy: etree._Element = etree.fromstring(etree.tostring(element, with_tail=False))
    for each in copy.iter():
        if each.get("name") and each.tag != "material":
            each.set("name", f"{each.get('name')}_copy")
    return copy


def _elements(tree: etree._ElementTree) -> list[etree._Element]:
    return [e for e in tree.getroot().iter() if isinstance(e.tag, str)]


def _named(element: etree._Element, name: str) -> str:
    return f"{element.tag}/@{name}"


def _where(element: etree._Element) -> str:
    """`body trunk/geom FR_foot`."""
    line: list[str] = []
    for each in [element, *element.iterancestors()][:3]:
        own = each.get("name") or each.get("class") or each.get("joint") or ""
        line.append(f"{each.tag} {own}".strip())
    return "/".join(reversed(line))
