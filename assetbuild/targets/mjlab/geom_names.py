"""Names of collision geoms as mjlab's configs look for them: `*_collision`, `*_collision2`."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from xml.etree.ElementTree import Element

COLLISION = re.compile(r".*_collision\d*")
REFERENCES = ("geom", "geom1", "geom2")
"""Attributes that name a geom, of pairs, sensors and the wraps of tendons."""
TYPED_REFERENCES = {"objname": "objtype", "refname": "reftype"}
"""Attributes that name whatever another attribute says: sensors, tuples."""


def name_collisions(root: Element, visuals: Collection[str]) -> dict[str, str]:
    """Rename collision geoms of an MJCF that no config would find, wherever they are named.

    visuals: names of the geoms that touch nothing. Returns new names by old ones.
    """
    geoms = [geom for world in root.iter("worldbody") for geom in world.iter("geom")]
    taken = {geom.get("name", "") for geom in geoms}
    renamed: dict[str, str] = {}
    for geom in geoms:
        name = geom.get("name", "")
        if name in visuals or COLLISION.fullmatch(name) or _touches_nothing(geom):
            continue
        new = _free(f"{name or 'geom'}_collision", taken)
        geom.set("name", new)
        if name:
            renamed[name] = new
    _follow(root, renamed)
    return renamed


def _touches_nothing(geom: Element) -> bool:
    """Whether a geom's own masks say so; a class of ours says it for visuals alone."""
    masks = [geom.get(key, "1").strip().lstrip("+") for key in ("contype", "conaffinity")]
    return masks == ["0", "0"]


def _free(wanted: str, taken: set[str]) -> str:
    """`wanted`, or with the first number from 2 that makes it new; it is taken from now on."""
    name, count = wanted, 1
    while name in taken:
        count += 1
        name = f"{wanted}{count}"
    taken.add(name)
    return name


def _follow(root: Element, renamed: Mapping[str, str]) -> None:
    for node, key in _references(root):
        name = node.get(key, "")
        if name in renamed:
            node.set(key, renamed[name])


def _references(root: Element) -> Iterator[tuple[Element, str]]:
    """(element, attribute) of all that may name a geom."""
    for node in root.iter():
        for key in REFERENCES:
            if key in node.attrib:
                yield node, key
        for key, kind in TYPED_REFERENCES.items():
            if node.get(kind) == "geom" and key in node.attrib:
                yield node, key
