"""An exclude that holds for more than the source says is reported."""

from __future__ import annotations

import pytest

from assetbuild.control.only_mjcf import wider_excludes
from assetbuild.robot.model import Body, Joint, Tree
from assetbuild.robot.pose import IDENTITY
from assetbuild.robot.shapes import Shape, Shapes, Sphere
from assetbuild.robot.tree import merge_fixed_joints

NAMES = ("trunk", "thigh", "shank", "foot")
JOINTS = tuple(
    Joint(f"to_{child}", kind, parent, child, IDENTITY)
    for parent, child, kind in zip(
        NAMES, NAMES[1:], ("continuous", "continuous", "fixed"), strict=False
    )
)
LINKS = Tree("leg", "floating", tuple(map(Body, NAMES)), JOINTS)
SHAPES = Shapes(tuple(Shape(n, n, "collision", Sphere(0.1), IDENTITY, None) for n in NAMES))


@pytest.mark.parametrize(
    ("excludes", "merge", "lost"),
    [
        ([("shank", "trunk")], True, ["pair shank trunk"]),
        ([("shank", "trunk")], False, []),
        ([("shank", "trunk"), ("foot", "trunk")], True, []),
        ([("shank", "thigh")], True, []),
    ],
)
def test_what_no_longer_touches_is_reported(
    excludes: list[tuple[str, str]], merge: bool, lost: list[str]
):
    tree, _ = merge_fixed_joints(LINKS, merge, ())
    found = [(finding.rule, finding.subject) for finding in wider_excludes(excludes, tree, SHAPES)]
    assert found == [("mjcf.wider_exclude", pair) for pair in lost]
