"""Verdict, waivers and places of findings; the page that shows them."""

from __future__ import annotations

import hashlib
import json

from tiny import tiny_quadruped

from assetbuild.findings import Finding
from assetbuild.recipe.models import Waiver
from assetbuild.report.bundle import BundleFile, manifest, media_type, provenance
from assetbuild.report.card import card_tables, grade, model_card
from assetbuild.report.document import fails, make_report
from assetbuild.report.verdict import CheckResult

from .robots_for_tests import subject, with_drives

TRIANGLE = Finding("inertia.triangle", "error", "link calf", "moments do not fit", "check the CoM")
RADIUS = Finding("inertia.radius", "warning", "link calf", "0.6 m")


def nowhere(subject: str) -> str:
    return {"link calf": "robot.urdf:17"}.get(subject, "")


def test_what_a_check_could_not_work_on_never_hides_why():
    """`equal.mjcf.load` comes first by its letters, last by its meaning."""
    follows = Finding("equal.mjcf.load", "error", "robot", "nothing to compare")
    refused = Finding("mjcf.load", "error", "robot", "MuJoCo refuses r.xml")
    report = make_report("r", [follows, refused, TRIANGLE], {}, {}, nowhere)
    assert report.verdict.blocked_by == ("inertia.triangle", "mjcf.load")
    assert report.verdict.next_step.startswith("robot.urdf:17: link calf")
    assert [f.rule for f in report.findings][-1] == "equal.mjcf.load"


def test_a_waiver_changes_the_severity_and_stays_visible():
    waivers = {"inertia.triangle": Waiver(severity="info", because="measured on the part")}
    report = make_report("r", [TRIANGLE], {}, waivers, nowhere)
    assert report.verdict.ready
    assert report.findings[0].severity == "info"
    assert report.findings[0].data["because"] == "measured on the part"
    assert report.findings[0].data["severity_before"] == "error"
    assert not fails(report, "error")


def test_a_waiver_for_a_rule_that_found_nothing_is_told():
    waivers = {"inertia.tirangle": Waiver(severity="info", because="whatever it is")}
    report = make_report("r", [TRIANGLE], {}, waivers, nowhere)
    (unused,) = (one for one in report.findings if one.rule == "rules.unused")
    assert unused.hint == "did you mean `inertia.triangle`?"


def test_a_waiver_under_an_old_name_works_and_names_the_new_one():
    off = Finding("equal.physx.kd", "error", "joint hip", "kd is 3 in PhysX, 4 in the robot")
    waivers = {"physx.gains": Waiver(severity="info", because="measured on the robot")}
    report = make_report("r", [off], {}, waivers, nowhere)
    assert [f.rule for f in report.findings] == ["equal.physx.kd", "rules.renamed"]
    assert [f.severity for f in report.findings] == ["info", "info"]
    assert report.findings[0].data["because"] == "measured on the robot"
    assert report.findings[1].subject == "recipe rules.physx.gains"
    said = "rule `physx.gains` is called `equal.physx.kp`, `equal.physx.kd` now"
    assert report.findings[1].message == said


def test_an_old_name_about_joints_leaves_bodies_alone():
    found = [
        Finding("equal.mjcf.missing", "error", subject, "the MJCF lacks it")
        for subject in ("body shank", "joint knee")
    ]
    waivers = {"equal.mjcf.joint": Waiver(severity="info", because="a spare")}
    waived = make_report("r", found, {}, waivers, nowhere)
    severities = {f.subject: f.severity for f in waived.findings}
    assert (severities["joint knee"], severities["body shank"]) == ("info", "error")


def test_fail_on_decides_what_fails():
    report = make_report("r", [RADIUS], {}, {}, nowhere)
    assert fails(report, "warning")
    assert not fails(report, "error")
    assert not fails(report, "never")


def test_a_skipped_check_is_part_of_the_next_step():
    checks = {"oracle": CheckResult("skip", note="needs pinocchio")}
    assert "oracle" in make_report("r", [], checks, {}, nowhere).verdict.next_step


def test_what_is_said_of_a_link_and_of_its_body_is_said_once_at_its_worst():
    quiet = Finding("inertia.radius", "info", "link calf", "0.6 m")
    report = make_report("r", [quiet, RADIUS, RADIUS], {}, {}, nowhere)
    assert [finding.severity for finding in report.findings] == ["warning"]


PASSED = {"free_fall": CheckResult("pass"), "stand": CheckResult("pass")}


def report(*findings: Finding, checks=PASSED):
    return make_report("tiny", list(findings), checks, {}, nowhere)


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
    robot = with_drives(tiny_quadruped(), source="datasheet", effort=20.0, armature=0.01)
    known, unknown = robot.control, with_drives(robot, source="").control
    assert grade(known, report())[0] == "A"
    assert grade(unknown, report())[0] == "B"
    assert grade(known, report(Finding("inertia.radius", "warning", "link a", "big")))[0] == "B"
    assert grade(known, report(Finding("stand.fall", "error", "robot", "fell")))[0] == "C"
    assert grade(known, report(checks={"stand": CheckResult("fail")}))[0] == "C"
    assert grade(known, report(checks={}))[0] == "C"


def test_the_manifest_lists_digest_size_and_kind_of_every_file_in_order():
    files = [BundleFile.of_text("b/x.usda", "usd", "xyz"), BundleFile.of_text("a.md", "report", "")]
    content = json.loads(manifest("r", files).content)
    assert [row["path"] for row in content["files"]] == ["a.md", "b/x.usda"]
    assert content["files"][1]["sha256"] == hashlib.sha256(b"xyz").hexdigest()
    assert content["files"][1]["size"] == 3
    assert manifest("r", files).content == manifest("r", files[::-1]).content


def test_provenance_is_an_in_toto_statement_with_a_subject_for_each_file():
    files = [BundleFile.of_text("a", "x", "1"), BundleFile.of_text("b", "x", "2")]
    run = {"finishedOn": "2001-01-01T00:00:00+00:00"}
    statement = json.loads(provenance(files, "0" * 64, {}, [{"name": "n"}], run).content)
    assert statement["_type"] == "https://in-toto.io/Statement/v1"
    assert statement["predicateType"] == "https://slsa.dev/provenance/v1"
    assert {subject["name"] for subject in statement["subject"]} == {"a", "b"}
    assert statement["predicate"]["runDetails"]["metadata"] == run


def test_a_licence_text_is_plain_text():
    assert media_type("LICENSES/a.dist-info/licenses/LICENSE") == "text/plain"
    assert media_type("mjcf/go1.xml") == "application/xml"
