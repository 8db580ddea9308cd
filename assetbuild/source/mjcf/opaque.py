"""`MjcfOnly` elements: XML text whose names are names in the Robot."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from assetbuild.robot.mjcf_only import words
from assetbuild.robot.pose import Pose


def body_element(tag: str, name: str, pose: Pose, attributes: Mapping[str, str]) -> str:
    """A named element at a place in a body."""
    placed = {"name": name, "pos": words(pose.xyz), "quat": words(pose.quat)}
    return element_text(tag, placed | dict(sorted(attributes.items())))


def element_text(
    tag: str,
    attributes: Mapping[str, str],
    children: Iterable[tuple[str, Mapping[str, str]]] = (),
) -> str:
    """An element with empty children, as text."""
    from lxml import etree

    def plain(stated: Mapping[str, str]) -> dict[str, str]:
        return {key: " ".join(value.split()) for key, value in stated.items()}

    element = etree.Element(tag, plain(attributes))
    for child, child_attributes in children:
        etree.SubElement(element, child, plain(child_attributes))
    return etree.tostring(element, encoding="unicode")


def keys(words: str) -> frozenset[str]:
    """A set of names of attributes."""
    return frozenset(words.split())


def leftover(attributes: Mapping[str, str], held: frozenset[str]) -> dict[str, str]:
    """What an element says beyond what the Robot holds."""
    return {key: value for key, value in attributes.items() if key not in held and key != "class"}
