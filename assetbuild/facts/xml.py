"""An XML file of which every element and attribute is accounted for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, cast

from assetbuild.errors import UsageError, Where
from assetbuild.facts.table import Unread
from assetbuild.xml_text import NotXml, number_words, read_tree

if TYPE_CHECKING:
    from lxml.etree import _Element

MAX_BYTES = 256 * 1024 * 1024


class Walk:
    """Hands out elements and attributes and remembers which; the rest is `unread`.

    Comments and processing instructions say nothing. No entity is resolved, nothing is loaded;
    UsageError where the file is not XML or has a DOCTYPE. Faults of the text that every reader
    overlooks (`xml_text`) are unread.
    """

    def __init__(self, path: Path) -> None:
        self.name = path.name
        try:
            data = path.read_bytes()
        except OSError as error:
            raise UsageError(f"cannot read `{path}`: {error.strerror}") from None
        if len(data) > MAX_BYTES:
            raise UsageError(f"`{path}` has {len(data) / 1e6:.0f} MB; at most 256 MiB are read")
        try:
            self.root: _Element
            self.root, self._faults = read_tree(data)
        except NotXml as error:
            where = Where(self.name, error.line)
            what = error.message if error.doctype else f"not readable as XML: {error.message}"
            raise UsageError(what, where=where) from None
        self._elements = {self.root}
        self._attributes: set[tuple[_Element, str]] = set()

    def all(self, parent: _Element, tag: str) -> list[_Element]:
        """The children with that tag, in order; `*`: of any tag."""
        found = list(parent.iterchildren(tag))
        self._elements.update(found)
        return found

    def first(self, parent: _Element | None, tag: str) -> _Element | None:
        """The first child with that tag; a second one is unread."""
        found = None if parent is None else next(parent.iterchildren(tag), None)
        if found is not None:
            self._elements.add(found)
        return found

    def text(self, element: _Element | None, attribute: str) -> str | None:
        """The text of an attribute, or None."""
        if element is None or attribute not in element.attrib:
            return None
        self._attributes.add((element, attribute))
        return str(element.get(attribute))

    def numbers(
        self, element: _Element | None, attribute: str, count: int = 0
    ) -> tuple[float, ...] | None:
        """The numbers of an attribute, or None; one that holds others is unread.

        count: how many there must be, 0 = any.
        """
        text = None if element is None else element.get(attribute)
        if element is None or text is None or "_" in text:  # 1_000 is a number to Python
            return None
        try:
            found = tuple(float(word) for word in number_words(str(text), count))
        except ValueError:
            return None
        if not found or (count and len(found) != count):
            return None
        self._attributes.add((element, attribute))
        return found

    def number(self, element: _Element | None, attribute: str) -> float | None:
        """The number of an attribute, or None."""
        found = self.numbers(element, attribute, 1)
        return None if found is None else found[0]

    def line(self, element: _Element) -> int:
        """From 1."""
        return cast("int | None", element.sourceline) or 0  # the stubs lack its type

    def where(self, element: _Element) -> str:
        """`go1.urdf:33`."""
        return f"{self.name}:{self.line(element)}"

    def unread(self) -> Iterator[Unread]:
        """Faults of the text; every attribute, element and text that nobody asked for, in order."""
        for fault in self._faults:
            yield Unread(f"{self.name}:{fault.line}", f"untidy text ({fault.kind})", fault.text)
        todo = [self.root]
        while todo:
            element = todo.pop()
            if element not in self._elements:
                yield Unread(self.where(element), f"<{_tag(element)}>", _shown(element))
                continue
            where, tag = f"{self.where(element)} <{_tag(element)}>", _tag(element)
            for name in map(str, element.attrib):
                if (element, name) not in self._attributes:
                    yield Unread(where, f"`{name}` of <{tag}>", str(element.get(name))[:200])
            yield from _texts(element, where)
            todo += list(element.iterchildren())[::-1]


def _texts(element: _Element, where: str) -> Iterator[Unread]:
    """Words between elements."""
    texts: Sequence[str | None] = (element.text, *(child.tail for child in element))
    for text in texts:
        if text and text.strip():
            yield Unread(where, f"text in <{_tag(element)}>", text.strip()[:200])


def _tag(element: _Element) -> str:
    """An entity, which is not resolved, has a function in place of a tag."""
    return element.tag if isinstance(element.tag, str) else str(element)


def _shown(element: _Element) -> str:
    from lxml import etree

    return " ".join(etree.tostring(element, encoding="unicode", with_tail=False).split())[:200]
