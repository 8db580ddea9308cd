"""Mirrored joints: a turn is a pseudo-vector, which the rule must not forget."""

from __future__ import annotations

import pytest

from assetbuild.robot.model import Body, Joint, Limits, Tree
from assetbuild.robot.pose import Pose, Vec3
from assetbuild.steps._mirror_rule import mirror_findings

X, Y, MINUS_X, MINUS_Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)
BENDS, TURNED = (-0.5, 2.0), (-2.0, 0.5)


def pair(
    left: Vec3, right: Vec3, ranges: tuple[tuple[float, float], ...], names: tuple[str, str]
) -> Tree:
    joints = tuple(
        Joint(name, "revolute", "base", f"{name}_link", Pose((0.1, y, 0.0)), axis, Limits(*limits))
        for name, y, axis, limits in zip(names, (0.2, -0.2), (left, right), ranges, strict=True)
    )
    bodies = (Body("base"), *(Body(joint.child) for joint in joints))
    return Tree("pair", "floating", bodies, joints)


SIDES = ("left_knee", "right_knee")


@pytest.mark.parametrize(
    ("left", "right", "ranges", "wrong"),
    [
        (Y, Y, (BENDS, BENDS), False),  # knees
        (Y, MINUS_Y, (BENDS, BENDS), True),
        (Y, MINUS_Y, (BENDS, TURNED), False),
        (Y, Y, (BENDS, TURNED), True),
        (X, X, (BENDS, TURNED), False),  # hips that spread: x is turned the other way by a mirror
        (X, X, (BENDS, BENDS), True),
        (X, MINUS_X, (BENDS, BENDS), False),
        (Y, MINUS_Y, ((-1.0, 1.0), (-1.0, 1.0)), False),  # as far both ways: nothing to tell
        (Y, MINUS_Y, (BENDS, (-0.1, 0.7)), False),  # no mirror image of the other at all
        (Y, X, (BENDS, BENDS), False),
    ],
)
def test_ranges_belong_to_axes(left, right, ranges, wrong: bool):
    found = list(mirror_findings(pair(left, right, ranges, SIDES)))
    assert [f.subject for f in found] == (["joint right_knee"] if wrong else [])


@pytest.mark.parametrize(
    "names", [SIDES, ("knee_L", "knee_R"), ("FL_calf", "FR_calf"), ("LeftKnee", "RightKnee")]
)
def test_sides_are_known_by_many_names(names: tuple[str, str]):
    assert list(mirror_findings(pair(Y, MINUS_Y, (BENDS, BENDS), names)))


def test_joints_that_are_not_opposite_are_no_pair():
    tree = pair(Y, MINUS_Y, (BENDS, BENDS), ("upper_left", "lower_right"))
    assert list(mirror_findings(tree)) == []
