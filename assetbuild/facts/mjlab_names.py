"""The names that collision geoms must have for mjlab's configs, whatever the source calls them.

A geom that may touch something is called `<name>_collision`, with a number from 2 where that name
is taken; one whose name ends so already keeps it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from assetbuild.facts.reference import Reference
from assetbuild.robot.model import MjcfOnly, Place, Sensor

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

FOUND = re.compile(r"_collision\d*\Z")


def found_by_mjlab(reference: Reference) -> Reference:
    """The robot with those names, wherever its geoms are named."""
    names = _new_names(reference)
    if not names:
        return reference
    control, shapes = reference.control, reference.shapes
    called = tuple(replace(s, name=names.get(s.name, s.name)) for s in shapes.shapes)
    return replace(
        reference,
        shapes=replace(shapes, shapes=called),
        control=replace(
            control,
            contacts=tuple((names.get(name, name), own) for name, own in control.contacts),
            sensors=tuple(_sensor(sensor, names) for sensor in control.sensors),
            mjcf_only=tuple(_opaque(item, names) for item in control.mjcf_only),
        ),
    )


def _new_names(reference: Reference) -> dict[str, str]:
    """By the old ones, of all that change."""
    solid = [shape.name for shape in reference.shapes.of("collision")]
    taken = {shape.name for shape in reference.shapes.shapes}
    for item in reference.control.mjcf_only:
        for geom in _geoms(item):
            taken.add(geom.get("name", ""))
            if {geom.get("contype", "1"), geom.get("conaffinity", "1")} != {"0"}:
                solid.append(geom.get("name", ""))
    made: dict[str, str] = {}
    for name in solid:
        if not FOUND.search(name):
            count, made[name] = 1, f"{name}_collision"
            while made[name] in taken:
                count += 1
                made[name] = f"{name}_collision{count}"
    return made


def _parsed(item: MjcfOnly) -> Element:
    from defusedxml.ElementTree import fromstring

    element: Element = fromstring(item.element)
    return element


def _geoms(item: MjcfOnly) -> Iterator[Element]:
    """Geoms that only MJCF knows, such as planes."""
    if item.place == "body" and "<geom" in item.element:
        yield from _parsed(item).iter("geom")


def _sensor(sensor: Sensor, names: Mapping[str, str]) -> Sensor:
    def called(place: Place) -> Place:
        known = place.kind == "shape" and place.name in names
        return replace(place, name=names[place.name]) if known else place

    other = sensor.relative_to and called(sensor.relative_to)
    return replace(sensor, at=called(sensor.at), relative_to=other)


def _opaque(item: MjcfOnly, names: Mapping[str, str]) -> MjcfOnly:
    """With the new names of geoms in its element, and as its owner."""
    if item.place == "shape":
        return replace(item, owner=names.get(item.owner, item.owner))
    if item.place not in ("body", "contact", "tendon", "sensor"):
        return item
    from xml.etree.ElementTree import tostring

    element = _parsed(item)
    for node in element.iter():
        keys: list[str] = [key for key in ("geom", "geom1", "geom2") if key in node.attrib]
        keys += ["name"] if node.tag == "geom" and item.place == "body" else []
        keys += [name for name, kind in (("objname", "objtype"), ("refname", "reftype"))
                 if node.get(kind) == "geom"]  # fmt: skip
        for key in keys:
            node.set(key, names.get(node.get(key, ""), node.get(key, "")))
    return replace(item, element=tostring(element, "unicode"))
