"""Verdict, waivers and places of findings; the page that shows them."""

from __future__ import annotations

from assetbuild.checks import urdf_kinematics
from assetbuild.facts import compare
from assetbuild.findings import RENAMED, Finding
from assetbuild.recipe.models import Waiver
from assetbuild.report.document import fails, make_report
from assetbuild.report.verdict import CheckResult

TRIANGLE = Finding("inertia.triangle", "error", "link calf", "moments do not fit", "check the CoM")
RADIUS = Finding("inertia.radius", "warning", "link calf", "0.6 m")


def nowhere(subject: str) -> str:
    return {"link calf": "robot.urdf:17"}.get(subject, "")


def test_an_error_blocks_training_and_names_the_next_step_with_its_line():
    report = make_report("r", [RADIUS, TRIANGLE], {}, {}, nowhere)
    assert not report.verdict.ready
    assert report.verdict.blocked_by == ("inertia.triangle",)
    assert report.verdict.next_step == "robot.urdf:17: link calf: check the CoM"
    assert [finding.rule for finding in report.findings] == ["inertia.triangle", "inertia.radius"]
    assert fails(report, "error")


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
    report = make_report("r", [], {}, waivers, nowhere)
    assert [finding.rule for finding in report.findings] == ["rules.unused"]


def test_the_old_names_stand_beside_the_new_ones():
    for rule in (compare.EQUAL, urdf_kinematics.DIFFERS):
        assert rule.was
        assert rule.was.keys() <= RENAMED.keys()


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


def test_a_waiver_under_an_old_name_that_finds_nothing_is_told_once():
    waivers = {"urdf.reload.kinematics": Waiver(severity="info", because="known")}
    report = make_report("r", [], {}, waivers, nowhere)
    assert [finding.rule for finding in report.findings] == ["rules.renamed"]


def test_an_old_name_about_joints_leaves_bodies_alone():
    found = [
        Finding("equal.mjcf.missing", "error", subject, "the MJCF lacks it")
        for subject in ("body shank", "joint knee")
    ]
    waivers = {"equal.mjcf.joint": Waiver(severity="info", because="a spare")}
    severities = {
        f.subject: f.severity for f in make_report("r", found, {}, waivers, nowhere).findings
    }
    assert severities["joint knee"] == "info"
    assert severities["body shank"] == "error"


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
