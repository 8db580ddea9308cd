"""What only MJCF can say (`MjcfOnly`), written back where it belongs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from xml.etree.ElementTree import Element, fromstring

from assetbuild.robot.model import MjcfOnly
from assetbuild.targets.mjcf.xml import element, number

SECTIONS = (
    "compiler", "option", "size", "default", "asset", "worldbody", "contact", "equality", "tendon",
    "actuator", "sensor", "keyframe",
)  # fmt: skip
"""In Menagerie's order."""
_IN_WORLD = {"geom": "shape", "site": "frame"}
"""Place by the tag of an element below <worldbody>, where they differ."""

_FREE = {"type": "free", "damping": "0", "armature": "0", "frictionloss": "0"}


def add_opaque(root: Element, items: tuple[MjcfOnly, ...], body_names: Mapping[str, str]) -> None:
    """Add everything that only MJCF says to the MJCF.

    An attribute with an empty value takes away what the MJCF would say without it.
    body_names: of the robot's bodies in MJCF.
    """
    if not items:
        return
    sections = {section.tag: section for section in root}
    root[:] = [sections.get(tag, element(tag)) for tag in SECTIONS]
    opaque = _Opaque(items, body_names)
    for node, place, owner in list(_places(root)):
        opaque.complete(node, place, owner)
    root[:] = [s for s in root if s.tag in sections or len(s) or s.attrib]
    keyframe, actuator = root.find("keyframe"), root.find("actuator")
    if keyframe is not None and actuator is not None:
        opaque.command(keyframe, actuator)


def _places(root: Element) -> Iterator[tuple[Element, str, str]]:
    """(element, place, owner), as in `MjcfOnly`, of all that something may be added to."""
    for section in root:
        yield section, section.tag, ""
        nodes = section if section.tag != "worldbody" else list(section.iter())[1:]
        for node in nodes:
            if section.tag == "actuator":
                yield node, "drive", node.get("joint", "")
            elif section.tag == "equality":
                yield node, "mimic", node.get("joint1", "")
            elif node.tag == "material":
                yield node, "material", node.get("name", "")
            elif node.tag == "freejoint":
                yield node, "freejoint", ""
            elif section.tag == "worldbody":
                yield node, _IN_WORLD.get(node.tag, node.tag), node.get("name", "")


class _Opaque:
    def __init__(self, items: tuple[MjcfOnly, ...], body_names: Mapping[str, str]) -> None:
        self._body_names = body_names
        self._added: dict[tuple[str, str], dict[str, str]] = {}
        self._inside: dict[tuple[str, str], list[Element]] = {}
        self._keys: dict[str, Element] = {}
        for item in items:
            self._take(item, fromstring(item.element))  # noqa: S314 # our own reader's

    def _take(self, item: MjcfOnly, said: Element) -> None:
        owner = self._body_names.get(item.owner, item.owner)
        if item.place == "keyframe":
            self._keys[item.owner] = said
        elif item.place in ("option", "size"):
            self._added[item.place, ""] = dict(said.attrib)
            self._inside.setdefault((item.place, ""), []).extend(said)
        elif item.place in SECTIONS:
            self._inside.setdefault((item.place, ""), []).append(self._renamed(said))
        elif item.place == "body" and said.tag != "body":
            place = ("body", owner) if owner else ("worldbody", "")
            self._inside.setdefault(place, []).append(self._renamed(said))
        else:
            place = ("body" if item.place == "root" else item.place, owner)
            self._added.setdefault(place, {}).update(said.attrib)

    def _renamed(self, said: Element) -> Element:
        """Names of bodies as the MJCF has them."""
        for inner in said.iter():
            for key in ("body", "body1", "body2", "target"):
                if inner.get(key) in self._body_names:
                    inner.set(key, self._body_names[inner.get(key, "")])
        return said

    def complete(self, node: Element, place: str, owner: str) -> None:
        """Add to one element what belongs on it and into it."""
        added = self._added.get((place, owner), {})
        said = {key: value for key, value in (node.attrib | added).items() if value}
        if node.tag == "freejoint" and added.keys() - {"name"}:
            # <freejoint> takes no damping; a <joint> takes what it lacks from its class.
            node.tag, said = "joint", _FREE | said
        node.attrib = said
        # Bodies below a body come last, as Menagerie has them.
        children = [child for child in node if place == "body" and child.tag == "body"]
        node[len(node) - len(children) :] = [*self._inside.get((place, owner), []), *children]

    def command(self, keyframe: Element, actuator: Element) -> None:
        """The source's commands in the order of the actuators, named as they are here."""
        order = [drive.get("name", "") for drive in actuator]
        for key in keyframe if order else ():
            own = dict(zip(order, key.get("ctrl", "").split(), strict=False))
            for said in self._keys.get(key.get("name", ""), ()):
                own[said.get("actuator", "")] = number(float(said.get("value", "0")))
            key.set("ctrl", " ".join(own.get(name, "0") for name in order))
