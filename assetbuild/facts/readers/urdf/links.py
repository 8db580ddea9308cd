"""Links of a URDF: mass properties, shapes, materials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from assetbuild.facts.readers.urdf.assets import Assets
from assetbuild.facts.table import Value, Writer
from assetbuild.facts.xml import Walk
from assetbuild.robot.pose import IDENTITY, Pose, normalised_quat, quat_of_rpy, vec3

if TYPE_CHECKING:
    from lxml.etree import _Element

ROLES = ("visual", "collision")
SIZES: Mapping[str, tuple[str, ...]] = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),  # URDF 1.2
}
"""Attributes of a primitive, in the order of the vocabulary's `size`."""


@dataclass(frozen=True)
class Material:
    """A look: facts of a shape that wears it, and where it is defined."""

    facts: Mapping[str, Value]
    where: str


class Links:
    """Reads all links into a table."""

    def __init__(self, walk: Walk, book: Writer, assets: Assets) -> None:
        self._walk, self._book, self._assets = walk, book, assets
        self._materials: dict[str, Material] = {}
        self._worn: set[str] = set()
        self._names: set[tuple[str, str]] = set()

    def read(self) -> None:
        """Bodies without their places, which the joints tell; shapes; unworn materials."""
        walk = self._walk
        for element in walk.all(walk.root, "material"):
            name = self.unique("material", walk.text(element, "name") or "")
            self._materials[name] = self._look(element)
        links = walk.all(walk.root, "link")
        for link in links:
            for visual in walk.all(link, "visual"):
                self._define(walk.first(visual, "material"))
        for link in links:
            self._link(link)
        for name, material in self._materials.items():
            if name not in self._worn:
                words = {f"urdf:{k.removeprefix('urdf:')}": v for k, v in material.facts.items()}
                self._book.put("material", name, words)
                self._book.place("material", name, material.where)

    def unique(self, kind: str, name: str) -> str:
        """The name; of a second subject of that name another one, which no robot has."""
        while (kind, name) in self._names:
            name += " (again)"
        self._names.add((kind, name))
        return name

    def _link(self, link: _Element) -> None:
        walk, book = self._walk, self._book
        name = self.unique("body", walk.text(link, "name") or "")
        book.place("body", name, walk.where(link))
        book.put("body", name, {"urdf:link": True, "parent": ""})
        book.put("body", name, self._inertial(link))
        for role in ROLES:
            for index, element in enumerate(walk.all(link, role)):
                said = f"{name}_{role}" + (f"_{index}" if index else "")
                stated = walk.text(element, "name")
                shape = self.unique("shape", stated or said)
                book.place("shape", shape, walk.where(element))
                book.put("shape", shape, {"role": role, "body": name, "urdf:name": stated})
                book.put("shape", shape, self._shape(element, role))

    def _inertial(self, link: _Element) -> dict[str, Value]:
        walk = self._walk
        inertial = walk.first(link, "inertial")
        if inertial is None:
            return {"mass": 0.0}
        pose = read_origin(walk, inertial)
        mass = walk.number(walk.first(inertial, "mass"), "value")
        facts: dict[str, Value] = {"mass": mass or 0.0, "centre of mass": pose.xyz}
        if pose.quat != IDENTITY.quat:  # which the tensor of a ball does not show
            facts["urdf:inertial axes"] = pose.quat
        element = walk.first(inertial, "inertia")
        said = [walk.number(element, f"i{axes}") for axes in ("xx", "yy", "zz", "xy", "xz", "yz")]
        if element is not None:
            xx, yy, zz, xy, xz, yz = (value or 0.0 for value in said)
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            if None in said:  # which urdfdom refuses
                facts["urdf:inertia"] = "with fewer than six numbers"
            turned = pose.rotation @ tensor @ pose.rotation.T
            at = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
            facts["inertia"] = tuple(float(turned[i]) for i in at)
        return facts

    def _shape(self, element: _Element, role: str) -> dict[str, Value]:
        walk = self._walk
        pose = read_origin(walk, element)
        facts: dict[str, Value] = {}
        geometry = walk.first(element, "geometry")
        found = None if geometry is None else next(geometry.iterchildren("*"), None)
        tag = "" if found is None else str(found.tag)
        if geometry is not None and tag in SIZES:
            found = walk.first(geometry, tag)
            sizes = [walk.numbers(found, name) or () for name in SIZES[tag]]
            place = (*pose.xyz, *pose.quat)
            facts = {"geometry": tag, "size": tuple(n for s in sizes for n in s), "pose": place}
        elif geometry is not None and tag == "mesh":
            found = walk.first(geometry, tag)
            stated = (walk.text(found, "filename") or "").strip()
            one = walk.number(found, "scale")  # which counts for all axes
            scale = walk.numbers(found, "scale", 3) if one is None else (one, one, one)
            scale = scale or (1.0, 1.0, 1.0)
            facts = self._assets.mesh_facts(stated, scale, pose)
            if role == "visual":  # who reads collision shapes knows no materials
                facts |= self._assets.mesh_looks(stated)
        return facts | self._wears(walk.first(element, "material"))

    # --- materials --------------------------------------------------------------------------

    def _look(self, element: _Element) -> Material:
        walk = self._walk
        facts: dict[str, Value] = {}
        rgba = walk.numbers(walk.first(element, "color"), "rgba")
        texture = (walk.text(walk.first(element, "texture"), "filename") or "").strip()
        if texture:
            facts = {"rgba": (1.0, 1.0, 1.0, 1.0)}  # a texture alone is shown as it is
            facts |= self._assets.picture(texture)
        if rgba is not None:
            facts["rgba"] = rgba
        return Material(facts, walk.where(element))

    def _define(self, element: _Element | None) -> None:
        """A look inside a visual is known to all others by its name."""
        if element is None:
            return
        name, look = self._walk.text(element, "name"), self._look(element)
        if name and look.facts and name not in self._materials:
            self._materials[name] = look

    def _wears(self, element: _Element | None) -> dict[str, Value]:
        if element is None:
            return {}
        name, look = self._walk.text(element, "name") or "", self._look(element)
        self._worn.add(name)
        if not look.facts and name in self._materials:
            look = self._materials[name]
        return {"material": name, **look.facts}


def read_origin(walk: Walk, parent: _Element) -> Pose:
    """The pose of `<origin>`: m, and roll, pitch, yaw in rad about fixed axes.

    `quat_xyzw` is the rotation in URDF 1.1 and 1.2 where no `rpy` is stated; else it is unread.
    """
    origin = walk.first(parent, "origin")
    xyz = walk.numbers(origin, "xyz", 3) or (0.0, 0.0, 0.0)
    rpy = walk.numbers(origin, "rpy", 3)
    if rpy is None and walk.root.get("version", "1.0").strip() in ("1.1", "1.2"):
        x, y, z, w = walk.numbers(origin, "quat_xyzw", 4) or (0.0, 0.0, 0.0, 1.0)
        if x or y or z or w:
            return Pose(vec3(xyz), normalised_quat((w, x, y, z)))
    roll, pitch, yaw = rpy or (0.0, 0.0, 0.0)
    return Pose(vec3(xyz), quat_of_rpy(roll, pitch, yaw))
