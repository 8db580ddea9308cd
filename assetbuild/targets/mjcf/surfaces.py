"""Geoms of one role and the classes that say what they share, found in the data.

`collision` (or `visual`) says what all its geoms say alike, and the type and material of most.
Below it stand a class for each other surface (feet, mostly) and one for each size that three shapes
or more have (all hips, all calves), with their place where that is one and the same, or one for the
pieces of a link that fixed joints put elsewhere.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from assetbuild.robot.model import Contact, Shape
from assetbuild.targets.mjcf.classes import Names, shared_words
from assetbuild.targets.mjcf.xml import Element, element, numbers

SURFACE_MEMBERS = 2
SIZE_MEMBERS = 3
"""Fewest shapes that make a class worth its lines."""
_PLACE = frozenset({"pos", "quat"})


@dataclass(frozen=True)
class GeomClass:
    """A default class of geoms: what it adds to the class above, and who is in it directly."""

    name: str
    attributes: Mapping[str, str]
    children: tuple[GeomClass, ...] = ()
    members: frozenset[str] = frozenset()

    def element(self) -> Element:
        """`<default class>` with the classes below it."""
        own = [element("geom", self.attributes)] if self.attributes else []
        inner = [*own, *(child.element() for child in self.children)]
        return element("default", {"class": self.name}, inner)


@dataclass(frozen=True)
class GeomUse:
    """What is left to say on one geom: its class and its own attributes."""

    class_name: str
    attributes: Mapping[str, str]


@dataclass(frozen=True)
class GeomRow:
    """A shape and what its geom says beyond its name, place and mesh."""

    shape: Shape
    attributes: Mapping[str, str]
    surface: Mapping[str, str] = field(default_factory=dict)

    @property
    def said(self) -> dict[str, str]:
        """All of it."""
        return {**self.attributes, **self.surface}


def surface_attributes(contact: Contact, above: Contact) -> dict[str, str]:
    """What differs from the class above, in Menagerie's order."""
    return {
        attribute: _SURFACE_DEFAULTS.get(name, "") if value is None else numbers(_listed(value))
        for name, attribute in _SURFACE.items()
        if (value := getattr(contact, name)) != getattr(above, name)
    }


def _listed(value: float | Sequence[float]) -> Sequence[float]:
    return (value,) if isinstance(value, int | float) else value


_SURFACE: Mapping[str, str] = {
    "mask": "contype",
    "partners": "conaffinity",
    "condim": "condim",
    "priority": "priority",
    "friction": "friction",
    "solref": "solref",
    "solimp": "solimp",
    "margin": "margin",
    "gap": "gap",
}
"""Attribute in MJCF by field of `Contact`."""
_SURFACE_DEFAULTS: Mapping[str, str] = {"solref": "0.02 1", "solimp": "0.9 0.95 0.001 0.5 2"}


def find_geom_classes(
    name: str, fixed: Mapping[str, str], rows: Sequence[GeomRow], names: Names
) -> GeomClass:
    """The class of one role. fixed: what it says in any case (group, masks of visuals)."""
    common = {**fixed, **_shared(rows, fixed), **_usual(rows)}
    children, placed = [], set[str]()
    for members, least, suffix in [
        *((group, SURFACE_MEMBERS, "") for group in _by_surface(rows, common)),
        *((group, SIZE_MEMBERS, f"_{name}") for group in _by_size(rows, common)),
        *((group, SIZE_MEMBERS, f"_{name}") for group in _by_place(rows, common)),
    ]:
        free = [row for row in members if row.shape.name not in placed]
        own = _shared(free, common)
        if len(free) < least or not own:
            continue
        words = shared_words([row.shape.link for row in free]) or "other"
        wanted = f"{words}_{name}" if words in names else f"{words}{suffix}"
        placed |= {row.shape.name for row in free}
        members_of = frozenset(row.shape.name for row in free)
        class_name = names.take(wanted, f"{free[0].shape.link}_{name}")
        children.append(GeomClass(class_name, own, (), members_of))
    rest = frozenset(row.shape.name for row in rows if row.shape.name not in placed)
    return GeomClass(name, common, tuple(children), rest)


def geom_uses(role: GeomClass, rows: Sequence[GeomRow]) -> dict[str, GeomUse]:
    """Class and remaining attributes by shape name."""
    class_of = {name: child for child in role.children for name in child.members}
    found = {}
    for row in rows:
        child = class_of.get(row.shape.name)
        said = {**role.attributes, **(child.attributes if child else {})}
        left = {k: v for k, v in row.said.items() if said.get(k) != v}
        found[row.shape.name] = GeomUse(child.name if child else role.name, left)
    return found


def _shared(rows: Sequence[GeomRow], said: Mapping[str, str]) -> dict[str, str]:
    """Attributes that all rows say alike and nothing above says."""
    if len(rows) < SURFACE_MEMBERS:
        return {}
    first = rows[0].said
    return {
        k: v
        for k, v in first.items()
        if said.get(k) != v and all(row.said.get(k) == v for row in rows)
    }


def _usual(rows: Sequence[GeomRow]) -> dict[str, str]:
    """The type and material of most shapes, where all have one: the others say theirs."""
    found = {}
    for key in ("type", "material"):
        worn = [row.said[key] for row in rows if key in row.said]
        if worn and len(worn) == len(rows):
            value, count = Counter(worn).most_common(1)[0]
            if count >= SIZE_MEMBERS and (key == "material" or 2 * count > len(rows)):
                found[key] = value
    return found


def _by_surface(rows: Sequence[GeomRow], common: Mapping[str, str]) -> list[list[GeomRow]]:
    """Groups of shapes whose surface says something that not all say."""
    found: dict[frozenset[tuple[str, str]], list[GeomRow]] = {}
    for row in rows:
        own = frozenset((k, v) for k, v in row.surface.items() if common.get(k) != v)
        if own:
            found.setdefault(own, []).append(row)
    return list(found.values())


def _by_size(rows: Sequence[GeomRow], common: Mapping[str, str]) -> list[list[GeomRow]]:
    found: dict[frozenset[tuple[str, str]], list[GeomRow]] = {}
    for row in rows:
        own = frozenset(
            (k, v) for k, v in row.said.items() if common.get(k) != v and k not in _PLACE
        )
        if any(key == "size" for key, _ in own):
            found.setdefault(own, []).append(row)
    return list(found.values())


def _by_place(rows: Sequence[GeomRow], common: Mapping[str, str]) -> list[list[GeomRow]]:
    """The pieces of one link that stand in one place of its body, which is not the origin."""
    found: dict[tuple[str, frozenset[tuple[str, str]]], list[GeomRow]] = {}
    for row in rows:
        place = frozenset((k, v) for k, v in row.said.items() if k in _PLACE and common.get(k) != v)
        if place:
            found.setdefault((row.shape.link, place), []).append(row)
    return list(found.values())
