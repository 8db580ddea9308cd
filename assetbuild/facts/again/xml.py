"""XML: elements by their path, named by the nearest `name`; numbers as numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from difflib import SequenceMatcher
from typing import TYPE_CHECKING, cast

from assetbuild.facts.again.row import NotParsedError, Row, same_text, value_of
from assetbuild.xml_text import NotXml, read_tree

if TYPE_CHECKING:
    from lxml.etree import _Element


def root_of(data: bytes) -> _Element:
    """The root element; NotParsedError."""
    try:
        return read_tree(data, overlook=False)[0]
    except NotXml as error:
        raise NotParsedError(error.message, error.line) from None


def xml_rows(again: bytes, there: bytes) -> list[Row]:
    """What the elements and attributes of two files say differently."""
    return list(_rows(root_of(again), root_of(there)))


def _rows(again: _Element, there: _Element) -> Iterator[Row]:
    kind, name, path = _subject(there)
    line = line_of(there)
    if again.tag != there.tag:
        yield Row(kind, name, _joined(path, "element"), str(again.tag), str(there.tag), line)
        return
    for attribute in dict.fromkeys((*map(str, again.attrib), *map(str, there.attrib))):
        one, other = again.get(attribute), there.get(attribute)
        if one is None or other is None or not same_text(one, other):
            label = _joined(path, attribute)
            yield Row(kind, name, label, value_of(one), value_of(other), line)
    if not same_text(again.text or "", there.text or ""):
        label = _joined(path, "text")
        yield Row(kind, name, label, value_of(again.text), value_of(there.text), line)
    for one_child, other_child in _pairs(list(again), list(there)):
        yield from _child_rows(one_child, other_child, line)


def _child_rows(again: _Element | None, there: _Element | None, line: int) -> Iterator[Row]:
    if again is not None and there is not None:
        yield from _rows(again, there)
    elif again is not None:
        kind, name, path = _subject(again)
        yield Row(kind, name, _joined(path, "missing"), _shown(again), None, line)
    elif there is not None:
        kind, name, path = _subject(there)
        yield Row(kind, name, _joined(path, "extra"), None, _shown(there), line_of(there))


def _pairs(
    again: Sequence[_Element], there: Sequence[_Element]
) -> Iterator[tuple[_Element | None, _Element | None]]:
    """Children of the same tag and name belong together; those without a name by what they say."""
    keys = dict.fromkeys((*map(_key, again), *map(_key, there)))
    for key in keys:
        ours = [element for element in again if _key(element) == key]
        theirs = [element for element in there if _key(element) == key]
        yield from _aligned(ours, theirs)


def _aligned(
    again: Sequence[_Element], there: Sequence[_Element]
) -> Iterator[tuple[_Element | None, _Element | None]]:
    if len(again) == len(there):
        yield from zip(again, there, strict=True)
        return
    matcher = SequenceMatcher(None, [_shown(e) for e in again], [_shown(e) for e in there], False)
    for _, i, i_end, j, j_end in matcher.get_opcodes():
        for step in range(max(i_end - i, j_end - j)):
            yield (
                again[i + step] if i + step < i_end else None,
                there[j + step] if j + step < j_end else None,
            )


def _key(element: _Element) -> tuple[str, str]:
    return str(element.tag), _name(element)


def _name(element: _Element) -> str:
    """A default of MJCF is called by its class."""
    return str(element.get("name") or (element.get("class", "") if _is_default(element) else ""))


def _is_default(element: _Element) -> bool:
    return element.tag == "default"


def _subject(element: _Element) -> tuple[str, str, tuple[str, ...]]:
    """(tag and name of the nearest element with a name, path from there)."""
    path: list[str] = []
    here: _Element | None = element
    while here is not None and here.getparent() is not None:
        if _name(here):
            return str(here.tag), _name(here), tuple(path[::-1])
        path.append(_numbered(here))
        here = here.getparent()
    return path[-1] if path else str(element.tag), "", tuple(path[-2::-1])


def _numbered(element: _Element) -> str:
    """`geom`, or `geom[1]` for the second one without a name."""
    parent = element.getparent()
    same = [] if parent is None else [e for e in parent if _key(e) == _key(element)]
    return f"{element.tag}[{same.index(element)}]" if len(same) > 1 else str(element.tag)


def _joined(path: Sequence[str], attribute: str) -> str:
    return " ".join((*path, attribute))


def line_of(element: _Element) -> int:
    """From 1."""
    return cast("int | None", element.sourceline) or 0  # the stubs lack its type


def _shown(element: _Element) -> str:
    from lxml import etree

    return " ".join(etree.tostring(element, encoding="unicode", with_tail=False).split())[:200]
