"""What only an MJCF can say and what moves the robot: without it a format moves otherwise.

Springs have a module of their own (`joint_springs`), because a USD holds many of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from xml.etree import ElementTree

from assetbuild.robot.model import MjcfOnly

Element = ElementTree.Element
_HELD = {"connect": "bodies at a point", "weld": "bodies", "flex": "flexible bodies"}
TENDON = ("stiffness", "damping", "frictionloss", "armature", "range", "actuatorfrcrange")
MEDIUM = ("wind", "density", "viscosity", "magnetic")
FLAGS = ("actuation", "clampctrl", "constraint", "contact", "damper", "equality", "frictionloss",
         "limit", "spring")  # fmt: skip
"""Flags of `<option>` that switch off something that every other format has."""
_BRAKES = ("damping", "armature", "frictionloss")


def lost_motion(items: Iterable[MjcfOnly]) -> dict[str, tuple[str, ...]]:
    """What is lost in words, with the names of the things that it is said of."""
    found: dict[str, list[str]] = {}
    for item in items:
        element = ElementTree.fromstring(item.element)  # noqa: S314 # our own reader wrote it
        for what in _lost(item, element):
            found.setdefault(what, []).append(item.owner or element.get("name", ""))
    return {what: tuple(names) for what, names in found.items()}


def lost_in_usd(items: Sequence[MjcfOnly]) -> dict[str, tuple[str, ...]]:
    """As `lost_motion`, without the bodies that gravity does not pull, which PhysX knows."""
    weightless = whole_gravity(items)
    return lost_motion(i for i in items if i.place != "body" or i.owner not in weightless)


def whole_gravity(items: Iterable[MjcfOnly]) -> frozenset[str]:
    """Bodies whose weight is compensated wholly (`gravcomp` 1), so that gravity does not pull them.

    None where a joint's drive makes that force itself (`actuatorgravcomp`).
    """
    whole = set()
    for item in items:
        if item.place == "joint" and 'actuatorgravcomp="true"' in item.element:
            return frozenset()
        if item.place == "body" and item.element.startswith("<body") and _gravcomp(item) == 1.0:
            whole.add(item.owner)
    return frozenset(whole)


def _gravcomp(item: MjcfOnly) -> float:
    element = ElementTree.fromstring(item.element)  # noqa: S314 # our own reader wrote it
    return float(element.get("gravcomp", "0"))


def _lost(item: MjcfOnly, element: Element) -> Iterator[str]:
    if item.place == "equality" and (what := _of_equality(element)):
        yield what
    if item.place == "tendon" and _some(element, TENDON):
        yield "tendons that pull, brake or stop"
    if item.place == "actuator" and not item.owner:
        yield "actuators that no drive of a joint can be"
    if item.place == "body" and element.tag == "body" and _some(element, ("gravcomp",)):
        yield "gravity compensation of bodies"
    if item.place == "option":
        yield from _of_option(element)
    if item.place == "freejoint" and _some(element, _BRAKES):
        yield "what brakes the floating base"
    if item.place == "joint" and len(element.get("damping", "").split()) > 1:
        yield "damping of joints by a polynomial"
    if item.place == "shape" and _some(element, ("surfacevel",)):
        yield "surfaces that move what touches them (`surfacevel`)"


def _of_option(element: Element) -> Iterator[str]:
    if _some(element, MEDIUM):
        yield "the medium around the robot (`wind`, `density`, `viscosity`)"
    if element.get("actuatorgroupdisable"):
        yield "groups of actuators that are switched off (`actuatorgroupdisable`)"
    off = [k for flag in element for k, v in flag.attrib.items() if k in FLAGS and v == "disable"]
    for name in off:
        yield f"flags that switch something off (`{name}`)"


def _of_equality(element: Element) -> str:
    if element.get("active") == "false":
        return ""
    if element.tag == "joint":
        return "joints that follow others by a polynomial, or are held at a position"
    if element.tag == "tendon":
        return "couplings of tendons"
    return f"constraints that hold {_HELD.get(element.tag, 'parts')} together"


def _some(element: Element, names: Iterable[str]) -> bool:
    """Whether it states one of these numbers, and not as 0."""
    return any(float(word) != 0.0 for name in names for word in element.get(name, "").split())
