"""Mirrored parts: a turn is a pseudo-vector, and real robots are never quite symmetric."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from robot_files import ranked, run_step
from urdfs import read

from assetbuild.body.merge_fixed_joints import MergeFixedJoints
from assetbuild.findings import Finding
from assetbuild.robot.codec import decode
from assetbuild.robot.mirror import Tolerances, mirror_findings
from assetbuild.robot.model import (
    Actuator,
    Body,
    Control,
    Inertial,
    Joint,
    JointKind,
    Keyframe,
    Limits,
    Tree,
)
from assetbuild.robot.pose import Pose, Vec3
from assetbuild.robot.twins import other_side, twins

X, Y, MINUS_X, MINUS_Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)
BENDS, TURNED, WIDE = (-0.5, 2.0), (-2.0, 0.5), (-1.0, 1.0)
SIDES = ("left_knee", "right_knee")
LEFT = Inertial(2.0, (0.0, 0.1, -0.1), (0.02, 0.03, 0.01, 0.004, 0.0, 0.002))
RIGHT = Inertial(2.0, (0.0, -0.1, -0.1), (0.02, 0.03, 0.01, -0.004, 0.0, -0.002))
"""y turned round: the centre and the products with one y change sign."""


def pair(
    axes: tuple[Vec3, Vec3] = (Y, Y),
    ranges: tuple[tuple[float, float], tuple[float, float]] = (BENDS, BENDS),
    names: tuple[str, str] = SIDES,
    right: Inertial = RIGHT,
    kind: JointKind = "revolute",
    places: tuple[Vec3, Vec3] = ((0.1, 0.2, 0.0), (0.1, -0.2, 0.0)),
) -> Tree:
    joints = tuple(
        Joint(name, kind, "base", f"{name}_link", Pose(place), axis, Limits(*limits))
        for name, place, axis, limits in zip(names, places, axes, ranges, strict=True)
    )
    bodies = [Body(f"{name}_link", i) for name, i in zip(names, (LEFT, right), strict=True)]
    return Tree("pair", "floating", (Body("base"), *bodies), joints)


def told(tree: Tree, control: Control | None = None) -> list[Finding]:
    return list(mirror_findings(twins(tree, control or Control()), Tolerances()))


SLIP, OTHER = [("mirror.limits", "warning")], [("mirror.limits", "info")]


@pytest.mark.parametrize(
    ("left", "right", "ranges", "expected"),
    [
        (Y, Y, (BENDS, BENDS), []),  # knees
        (Y, MINUS_Y, (BENDS, BENDS), SLIP),
        (Y, MINUS_Y, (BENDS, TURNED), []),
        (Y, Y, (BENDS, TURNED), SLIP),
        (X, X, (BENDS, TURNED), []),  # hips that spread: x is turned the other way by a mirror
        (X, X, (BENDS, BENDS), SLIP),
        (X, MINUS_X, (BENDS, BENDS), []),
        (Y, MINUS_Y, (WIDE, WIDE), []),  # as far both ways: nothing to tell
        (Y, MINUS_Y, (BENDS, (-0.1, 0.7)), OTHER),  # no mirror image of the other at all
        (Y, X, (BENDS, BENDS), [("mirror.axes", "info")]),
    ],
)
def test_ranges_belong_to_axes(left, right, ranges, expected):
    assert ranked(told(pair((left, right), ranges))) == expected


def test_fingers_that_slide_apart_are_twins():
    """A slide is a true vector: +y on the left is -y on the right."""
    ranges = ((0.0, 0.04), (0.0, 0.04))
    assert told(pair((Y, MINUS_Y), ranges, kind="prismatic")) == []
    assert ranked(told(pair((Y, Y), ranges, kind="prismatic"))) == SLIP


@pytest.mark.parametrize(
    ("right", "expected"),
    [
        (replace(RIGHT, mass_kg=2.1), [("mirror.mass", "info")]),
        (replace(RIGHT, mass_kg=20.0), [("mirror.mass", "warning")]),
        (replace(RIGHT, com_m=LEFT.com_m), [("mirror.center", "info")]),
        (replace(RIGHT, inertia_com_kg_m2=LEFT.inertia_com_kg_m2), [("mirror.inertia", "info")]),
        (replace(RIGHT, inertia_com_kg_m2=(2.0, 3.0, 1.0, 0.0, 0.0, 0.0)),
         [("mirror.inertia", "warning")]),
    ],
)  # fmt: skip
def test_mass_and_inertia_are_mirrored(right: Inertial, expected):
    assert ranked(told(pair(right=right))) == expected


def control(home: tuple[float, float], *kps: float) -> Control:
    drives = tuple(Actuator(n, "pd", kp=kp) for n, kp in zip(SIDES, kps or (9.0, 9.0), strict=True))
    key = Keyframe("home", tuple(zip(SIDES, home, strict=True)))
    return Control(drives, (key,))


@pytest.mark.parametrize(
    ("home", "expected"),
    [
        ((0.4, -0.4), []),
        ((0.4, 0.4), [("mirror.home", "warning")]),
        ((0.4, -0.3), [("mirror.home", "info")]),
        ((0.007, 0.007), [("mirror.home", "info")]),  # 0.4 degrees
    ],
)
def test_the_first_pose_is_mirrored(home: tuple[float, float], expected):
    assert ranked(told(pair((X, X), (WIDE, WIDE)), control(home))) == expected


@pytest.mark.parametrize(
    ("kps", "expected"),
    [
        ((80.0, 80.5), []),
        ((80.0, 100.0), [("mirror.gains", "info")]),
        ((80.0, 1.4), [("mirror.gains", "warning")]),
        ((80.0, 0.0), [("mirror.gains", "warning")]),
    ],
)
def test_drives_are_equal(kps: tuple[float, float], expected):
    assert ranked(told(pair(), control((0.0, 0.0), *kps))) == expected


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("left_knee", "right_knee"),
        ("knee_L", "knee_R"),
        ("FL_calf", "FR_calf"),
        ("LH_KFE", "RH_KFE"),
        ("LeftKnee", "RightKnee"),
        ("LHipYaw", "RHipYaw"),
        ("arm_l_elbow", "arm_r_elbow"),
    ],
)
def test_sides_are_known_by_many_names(left: str, right: str):
    assert other_side(left, {left, right, "trunk"}) == right
    assert other_side(right, {left, right, "trunk"}) == ""
    assert told(pair(ranges=(BENDS, TURNED), names=(left, right)))


def test_parts_that_are_not_opposite_are_no_twins():
    beside = ((0.1, 0.2, 0.0), (0.1, 0.1, 0.0))
    assert told(pair((Y, MINUS_Y), places=beside)) == []


# --- robots that people use -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("file", "pairs"),
    [("go1_description/urdf/go1.urdf", 6), ("talos_data/robots/talos_full_v2.urdf", 18)],
)
def test_real_robots_are_compared_and_nobody_cries_wolf(
    file: str, pairs: int, go1_root: Path, tmp_path: Path
):
    text = (go1_root / "robots" / file).read_text()
    packages = dict.fromkeys(re.findall(r"package:/*([\w.-]+)", text), ".")
    read(text, tmp_path, packages=packages)
    run_step(MergeFixedJoints(merge=True), tmp_path, tmp_path)
    tree = decode(Tree, (tmp_path / "tree.json").read_bytes())
    found = twins(tree, Control())
    loud = {f.rule for f in mirror_findings(found, Tolerances()) if f.severity != "info"}
    assert (len(found.pairs), loud) == (pairs, set())
