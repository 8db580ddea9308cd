"""The geoms of a robot: visual in group 2 without contact, collision in group 3.

Classes say what geoms share, found in the data. `collision` (or `visual`) says what all its geoms
say alike, and the type and material of most. Below it stand a class for each other surface (feet,
mostly) and one for each size that three shapes or more have (all hips, all calves), with their
place where that is one and the same, or one for the pieces of a link that fixed joints put
elsewhere.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from xml.etree.ElementTree import Element

import numpy as np

from assetbuild.grouping import grouped
from assetbuild.robot.model import Contact, Control, Tree
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Mesh, Role, Shape, Shapes, Sphere
from assetbuild.targets.mjcf.classes import (
    FAMILY_MEMBERS,
    FEWEST,
    ClassNames,
    DefaultClass,
    Row,
    Use,
    class_of,
    shared,
    shared_words,
    usual,
)
from assetbuild.targets.mjcf.xml import element, number, numbers, pose_attributes

_PLACE = frozenset({"pos", "quat"})
_SURFACE = (
    "contype", "conaffinity", "condim", "priority", "friction", "solref", "solimp", "margin", "gap",
)  # fmt: skip
"""Fields of `Contact` are called as in MJCF; in Menagerie's order."""
_SURFACE_DEFAULTS: Mapping[str, str] = {"solref": "0.02 1", "solimp": "0.9 0.95 0.001 0.5 2"}


@dataclass(frozen=True)
class GeomRow(Row):
    """What the geom of a shape says beyond its name and mesh. link: that carries it."""

    link: str

    @property
    def stated(self) -> Mapping[str, str]:
        """The attributes of the geom."""
        return self.attributes["geom"]


def geom_classes(
    tree: Tree, shapes: Shapes, control: Control, roles: Mapping[str, str], names: ClassNames
) -> list[DefaultClass]:
    """The default classes of the roles that any shape has.

    roles: the class names of `visual` and `collision`, already taken from `names`.
    """
    hidden = {"type": "mesh", "contype": "0", "conaffinity": "0", "group": "2"}
    solid = {"group": "3", **_surface(control.contact, Contact())}
    fixed: Mapping[Role, Mapping[str, str]] = {"visual": hidden, "collision": solid}
    classes = []
    for role, always in fixed.items():
        rows = [
            _row(s, tree.shape_placement(s)[1], control.surface_of(s), control.contact)
            for s in shapes.of(role)
        ]
        if rows:
            classes.append(_role_class(roles[role], always, rows, names))
    return classes


def geom_element(shape: Shape, use: Use) -> Element:
    """One geom, with only what its class does not say."""
    left = dict(use.left["geom"])
    return element(
        "geom",
        {
            "name": shape.name,
            "class": use.class_name,
            "type": left.pop("type", None),
            "size": left.pop("size", None),
            "mesh": shape.geometry.mesh if isinstance(shape.geometry, Mesh) else None,
            **left,
        },
    )


def _row(shape: Shape, X_body_shape: Pose, contact: Contact, above: Contact) -> GeomRow:
    kind, size = _geometry(shape)
    attributes = {"type": kind, "size": size, **pose_attributes(X_body_shape)}
    if shape.role == "visual":
        attributes["material"] = shape.material or None
    else:
        attributes |= _surface(contact, above)
    stated = {key: value for key, value in attributes.items() if value is not None}
    return GeomRow(shape.name, {"geom": stated}, shape.link)


def _geometry(shape: Shape) -> tuple[str, str | None]:
    """(type, size): MJCF counts half edges and half lengths."""
    match shape.geometry:
        case Box(size):
            return "box", numbers(edge / 2 for edge in size)
        case Sphere(radius):
            return "sphere", number(radius)
        case Cylinder(radius, length):
            return "cylinder", numbers((radius, length / 2))
        case Capsule(radius, length):
            return "capsule", numbers((radius, length / 2))
        case Mesh():
            return "mesh", None


def _surface(contact: Contact, above: Contact) -> dict[str, str]:
    """What differs from the class above."""
    return {
        name: _SURFACE_DEFAULTS.get(name, "") if value is None else numbers(np.atleast_1d(value))
        for name in _SURFACE
        if (value := getattr(contact, name)) != getattr(above, name)
    }


def _role_class(
    name: str, fixed: Mapping[str, str], rows: Sequence[GeomRow], names: ClassNames
) -> DefaultClass:
    """The class of one role. fixed: what it says in any case (group, masks of visuals)."""
    common = {**fixed, **_shared(rows, fixed)}
    common |= usual(rows, "geom", "type") | usual(rows, "geom", "material", most=False)
    children, placed = list[DefaultClass](), set[str]()
    for key, least, suffix in (
        (_by_surface, FEWEST, ""),
        (_by_size, FAMILY_MEMBERS, f"_{name}"),
        (_by_place, FAMILY_MEMBERS, f"_{name}"),
    ):
        for what, group in grouped(rows, partial(key, common)).items():
            free = [row for row in group if row.name not in placed]
            attributes = _shared(free, common)
            if what is None or len(free) < least or not attributes:
                continue
            words = shared_words([row.link for row in free]) or "other"
            wanted = f"{words}_{name}" if words in names else f"{words}{suffix}"
            class_name = names.take(wanted, f"{free[0].link}_{name}")
            children.append(DefaultClass(class_name, {"geom": attributes}, free))
            placed.update(row.name for row in free)
    return class_of(name, {"geom": common}, rows, children)


def _shared(rows: Sequence[GeomRow], above: Mapping[str, str]) -> Mapping[str, str]:
    return shared(rows, {"geom": above}).get("geom", {})


def _by_surface(common: Mapping[str, str], row: GeomRow) -> Hashable:
    """What the surface says that not all say."""
    items = {item for item in row.stated.items() - common.items() if item[0] in _SURFACE}
    return frozenset(items) or None


def _by_size(common: Mapping[str, str], row: GeomRow) -> Hashable:
    items = {item for item in row.stated.items() - common.items() if item[0] not in _PLACE}
    return frozenset(items) if "size" in dict(items) else None


def _by_place(common: Mapping[str, str], row: GeomRow) -> Hashable:
    """The pieces of one link that stand in one place of its body, which is not the origin."""
    place = {item for item in row.stated.items() - common.items() if item[0] in _PLACE}
    return (row.link, frozenset(place)) if place else None
