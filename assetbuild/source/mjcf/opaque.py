"""`MjcfOnly` elements: XML text whose names are names in the Robot."""

from __future__ import annotations

from collections.abc import Mapping

from assetbuild.robot.pose import Pose


def attributes_of(tag: str, attributes: Mapping[str, str]) -> str:
    """An element without children, attributes in alphabetical order."""
    return element_text(tag, dict(sorted(attributes.items())))


def body_element(tag: str, name: str, pose: Pose, attributes: Mapping[str, str]) -> str:
    """A named element at a place in a body."""
    placed = {"name": name, "pos": words(pose.xyz), "quat": words(pose.quat)}
    return element_text(tag, placed | dict(sorted(attributes.items())))


def element_text(
    tag: str,
    attributes: Mapping[str, str],
    children: tuple[tuple[str, Mapping[str, str]], ...] = (),
) -> str:
    """An element with empty children, as text."""
    from lxml import etree

    element = etree.Element(tag)
    for key, value in attributes.items():
        element.set(key, " ".join(value.split()))
    for child, said in children:
        inner = etree.SubElement(element, child)
        for key, value in said.items():
            inner.set(key, " ".join(value.split()))
    return etree.tostring(element, encoding="unicode")


def keys(words: str) -> frozenset[str]:
    """A set of names of attributes."""
    return frozenset(words.split())


def leftover(said: Mapping[str, str], held: frozenset[str]) -> dict[str, str]:
    """What an element says beyond what the Robot holds."""
    return {key: value for key, value in said.items() if key not in held and key != "class"}


def words(values: tuple[float, ...]) -> str:
    """Shortest exact numbers."""
    return " ".join(repr(float(v) + 0.0).removesuffix(".0") for v in values)
