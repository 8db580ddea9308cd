"""The classes of joints and drives: the robot, its motors, and their families.

Three levels: the robot (what all joints share), its motors (what all joints with one motor, gains
and limits share), and families (joints of one motor with one axis and range: all hips).
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence

from assetbuild.targets.mjcf.classes import (
    FAMILY_MEMBERS,
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
    adds = joined(axis, _shared(rows, axis))
    motors = [_motor_class(group, adds, names) for group in grouped(rows, _motor_key)]
    return _class(robot, adds, rows, [motor for motor in motors if motor is not None])


def _motor_class(rows: Sequence[JointRow], above: Said, names: ClassNames) -> DefaultClass | None:
    """The class of the joints with one motor, with its families; None: they share nothing."""
    adds = _shared(rows, above)
    inside = joined(above, adds)
    families = [
        (group, own)
        for group in grouped(rows, _family_key)
        if len(group) >= FAMILY_MEMBERS and (own := _shared(group, inside))
    ]
    if not adds and not families:
        return None
    first = rows[0]
    wanted = first.motor or _shared_words(rows) or first.drive or "free"
    name = names.take(wanted, first.joint.name)
    children = []
    for group, own in families:
        family = names.take(_shared_words(group) or "joints", group[0].joint.name)
        children.append(_class(family, own, group, ()))
    return _class(name, adds, rows, children)


def _class(
    name: str, adds: Said, rows: Sequence[JointRow], children: Sequence[DefaultClass]
) -> DefaultClass:
    below = {member for child in children for member in child.all_members}
    direct = tuple(row.joint.name for row in rows if row.joint.name not in below)
    return DefaultClass(name, adds, direct, tuple(children))


def _shared(rows: Sequence[JointRow], above: Said) -> Said:
    return shared([row.said for row in rows], above)


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


def _shared_words(rows: Sequence[JointRow]) -> str:
    return shared_words([row.joint.name.removesuffix("_joint") for row in rows])
