"""What only MJCF can say (`MjcfOnly`), written back where it belongs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from xml.etree import ElementTree

from assetbuild.robot.model import MjcfOnly
from assetbuild.targets.mjcf.xml import Element, element, number

SECTIONS = (
    "compiler", "option", "default", "asset", "worldbody", "contact", "equality", "tendon",
    "actuator", "sensor", "keyframe",
)  # fmt: skip
"""In Menagerie's order."""
_TAG = {"joint": "joint", "shape": "geom", "frame": "site", "camera": "camera", "body": "body"}
"""Place -> the element below <worldbody> whose attributes it adds to."""
_DRIVES = ("joint", "jointinparent")


def with_opaque(
    root: Element, items: tuple[MjcfOnly, ...], body_names: Mapping[str, str]
) -> Element:
    """The MJCF with everything that only MJCF says.

    An attribute with an empty value takes away what the MJCF would say without it.
    body_names: of the robot's bodies in MJCF.
    """
    if not items:
        return root
    opaque = _Opaque(items, body_names)
    sections = {section.tag: section for section in root.children}
    for tag in SECTIONS:
        section = sections.get(tag, Element(tag, gap=True))
        made = opaque.section(section)
        if tag in sections or made.attributes or made.children:
            sections[tag] = made
    if "keyframe" in sections and "actuator" in sections:
        sections["keyframe"] = opaque.commands(sections["keyframe"], sections["actuator"])
    ordered = [sections[tag] for tag in SECTIONS if tag in sections]
    return element(root.tag, dict(root.attributes), ordered)


class _Opaque:
    def __init__(self, items: tuple[MjcfOnly, ...], body_names: Mapping[str, str]) -> None:
        self._body_names = body_names
        self._added: dict[tuple[str, str], dict[str, str]] = {}
        self._inside: dict[tuple[str, str], list[Element]] = {}
        self._keys: dict[str, ElementTree.Element] = {}
        for item in items:
            self._take(item, ElementTree.fromstring(item.element))  # noqa: S314 # our own reader's

    def _take(self, item: MjcfOnly, said: ElementTree.Element) -> None:
        owner = self._body_names.get(item.owner, item.owner)
        if item.place == "keyframe":
            self._keys[item.owner] = said
        elif item.place == "option":
            self._added["option", ""] = dict(said.attrib)
            self._inside.setdefault(("option", ""), []).extend(_element(c) for c in said)
        elif item.place in SECTIONS:
            self._inside.setdefault((item.place, ""), []).append(self._renamed(said))
        elif item.place == "body" and said.tag != "body":
            self._inside.setdefault(("body", owner), []).append(self._renamed(said))
        else:
            place = "body" if item.place == "root" else item.place
            self._added.setdefault((place, owner), {}).update(said.attrib)

    def _renamed(self, said: ElementTree.Element) -> Element:
        """Names of bodies as the MJCF has them."""
        for inner in said.iter():
            for key in ("body", "body1", "body2", "target"):
                if inner.get(key) in self._body_names:
                    inner.set(key, self._body_names[inner.get(key, "")])
        return _element(said)

    def section(self, section: Element) -> Element:
        """One section with what belongs into it."""
        if section.tag == "worldbody":
            return self._world(section)
        more = self._inside.get((section.tag, ""), [])
        own = _merged(section.attributes, self._added.get((section.tag, ""), {}))
        children = [self._child(section.tag, child) for child in section.children]
        return Element(section.tag, own, (*children, *more), section.gap)

    def _child(self, section: str, child: Element) -> Element:
        said = dict(child.attributes)
        added: Mapping[str, str] = {}
        if section == "actuator":
            added = self._added.get(("drive", said.get("joint", "")), {})
        elif section == "equality":
            added = self._added.get(("mimic", said.get("joint1", "")), {})
        elif section == "asset" and child.tag == "material":
            added = self._added.get(("material", said.get("name", "")), {})
        return Element(child.tag, _merged(child.attributes, added), child.children, child.gap)

    def _world(self, world: Element) -> Element:
        """Children are made before their parents: no recursion, however long the chain."""
        made: dict[int, list[Element]] = {id(world): []}
        parents: dict[int, Element] = {}
        order: list[Element] = [world]
        for node in order:  # grows while it is walked
            for child in node.children:
                parents[id(child)] = node
                order.append(child)
        for node in reversed(order[1:]):
            children = made.pop(id(node), [])[::-1]
            made.setdefault(id(parents[id(node)]), []).append(self._in_world(node, children))
        children = [*made[id(world)][::-1], *self._inside.get(("body", ""), [])]
        return Element(world.tag, world.attributes, tuple(children), world.gap)

    def _in_world(self, node: Element, children: list[Element]) -> Element:
        name = dict(node.attributes).get("name", "")
        place = next((place for place, tag in _TAG.items() if tag == node.tag), node.tag)
        added = self._added.get((place, "" if node.tag == "freejoint" else name), {})
        if node.tag == "body":
            children += self._inside.get(("body", name), [])
        attributes, tag = _merged(node.attributes, added), node.tag
        if tag == "freejoint" and added.keys() - {"name"}:
            # <freejoint> takes no damping; a <joint> takes what it lacks from its class.
            plain = {"type": "free", "damping": "0", "armature": "0", "frictionloss": "0"}
            tag, attributes = "joint", tuple({**plain, **dict(attributes)}.items())
        return Element(tag, attributes, tuple(_in_order(children)), node.gap)

    # --- keyframes ----------------------------------------------------------------------------

    def commands(self, keyframe: Element, actuator: Element) -> Element:
        """The source's commands in the order of the actuators, named as they are here."""
        order = [dict(child.attributes).get("name", "") for child in actuator.children]
        keys = []
        for key in keyframe.children:
            said = dict(key.attributes)
            source = self._keys.get(said.get("name", ""))
            own = dict(zip(order, said.get("ctrl", "").split(), strict=False))
            if source is not None:
                stated = {c.get("actuator", ""): float(c.get("value", "0")) for c in source}
                own |= {name: number(value) for name, value in stated.items()}
            if order:
                said["ctrl"] = " ".join(own.get(name, "0") for name in order)
            keys.append(Element(key.tag, tuple(said.items()), key.children, key.gap))
        return Element(keyframe.tag, keyframe.attributes, tuple(keys), keyframe.gap)


def _merged(
    own: tuple[tuple[str, str], ...], added: Mapping[str, str]
) -> tuple[tuple[str, str], ...]:
    both = {**dict(own), **added}
    return tuple((key, value) for key, value in both.items() if value)


def _in_order(children: list[Element]) -> Iterator[Element]:
    """Bodies below a body come last, as Menagerie has them."""
    yield from (child for child in children if child.tag != "body")
    yield from (child for child in children if child.tag == "body")


def _element(said: ElementTree.Element) -> Element:
    return element(said.tag, dict(said.attrib), [_element(child) for child in said])
