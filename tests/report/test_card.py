"""The model card: numbers that a reviewer can check against another source."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tiny import ball_inertial, box_inertial, tiny_quadruped

from assetbuild.findings import Finding
from assetbuild.report.card import card_tables, model_card
from assetbuild.report.document import make_report
from assetbuild.report.facts import center_of_mass, ellipsoid, principal
from assetbuild.report.grade import grade
from assetbuild.report.verdict import CheckResult
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.model import Body, Joint, Keyframe, Tree
from assetbuild.robot.pose import Pose, rotation_of

from .robots_for_tests import subject

PASSED = {"free_fall": CheckResult("pass"), "stand": CheckResult("pass")}


def report(*findings: Finding, checks=PASSED):
    return make_report("tiny", list(findings), checks, {}, lambda _: "")


def test_the_card_has_every_body_joint_drive_and_shape_once():
    robot = tiny_quadruped()
    by_title = {table.title: table for table in card_tables(subject(), report())}
    assert [row[0] for row in by_title["Bodies"].rows] == [b.name for b in robot.tree.bodies]
    assert len(by_title["Joints"].rows) == len(robot.tree.moving_joints)
    assert len(by_title["Actuators"].rows) == len(robot.control.actuators)
    assert len(by_title["Collision geometry"].rows) == len(robot.shapes.of("collision"))


def test_the_card_begins_with_the_parts_of_the_verdict():
    text = model_card(subject(), report(Finding("equal.usd.mass", "error", "link a", "1, not 2")))
    head = text.partition("## Identity")[0]
    assert "Blocked by `equal.usd.mass`." in head
    assert "- formats: differ: 1 finding of the equality checks (usd)" in head
    assert "- physics: not tried: " in head


def test_a_bar_in_a_name_does_not_break_the_table():
    text = model_card(subject(), report(Finding("urdf.dropped", "info", "link a|b", "x | y")))
    assert "a\\|b" in text


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


def test_the_grade_needs_sources_and_loses_its_rank_with_warnings():
    control = tiny_quadruped().control
    known = replace(control, actuators=tuple(
        replace(a, source="datasheet", effort=20.0, armature=0.01) for a in control.actuators
    ))  # fmt: skip
    assert grade(known, report())[0] == "A"
    assert grade(replace(known, actuators=tuple(
        replace(a, source="") for a in known.actuators)), report())[0] == "B"  # fmt: skip
    assert grade(known, report(Finding("inertia.radius", "warning", "link a", "big")))[0] == "B"
    assert grade(known, report(Finding("stand.fall", "error", "robot", "fell")))[0] == "C"
    assert grade(known, report(checks={"stand": CheckResult("fail")}))[0] == "C"
    assert grade(known, report(checks={}))[0] == "C"
