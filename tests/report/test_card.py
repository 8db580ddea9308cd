"""The model card: numbers that a reviewer can check against another source."""

from __future__ import annotations

from dataclasses import replace

from tiny import tiny_quadruped

from assetbuild.findings import Finding
from assetbuild.report.card import card_tables, grade, model_card
from assetbuild.report.document import make_report
from assetbuild.report.verdict import CheckResult

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
