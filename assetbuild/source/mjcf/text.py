"""An MJCF's elements: which line they come from, which class speaks for them."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from itertools import groupby

from assetbuild.errors import SourceError, Where
from assetbuild.facts.mjcf_grammar import BODY, Path
from assetbuild.findings import Finding, Rule, Severity
from assetbuild.xml_text import Element as Element

AT = "_at"
"""Attribute that carries `file:line` of an element while it is worked on."""
WORLD = "world"
FROM_OUTSIDE = "if another file includes this one and defines it, build that file"
"""Hint for what a file names and does not hold."""
SPATIAL = ("body", "frame")
OF_BODIES = frozenset(("worldbody", "body", "frame", "replicate"))
_DEFAULT_TAG = {"spatial": "tendon", "fixed": "tendon", "freejoint": None}
"""Element -> the element of `<default>` that speaks for it, where the two differ."""

DROPPED = Rule(
    "mjcf.dropped",
    ("info", "warning"),
    "an element or attribute of the source's MJCF has no place in the robot or in the MJCF that "
    "is written: scenery, how things are shown, what belongs to a merged body",
    "nothing, where it is not part of the robot; otherwise follow the hint",
)


def dropped(
    element: str,
    subject: str,
    message: str,
    hint: str = "",
    severity: Severity = "info",
    **data: tuple[str, ...] | int,
) -> Finding:
    """What is said of an element, or of some attributes of it, that was left out."""
    return DROPPED(
        subject, message, hint, severity=severity, data={"element": element, "count": 1, **data}
    )


def where_of(element: Element) -> Where:
    """File and line of an element."""
    file, _, line = element.get(AT, "").rpartition(":")
    return Where(file, int(line or 0))


def error_at(element: Element, message: str, hint: str = "") -> SourceError:
    """An error about an element, ready to be raised."""
    return SourceError(message, where=where_of(element), hint=hint)


def own_attributes(element: Element) -> dict[str, str]:
    """What an element itself says, its name and class among it."""
    return {str(key): str(value) for key, value in element.attrib.items() if key != AT}


def plain_text(root: Element, *, indented: bool = False) -> str:
    """Return the XML without the places of its elements."""
    from lxml import etree

    bare = copy.deepcopy(root)
    for element in bare.iter("*"):
        element.attrib.pop(AT, "")
    if indented:
        etree.indent(bare)
    return etree.tostring(bare, encoding="unicode")


def remove(element: Element) -> None:
    """Take an element out of its text."""
    parent = element.getparent()
    if parent is not None:
        parent.remove(element)


def path_of(element: Element) -> Path:
    """Where an element stands, as MuJoCo's schema says it: a <joint> of a tendon is no joint.

    All bodies, frames and copies are one place, and so are all classes.
    """
    tags = (str(one.tag) for one in (element, *element.iterancestors()))
    places = [BODY if tag in OF_BODIES else tag for tag in tags][::-1]
    return tuple(place for place, _ in groupby(places))


def of_bodies(root: Element, *tags: str) -> list[Element]:
    """The elements that stand in bodies, in document order; none of classes, tendons, sensors."""
    return [one for one in root.iter(*tags) if path_of(one)[1:] == (BODY, one.tag)]


def parts(body: Element, *tags: str) -> Iterator[Element]:
    """A body's own elements of these kinds, in file order; those in `<frame>`s too."""
    waiting = list(body.iterchildren("*"))[::-1]
    while waiting:
        element = waiting.pop()
        if element.tag in tags:
            yield element
        elif element.tag == "frame":
            waiting += list(element.iterchildren("*"))[::-1]


def bodies(world: Element) -> Iterator[tuple[Element, str]]:
    """(body, name of its parent body or `WORLD`) of all bodies, depth first in file order."""
    waiting = [(child, WORLD) for child in parts(world, "body")][::-1]
    while waiting:
        body, parent = waiting.pop()
        yield body, parent
        waiting += [(child, body.get("name", "")) for child in parts(body, "body")][::-1]


def world_of(root: Element) -> Element:
    """The <worldbody>, without which `flatten_mjcf` takes no MJCF."""
    world = root.find("worldbody")
    assert world is not None  # noqa: S101 # see above
    return world


def named_bodies(root: Element) -> list[tuple[Element, str]]:
    """(element, name) of the world and of all bodies, depth first in file order."""
    world = world_of(root)
    return [(world, WORLD), *((body, body.get("name", "")) for body, _ in bodies(world))]


class Classes:
    """The default classes: what an element says together with the classes that speak for it."""

    def __init__(self, root: Element) -> None:
        self._stated: dict[str, dict[str, dict[str, str]]] = {"main": {}}
        for top in root.iterchildren("default"):
            self._add(top, top.get("class", "main"), {})

    def _add(self, node: Element, name: str, inherited: dict[str, dict[str, str]]) -> None:
        """Add a class, and those inside of it."""
        defaults = self._stated.setdefault(name, {})
        for tag, attributes in inherited.items():
            defaults[tag] = {**attributes, **defaults.get(tag, {})}
        for child in node.iterchildren("*"):
            tag = str(child.tag)
            if tag != "default":
                defaults[tag] = {**defaults.get(tag, {}), **own_attributes(child)}
        for child in node.iterchildren("default"):
            if not child.get("class"):
                raise error_at(child, "a <default> inside another without a `class`")
            self._add(child, str(child.get("class")), defaults)

    def attributes(self, element: Element) -> dict[str, str]:
        """All that is said of an element, its classes included; without its name and class."""
        tag = str(element.tag)
        default_tag = _DEFAULT_TAG.get(tag, tag)
        parent = element.getparent()
        if parent is not None and parent.tag == "equality":
            default_tag = "equality"
        around = (one.get("childclass") for one in element.iterancestors(*SPATIAL))
        name = element.get("class") or next(filter(None, around), "main")
        if name not in self._stated:
            raise error_at(element, f"no default class `{name}`", FROM_OUTSIDE)
        defaults = self._stated[name].get(default_tag, {}) if default_tag else {}
        stated = own_attributes(element).items()
        return defaults | {key: value for key, value in stated if key not in ("class", "name")}
