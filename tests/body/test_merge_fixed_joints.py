"""Fixed joints are merged exactly, and bodies measured for people."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from robot_files import run_step, write_robot_ports
from tiny import ball_inertial, box_inertial, tiny_quadruped
from urdfs import read

from assetbuild.body.measure_bodies import center_of_mass, ellipsoid, principal
from assetbuild.body.merge_fixed_joints import MergeFixedJoints
from assetbuild.findings import Finding
from assetbuild.robot.codec import decode
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.model import Body, Joint, Keyframe, Tree
from assetbuild.robot.pose import Pose, rotation_of


def merge(folder: Path, step: MergeFixedJoints) -> tuple[Tree, list[Finding]]:
    findings = run_step(step, folder, folder)
    return decode(Tree, (folder / "tree.json").read_bytes()), findings


@pytest.mark.parametrize(
    ("step", "bodies", "merged"),
    [
        (MergeFixedJoints(), 13, {"imu", "FR_foot", "FL_foot", "RR_foot", "RL_foot"}),
        (MergeFixedJoints(keep_bodies=(".*_foot",)), 17, {"imu"}),
        (MergeFixedJoints(merge=False), 18, None),
    ],
    ids=["all", "feet are kept by pattern", "nothing on request"],
)
def test_one_finding_names_all_that_was_merged(
    step: MergeFixedJoints, bodies: int, merged: set[str] | None, tmp_path: Path
):
    tree, findings = merge(write_robot_ports(tmp_path, tiny_quadruped()), step)
    assert len(tree.bodies) == bodies
    assert [(f.rule, f.severity, f.data["bodies"], set(f.data["links"])) for f in findings] == [
        ("merge.fixed_joints", "info", bodies, merged)
    ] * (merged is not None)


@pytest.mark.parametrize(
    ("keep_root", "root", "rules"),
    [
        (False, "trunk", ["merge.placeholder_root", "merge.fixed_joints"]),
        (True, "base", ["merge.fixed_joints"]),
    ],
    ids=["of a URDF", "of an MJCF, whose keyframes say where its own frame stands"],
)
def test_a_placeholder_root_is_told(
    keep_root: bool, root: str, rules: list[str], robots: Path, tmp_path: Path
):
    read((robots / "placeholder_root.urdf").read_text(), tmp_path, base="floating")
    tree, findings = merge(tmp_path, MergeFixedJoints(keep_root=keep_root))
    assert [b.name for b in tree.bodies] == [root, "arm"]
    assert [f.rule for f in findings] == rules
    if not keep_root:
        assert findings[0].subject == "link base"
        assert findings[0].data == {"body": "trunk", "mass_kg": 1e-6}


def test_the_centre_of_mass_is_the_mean_weighed_by_mass():
    """1 kg at the origin; 3 kg 0.1 m above a joint at x = 1, which a quarter turn lays along x."""
    low, high = ball_inertial(1.0, 0.1), ball_inertial(3.0, 0.1, (0.0, 0.0, 0.1))
    joint = Joint("j", "revolute", "a", "b", Pose((1.0, 0.0, 0.0)), (0.0, 1.0, 0.0))
    tree = Tree("t", "fixed", (Body("a", low), Body("b", high)), (joint,))
    turned = Keyframe("home", (("j", math.pi / 2),), Pose((0.0, 0.0, 2.0)))
    assert center_of_mass(tree, turned) == pytest.approx((0.825, 0.0, 2.0))
    assert total_mass(tree) == pytest.approx(4.0)


def test_principal_axes_turn_the_moments_back_into_the_tensor():
    inertial = replace(box_inertial(2.0, (0.1, 0.2, 0.3)), inertia_com_kg_m2=(
        3.0, 2.0, 4.0, 0.3, -0.2, 0.1))  # fmt: skip
    moments, axes = principal(inertial)
    R = rotation_of(axes)
    full = R @ np.diag(moments) @ R.T
    assert [full[0, 0], full[1, 1], full[2, 2], full[0, 1], full[0, 2], full[1, 2]] == (
        pytest.approx(inertial.inertia_com_kg_m2)
    )


def test_the_ellipsoid_of_a_ball_is_the_ball():
    assert ellipsoid(ball_inertial(3.0, 0.25)) == pytest.approx((0.25, 0.25, 0.25))
