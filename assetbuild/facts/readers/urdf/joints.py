"""Joints of a URDF: what they join, how they move, what limits them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from assetbuild.facts.readers.urdf.links import read_origin
from assetbuild.facts.table import Value, Writer
from assetbuild.facts.xml import Walk

if TYPE_CHECKING:
    from lxml.etree import _Element

TYPES = {"revolute": "rotary", "continuous": "rotary", "prismatic": "linear"}
BOUNDED = ("revolute", "prismatic")
UNLIMITED = 1e9
"""From here on a limit limits nothing: URDF has no word for that, and one left out means 0."""


def read_joints(walk: Walk, book: Writer, unique: Callable[[str, str], str]) -> None:
    """All joints, and the places of the bodies below them. unique: (kind, name) -> free name."""
    for element in walk.all(walk.root, "joint"):
        name = unique("joint", walk.text(element, "name") or "")
        book.place("joint", name, walk.where(element))
        parent = walk.text(walk.first(element, "parent"), "link") or ""
        child = walk.text(walk.first(element, "child"), "link") or ""
        pose = read_origin(walk, element)
        book.put("body", child, {"parent": parent, "pose": (*pose.xyz, *pose.quat)})
        kind = walk.text(element, "type") or ""
        book.put(
            "joint",
            name,
            {"type": TYPES.get(kind, kind), "urdf:type": kind, "body": child, "parent": parent}
            | _axis(walk, element, kind)
            | _numbers(walk, element, kind)
            | _mimic(walk, element),
        )


def _axis(walk: Walk, joint: _Element, kind: str) -> dict[str, Value]:
    """The unit vector; a word of a joint without one, and where the file's is longer."""
    element = walk.first(joint, "axis")
    axis = walk.numbers(element, "xyz", 3)
    if kind not in TYPES and kind != "planar":
        return {} if axis is None else {"urdf:axis": axis}
    x, y, z = axis or (1.0, 0.0, 0.0)
    length = math.sqrt(x * x + y * y + z * z)
    if abs(length - 1.0) <= 1e-9 or length == 0.0:
        return {"axis": (x, y, z)}
    return {"axis": (x / length, y / length, z / length), "urdf:axis length": length}


def _numbers(walk: Walk, joint: _Element, kind: str) -> dict[str, Value]:
    """Limits and losses; words of the format where they mean nothing to such a joint."""
    limit, dynamics = walk.first(joint, "limit"), walk.first(joint, "dynamics")
    limits = {name: walk.number(limit, name) for name in ("lower", "upper", "effort", "velocity")}
    said = {
        name: None if value is not None and abs(value) >= UNLIMITED else value
        for name, value in limits.items()
    }
    said |= {name: walk.number(dynamics, name) for name in ("damping", "friction")}
    stated: dict[str, Value] = {name: value for name, value in said.items() if value is not None}
    facts: dict[str, Value] = {}
    if kind in BOUNDED and limit is not None:
        for side in ("lower", "upper"):
            facts[side] = 0.0 if limits[side] is None else said[side]  # left out, it means 0
    meant = ("effort", "velocity", "damping", "friction") if kind in TYPES else ()
    facts |= {name: stated[name] for name in meant if name in stated}
    return facts | {
        f"urdf:{name}": value
        for name, value in stated.items()
        if name not in meant and not (kind in BOUNDED and name in ("lower", "upper"))
    }


def _mimic(walk: Walk, joint: _Element) -> dict[str, Value]:
    element = walk.first(joint, "mimic")
    if element is None:
        return {}
    multiplier, offset = walk.number(element, "multiplier"), walk.number(element, "offset")
    return {
        "mimics": walk.text(element, "joint") or "",
        "mimic multiplier": 1.0 if multiplier is None else multiplier,
        "mimic offset": offset or 0.0,
    }
