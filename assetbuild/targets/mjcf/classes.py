"""Default classes found in the data: what joints and drives share is said once.

Three levels: the robot (what all joints share), its motors (what all joints with one motor, gains
and limits share), and families (joints of one motor with one axis and range: all hips). Only
what *every* member says is lifted, so a class never has to be contradicted; but for the axis, which
every joint has: the robot's class says that of most joints, as Menagerie's do.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from assetbuild.targets.mjcf.drives import PLACING, Drive, Row
from assetbuild.targets.mjcf.xml import Element, element

MOTOR_MEMBERS = 2
FAMILY_MEMBERS = 3
"""Fewest members that make a class worth its lines."""
VAGUE = frozenset({"joint", "joints", "link_visual", "link_collision", "link"})
"""Words that all names of a robot may share."""


@dataclass(frozen=True)
class Defaults:
    """One default class. joint, drive: what it adds to its parent; rows: its direct members."""

    name: str
    joint: Mapping[str, str] = field(default_factory=dict)
    drive: Drive | None = None
    children: tuple[Defaults, ...] = ()
    rows: tuple[Row, ...] = ()

    def element(self, first: tuple[Element, ...] = ()) -> Element:
        """`<default class>`; `first` stands before the classes of the motors."""
        own = [element("joint", self.joint)] if self.joint else []
        if self.drive and self.drive.attributes:
            own.append(element(self.drive.tag, self.drive.attributes))
        inner = [*own, *first, *(child.element() for child in self.children)]
        return element("default", {"class": self.name}, inner)


@dataclass(frozen=True)
class Use:
    """What is left to say on the elements of one joint."""

    class_name: str
    joint: Mapping[str, str]
    drive: Drive | None


class Names:
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


def find_defaults(robot: str, rows: tuple[Row, ...], names: Names) -> Defaults:
    """The class of the robot with those of its motors and families below it.

    robot: name of the class, already taken from `names`.
    """
    levels: tuple[_Level, ...] = (
        _Level(_motor_key, MOTOR_MEMBERS, _motor_name),
        _Level(_family_key, FAMILY_MEMBERS, _family_name),
    )
    axis = _usual_axis(rows)
    found = _defaults(robot, rows, _Said(axis, {}), levels, names)
    return replace(found, joint={**axis, **found.joint})


def _usual_axis(rows: tuple[Row, ...]) -> dict[str, str]:
    """Of more than half of the joints: every joint has one, so the others say theirs."""
    axes = Counter(row.attributes["axis"] for row in rows)
    axis, count = axes.most_common(1)[0] if axes else ("", 0)
    return {"axis": axis} if count >= FAMILY_MEMBERS and 2 * count > len(rows) else {}


def uses(defaults: Defaults) -> dict[str, Use]:
    """What remains for the elements of each joint, by joint name."""
    return {row.joint.name: use for row, use in _uses(defaults, _Said({}, {}))}


@dataclass(frozen=True)
class _Level:
    key: Callable[[Row], Hashable]
    members: int
    name: Callable[[tuple[Row, ...]], str]


@dataclass(frozen=True)
class _Said:
    """What the classes above already say."""

    joint: Mapping[str, str]
    drive: Mapping[str, str]

    def plus(self, joint: Mapping[str, str], drive: Drive | None) -> _Said:
        return _Said({**self.joint, **joint}, {**self.drive, **(drive.attributes if drive else {})})


def _defaults(
    name: str, rows: tuple[Row, ...], said: _Said, levels: tuple[_Level, ...], names: Names
) -> Defaults:
    joint, drive = _shared(rows, said)
    inside = said.plus(joint, drive)
    children: list[Defaults] = []
    direct = list(rows)
    for level in levels[:1]:
        for group in _groups(rows, level.key):
            if len(group) < level.members or not _worth_a_class(group, inside, levels[1:]):
                continue
            child_name = names.take(level.name(group), group[0].joint.name)
            children.append(_defaults(child_name, group, inside, levels[1:], names))
            direct = [row for row in direct if row not in group]
    return Defaults(name, joint, drive, tuple(children), tuple(direct))


def _worth_a_class(rows: tuple[Row, ...], said: _Said, levels: tuple[_Level, ...]) -> bool:
    joint, drive = _shared(rows, said)
    if joint or drive:
        return True
    return any(
        len(group) >= level.members and _worth_a_class(group, said, ())
        for level in levels
        for group in _groups(rows, level.key)
    )


def _shared(rows: tuple[Row, ...], said: _Said) -> tuple[dict[str, str], Drive | None]:
    """Attributes that all rows say alike and nothing above says."""
    if len(rows) < MOTOR_MEMBERS:
        return {}, None
    joint = _common([row.attributes for row in rows], said.joint)
    drives = [row.drive for row in rows if row.drive]
    # MuJoCo keeps one actuator default per class whatever its tag: never mix tags in a class.
    if len({drive.tag for drive in drives}) != 1:
        return joint, None
    attributes = _common([drive.attributes for drive in drives], said.drive)
    return joint, Drive(drives[0].tag, attributes) if attributes else None


def _common(each: list[Mapping[str, str]], said: Mapping[str, str]) -> dict[str, str]:
    first = each[0]
    return {
        key: value
        for key, value in first.items()
        if said.get(key) != value and all(other.get(key) == value for other in each)
    }


def _uses(defaults: Defaults, said: _Said) -> Iterator[tuple[Row, Use]]:
    inside = said.plus(defaults.joint, defaults.drive)
    for row in defaults.rows:
        joint = {k: v for k, v in row.attributes.items() if inside.joint.get(k) != v}
        drive = row.drive and Drive(
            row.drive.tag,
            {k: v for k, v in row.drive.attributes.items() if inside.drive.get(k) != v},
        )
        yield row, Use(defaults.name, joint, drive)
    for child in defaults.children:
        yield from _uses(child, inside)


def _groups(rows: tuple[Row, ...], key: Callable[[Row], Hashable]) -> list[tuple[Row, ...]]:
    """Rows with equal keys, in order of first appearance."""
    found: dict[Hashable, list[Row]] = {}
    for row in rows:
        found.setdefault(key(row), []).append(row)
    return [tuple(group) for group in found.values()]


def _motor_key(row: Row) -> Hashable:
    drive = row.drive.attributes if row.drive else {}
    return (
        row.motor,
        row.drive.tag if row.drive else "",
        frozenset(i for i in row.attributes.items() if i[0] not in PLACING),
        frozenset(i for i in drive.items() if i[0] not in PLACING),
    )


def _family_key(row: Row) -> Hashable:
    drive = row.drive.attributes if row.drive else {}
    return (
        frozenset(i for i in row.attributes.items() if i[0] in PLACING),
        frozenset(i for i in drive.items() if i[0] in PLACING),
    )


def _motor_name(rows: tuple[Row, ...]) -> str:
    return rows[0].motor or _shared_words(rows) or (rows[0].drive.tag if rows[0].drive else "free")


def _family_name(rows: tuple[Row, ...]) -> str:
    return _shared_words(rows) or "joints"


def _shared_words(rows: tuple[Row, ...]) -> str:
    return shared_words([row.joint.name.removesuffix("_joint") for row in rows])


def shared_words(wholes: Sequence[str]) -> str:
    """`thigh` for FR_thigh, FL_thigh, ...: the words at the end, else at the start."""
    names = [whole.split("_") for whole in wholes]
    tail: list[str] = []
    for words in zip(*(reversed(name) for name in names), strict=False):
        if len(set(words)) != 1:
            break
        tail.insert(0, words[0])
    head: list[str] = []
    for words in zip(*names, strict=False):
        if len(set(words)) != 1:
            break
        head.append(words[0])
    return "_".join(tail or head)
