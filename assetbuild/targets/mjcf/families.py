"""The classes of joints and drives: the robot, its motors, and their families.

Three levels: the robot (what all joints share), its motors (what all joints with one motor, gains
and limits share), and families (joints of one motor with one axis and range: all hips).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace

from assetbuild.targets.mjcf.classes import (
    FAMILY_MEMBERS,
    FEWEST,
    ClassNames,
    DefaultClass,
    Said,
    grouped,
    joined,
    shared,
    shared_words,
    usual,
)
from assetbuild.targets.mjcf.drives import PLACING, JointRow


def joint_classes(robot: str, rows: Sequence[JointRow], names: ClassNames) -> DefaultClass:
    """The class of the robot with those of its motors and families below it.

    robot: name of the class, already taken from `names`.
    """
    axis = {"joint": usual([row.said["joint"] for row in rows], "axis")}
    found = _class(robot, rows, axis, _LEVELS, names)
    return replace(found, adds=joined(axis, found.adds))


def _motor_key(row: JointRow) -> Hashable:
    return row.motor, row.drive, _said(row, placing=False)


def _family_key(row: JointRow) -> Hashable:
    return _said(row, placing=True)


def _said(row: JointRow, *, placing: bool) -> frozenset[tuple[str, str, str]]:
    """(tag, attribute, value) of all that says where the joint is, or of all that does not."""
    return frozenset(
        (tag, key, value)
        for tag, said in row.said.items()
        for key, value in said.items()
        if (key in PLACING) == placing
    )


def _motor_name(rows: Sequence[JointRow]) -> str:
    return rows[0].motor or _shared_words(rows) or rows[0].drive or "free"


def _family_name(rows: Sequence[JointRow]) -> str:
    return _shared_words(rows) or "joints"


def _shared_words(rows: Sequence[JointRow]) -> str:
    return shared_words([row.joint.name.removesuffix("_joint") for row in rows])


@dataclass(frozen=True)
class _Level:
    """members: fewest that make a class of this level."""

    key: Callable[[JointRow], Hashable]
    members: int
    name: Callable[[Sequence[JointRow]], str]

    def groups(self, rows: Sequence[JointRow]) -> list[list[JointRow]]:
        return [group for group in grouped(rows, self.key) if len(group) >= self.members]


_LEVELS = (
    _Level(_motor_key, FEWEST, _motor_name),
    _Level(_family_key, FAMILY_MEMBERS, _family_name),
)


def _class(
    name: str, rows: Sequence[JointRow], above: Said, levels: Sequence[_Level], names: ClassNames
) -> DefaultClass:
    adds = shared([row.said for row in rows], above)
    inside = joined(above, adds)
    children: list[DefaultClass] = []
    direct = list(rows)
    for level in levels[:1]:
        for group in level.groups(rows):
            if _is_worth_a_class(group, inside, levels[1:]):
                child_name = names.take(level.name(group), group[0].joint.name)
                children.append(_class(child_name, group, inside, levels[1:], names))
                direct = [row for row in direct if row not in group]
    return DefaultClass(name, adds, tuple(row.joint.name for row in direct), tuple(children))


def _is_worth_a_class(rows: Sequence[JointRow], above: Said, levels: Sequence[_Level]) -> bool:
    return bool(shared([row.said for row in rows], above)) or any(
        _is_worth_a_class(group, above, ()) for level in levels for group in level.groups(rows)
    )
