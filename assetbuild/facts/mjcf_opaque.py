"""What only the source's MJCF says of a robot: readers pass it over.

The check `mjcf_source` proves it, by the compiled models of the source and of ours.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Key, pair_name
from assetbuild.robot.model import MjcfOnly
from assetbuild.simulators.mujoco import body_names

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

OWNERS = {"joint": "joint", "shape": "shape", "frame": "frame", "camera": "camera",
          "body": "body", "root": "body", "drive": "joint", "mimic": "joint",
          "option": "simulation"}  # fmt: skip
"""Place of `MjcfOnly` whose attributes belong on an element of the robot -> its kind."""
KINDS = {"geom": "shape", "site": "frame", "pair": "contact pair", "camera": "camera"}
"""Tag of an element of its own -> kind of subject, where its section does not say it."""
SECTIONS = frozenset({"contact", "equality", "tendon", "actuator", "sensor"})
UNNAMED = re.compile(r"(geom|site|camera|pair|equality|tendon|actuator|sensor) \d+")
MEANS: Mapping[str, tuple[str, ...]] = {
    "ctrlrange": ("command range",), "inheritrange": ("command range",),
    "ctrllimited": ("command range",), "resolution": ("resolution",),
    "polycoef": ("mimic multiplier", "mimic offset"),
    "stiffness": ("stiffness", "spring reference"), "springref": ("spring reference",),
    "damping": ("damping",), "frictionloss": ("friction",), "armature": ("armature",),
    "range": ("lower", "upper"), "group": ("role",), "rgba": ("rgba",), "mode": ("tracking",),
    "gear": ("gear", "kp", "kd", "effort"), "pos": ("pose",), "quat": ("pose",),
    "ls_iterations": ("line search iterations",),
}  # fmt: skip
"""Attribute that only MJCF says -> quantities of its owner, where they are not called as it is."""


@dataclass(frozen=True)
class Opaque:
    """subjects: elements of its own; owners: of the robot's, those with such attributes.

    touched: quantities that these attributes change.
    """

    subjects: frozenset[tuple[str, str]] = frozenset()
    owners: frozenset[tuple[str, str]] = frozenset()
    touched: frozenset[Key] = frozenset()

    def says(self, key: Key) -> bool:
        """Whether the source's MJCF says this rather than the robot."""
        subject = (key.kind, key.name)
        unnamed = bool(self.subjects) and UNNAMED.fullmatch(key.name) is not None
        owned = key.is_foreign and subject in self.owners
        return unnamed or owned or subject in self.subjects or key in self.touched


def opaque_of(reference: Reference) -> Opaque:
    """What `MjcfOnly` of the robot says."""
    from defusedxml.ElementTree import fromstring

    subjects, owners, touched = set[tuple[str, str]](), set[tuple[str, str]](), set[Key]()
    control, names = reference.control, body_names(reference.tree)
    for item in control.mjcf_only:
        element = fromstring(item.element)
        if item.place in SECTIONS or (item.place == "body" and element.tag != "body"):
            subjects.add(_subject(item, element, names))
        elif item.place == "keyframe":
            touched |= set(_commands(item.owner, reference))
        elif item.place == "freejoint":
            owners.add(("joint", element.get("name", "floating_base_joint")))
        elif kind := OWNERS.get(item.place):
            name = names.get(item.owner, item.owner) if kind == "body" else item.owner
            owners |= {(kind, name)} | ({("equality", name)} if item.place == "mimic" else set())
            owners.add(("equality", element.get("name", name)))
            for word in element.attrib:
                touched |= {Key(kind, name, q) for q in MEANS.get(word, (word,))}
    return Opaque(frozenset(subjects), frozenset(owners), frozenset(touched))


def _subject(item: MjcfOnly, element: Element, names: Mapping[str, str]) -> tuple[str, str]:
    """(kind, name) of an element of its own."""
    if element.tag == "exclude":
        ends = (element.get(side, "") for side in ("body1", "body2"))
        return "pair", pair_name(*(names.get(end, end) for end in ends))
    return KINDS.get(element.tag, item.place), element.get("name", "")


def _commands(keyframe: str, reference: Reference) -> Iterator[Key]:
    for row in reference.control.actuators:
        yield Key("keyframe", f"{keyframe}/{row.joint}", "target")
