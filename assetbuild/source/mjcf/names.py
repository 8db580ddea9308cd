"""A name for everything that has none, so that text and compiled model can be held together."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from assetbuild.source.mjcf.text import Classes, bodies, parts

if TYPE_CHECKING:
    from lxml.etree import _Element

SECTIONS = ("actuator", "sensor", "equality", "tendon", "keyframe")


def name_all(root: _Element) -> None:
    """Name every body, joint, geom, site, camera, light, mesh and element of a section."""
    classes = Classes(root)
    world = root.find("worldbody")
    if world is not None:
        _name_bodies(world)
        _name_parts(world, classes)
    for asset in root.iterchildren("asset"):
        for tag in ("mesh", "material", "texture", "hfield"):
            _name(list(asset.iterchildren(tag)), _asset_name)
    for section in SECTIONS:
        for node in root.iterchildren(section):
            _name(list(node.iterchildren("*")), _acting_name)


def _name_bodies(world: _Element) -> None:
    taken = {str(body.get("name")) for body, _ in bodies(world) if body.get("name")} | {"world"}
    waiting = [(child, "world") for child in parts(world, "body")][::-1]
    while waiting:
        body, parent = waiting.pop()
        if not body.get("name"):
            body.set("name", _free("body" if parent == "world" else f"{parent}_body", taken))
        name = str(body.get("name"))
        waiting += [(child, name) for child in parts(body, "body")][::-1]


def _name_parts(world: _Element, classes: Classes) -> None:
    around = [(world, "world"), *((body, str(body.get("name"))) for body, _ in bodies(world))]
    for tags in (("joint", "freejoint"), ("geom",), ("site",), ("camera",), ("light",)):
        found = [(part, name) for body, name in around for part in parts(body, *tags)]
        taken = {str(part.get("name")) for part, _ in found if part.get("name")}
        for part, body_name in found:
            if not part.get("name"):
                suffix = _role(classes.attributes(part)) if part.tag == "geom" else tags[0]
                part.set("name", _free(f"{body_name}_{suffix}", taken))


def _role(said: dict[str, str]) -> str:
    """Whether a geom's masks let it touch anything."""
    masks = [said.get(key, "1").strip() for key in ("contype", "conaffinity")]
    return "visual" if all(mask in ("0", "+0") for mask in masks) else "collision"


def _name(elements: list[_Element], wanted: Callable[[_Element], str]) -> None:
    taken = {str(element.get("name")) for element in elements if element.get("name")}
    for element in elements:
        if not element.get("name"):
            element.set("name", _free(wanted(element), taken))


def _asset_name(element: _Element) -> str:
    return PurePosixPath(element.get("file", "")).stem or str(element.tag)


def _acting_name(element: _Element) -> str:
    """After what it acts on or looks at: `FR_hip_joint`, `imu_gyro`."""
    for key in ("joint", "tendon", "site", "objname", "body", "joint1", "body1"):
        if element.get(key):
            owner = str(element.get(key))
            parent = element.getparent()
            acting = parent is not None and parent.tag == "actuator"
            return owner if acting else f"{owner}_{element.tag}"
    return str(element.tag)


def _free(wanted: str, taken: set[str]) -> str:
    """`wanted`, or with the first number from 2 that makes it new; it is taken from now on."""
    name, count = wanted, 1
    while name in taken:
        count += 1
        name = f"{wanted}{count}"
    taken.add(name)
    return name
