"""Default classes found in the data: what elements share is stated once.

Only what *every* member says is lifted, so a class never has to be contradicted; but for what
every member has (the axis of a joint, the type of a geom): there the class says that of most.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import TypeVar
from xml.etree.ElementTree import Element

from assetbuild.targets.mjcf.xml import element

T = TypeVar("T")
Said = Mapping[str, Mapping[str, str]]
"""Attributes by the tag of the element that says them, such as `joint` and `position`."""

FEWEST = 2
"""Members that share something at all."""
FAMILY_MEMBERS = 3
"""Fewest members of one size, place or axis that make a class worth its lines."""
VAGUE = frozenset({"joint", "joints", "link_visual", "link_collision", "link"})
"""Words that all names of a robot may share."""


@dataclass(frozen=True)
class Row:
    """A joint or geom: what its elements say beyond names, MuJoCo's defaults left out."""

    name: str
    attributes: Said


@dataclass(frozen=True)
class DefaultClass:
    """adds: what it says beyond the class above; rows: of those directly in it."""

    name: str
    adds: Said
    rows: Sequence[Row]
    children: Sequence[DefaultClass] = ()

    def element(self, first: Sequence[Element] = ()) -> Element:
        """`<default class>`; `first` stands before the classes below it."""
        elements = [element(tag, attributes) for tag, attributes in self.adds.items() if attributes]
        inner = [*elements, *first, *(child.element() for child in self.children)]
        return element("default", {"class": self.name}, inner)

    def uses(self, above: Said | None = None) -> dict[str, Use]:
        """The class of each member, and what is left to say for it, by its name."""
        inside = joined(above or {}, self.adds)
        uses = {}
        for row in self.rows:
            stated = row.attributes.items()
            left = {tag: _beyond(attributes, inside.get(tag, {})) for tag, attributes in stated}
            uses[row.name] = Use(self.name, left)
        for child in self.children:
            uses |= child.uses(inside)
        return uses


@dataclass(frozen=True)
class Use:
    """The class of a member and what its own elements still have to say."""

    class_name: str
    left: Said


def class_of(
    name: str, adds: Said, rows: Sequence[Row], children: Sequence[DefaultClass]
) -> DefaultClass:
    """A class with those of its rows that no class below it has."""
    below = {member for child in children for member in child.uses()}
    direct = [row for row in rows if row.name not in below]
    return DefaultClass(name, adds, direct, children)


class ClassNames:
    """Class names already given; `main` is MuJoCo's own."""

    def __init__(self) -> None:
        self._taken = {"main"}

    def __contains__(self, name: str) -> bool:
        return name in self._taken

    def take(self, wanted: str, first: str = "") -> str:
        """`wanted`; when that is taken or says nothing, the `first` member's name, else a number.

        A class `joint_1.0` for the joints 1, 5 and 9 of a hand says more than `joint_2` would.
        """
        if first and (wanted in self._taken or wanted in VAGUE):
            wanted = first
        name, count = wanted, 1
        while name in self._taken:
            count += 1
            name = f"{wanted}_{count}"
        self._taken.add(name)
        return name


def joined(above: Said, more: Said) -> Said:
    """What two classes say together."""
    return {tag: {**above.get(tag, {}), **more.get(tag, {})} for tag in {**above, **more}}


def shared(rows: Sequence[Row], above: Said) -> Said:
    """What all rows that have an element say alike, and nothing above says."""
    members = [row.attributes for row in rows]
    tags = dict.fromkeys(tag for member in members for tag in member)
    # MuJoCo keeps one actuator default per class whatever its tag: never mix tags in a class.
    mixed = len(tags.keys() - {"joint"}) > 1
    attributes = {}
    for tag in tags if len(members) >= FEWEST else ():
        first, *others = [member[tag] for member in members if tag in member]
        common = {k: v for k, v in first.items() if all(other.get(k) == v for other in others)}
        if (tag == "joint" or not mixed) and (left := _beyond(common, above.get(tag, {}))):
            attributes[tag] = left
    return attributes


def _beyond(stated: Mapping[str, str], above: Mapping[str, str]) -> dict[str, str]:
    return {key: value for key, value in stated.items() if above.get(key) != value}


def usual(rows: Sequence[Row], tag: str, key: str, *, most: bool = True) -> dict[str, str]:
    """The attribute as it stands on more than half of the rows (not `most`: on the largest part
    of them), where all have one: the others say theirs."""
    values = [row.attributes[tag][key] for row in rows if key in row.attributes[tag]]
    if not values or len(values) < len(rows):
        return {}
    value, count = Counter(values).most_common(1)[0]
    enough = count >= FAMILY_MEMBERS and (2 * count > len(rows) or not most)
    return {key: value} if enough else {}


def shared_words(wholes: Sequence[str]) -> str:
    """`thigh` for FR_thigh_joint, FL_thigh_joint, ...: the words at the end, else at the start."""
    names = [re.sub("(?i)_(joint|link)$", "", whole).split("_") for whole in wholes]
    tail = _leading([name[::-1] for name in names])[::-1]
    return "_".join(tail or _leading(names))


def _leading(names: Sequence[Sequence[str]]) -> list[str]:
    """The words with which all names begin."""
    alike = takewhile(lambda words: len(set(words)) == 1, zip(*names, strict=False))
    return [words[0] for words in alike]
