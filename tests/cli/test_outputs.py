"""What a build leaves for CI: JSON lines, JUnit, GitHub's job summary."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

from defusedxml import ElementTree

from assetbuild.cli.outputs import annotation_lines, markdown, step_summary, write_junit
from assetbuild.engine.make import NodeResult
from assetbuild.errors import StepError
from assetbuild.findings import Finding
from assetbuild.report.document import make_report
from assetbuild.report.summary import markdown_text, public_message
from assetbuild.report.verdict import CheckResult

from .conftest import Place


def outcome(*findings: Finding, checks: Any = (), results: Any = (), built: bool = True) -> Any:
    report = make_report("tiny", list(findings), dict(checks), {}, lambda _: "tiny.urdf:7")
    results = {result.label: result for result in results}
    return SimpleNamespace(
        loaded=SimpleNamespace(recipe=SimpleNamespace(robot="tiny")),
        results=results,
        errors=tuple(r.error for r in results.values() if r.error),
        differences=(),
        report=report if built else None,
        exit_code=0,
        seconds=1.5,
        out=None,
    )


HEAVY = Finding("inertia.triangle", "error", "link a|b", "ixx + iyy < izz | <b>`x`</b>\nnext")
SPEED = Finding("physx.speed", "warning", "robot", "12345 steps per second")
NAMED = Finding("stand.falls", "warning", "robot", "fell after 1.25 s", data={"simulator": "physx"})
CHECKS = {"stand": CheckResult("fail"), "sine": CheckResult("pass"), "x": CheckResult("skip")}


def test_the_summary_is_one_table_row_per_finding_without_markup_of_its_own():
    text = markdown(outcome(HEAVY, checks=CHECKS))
    assert "### tiny: not ready for training" in text
    (row,) = [line for line in text.splitlines() if "inertia.triangle" in line]
    assert row.replace("\\|", "").count("|") == 5
    assert "<b>" not in text
    assert "- checks: 1 passed, 1 failed (`stand`), 1 not run (`x`)" in text


def test_code_stays_code_and_hostile_names_stay_text():
    text = markdown_text("joint `a_b` is <i>off</i> [x](y) `")
    assert text == "joint \\`a\\_b\\` is &lt;i&gt;off&lt;/i&gt; \\[x\\](y) \\`"
    assert markdown_text("`a_b` is <i>") == "`a_b` is &lt;i&gt;"


def test_a_row_for_each_robot_stands_first():
    text = step_summary([outcome(HEAVY, SPEED, checks=CHECKS), outcome(built=False)])
    rows = [line for line in text.splitlines() if line.startswith("| tiny")]
    assert rows == [
        "| tiny | **no** | 1 of 2 | 1 | 1 | 0 of 0 | 1.5 |",
        "| tiny | not built | - | 0 | - | 0 of 0 | 1.5 |",
    ]


def test_findings_are_marked_at_their_file_and_line(tmp_path):
    """In the checkout at the source's line; of an archive at the recipe, its place in words."""
    (tmp_path / "robots").mkdir()
    (tmp_path / "recipes").mkdir()
    (tmp_path / "robots/tiny.urdf").write_text("<robot/>")
    for path, where in (
        ("../robots", "file=robots/tiny.urdf,line=7"),
        ("x.zip", "file=recipes/tiny.yaml"),
    ):
        one = outcome(HEAVY, SPEED)
        recipe = SimpleNamespace(robot="tiny", source=SimpleNamespace(path=path, root="."))
        one.loaded = SimpleNamespace(recipe=recipe, path=tmp_path / "recipes/tiny.yaml")
        error, warning = annotation_lines([one], tmp_path)
        assert error.startswith(f"::error {where},title=inertia.triangle::")
        assert ("tiny.urdf:7" in error) == (path == "x.zip")
        assert "%0A" not in error.partition("hint")[0].partition("::")[0]
        assert warning.startswith("::warning ") and "12345" not in warning
    assert "\n" not in error


def test_no_figure_of_physx_is_published():
    for finding in (SPEED, NAMED):
        assert "not published" in public_message(finding)
    text = markdown(outcome(SPEED, NAMED, checks={"stand_physx": CheckResult("pass", {"f": 9.75})}))
    assert not any(figure in text for figure in ("12345", "1.25", "9.75"))
    assert "- checks: 1 passed" in text
    assert "ixx" in public_message(HEAVY)


def test_junit_has_a_case_for_every_check_error_and_failed_step(tmp_path):
    failed = NodeResult(label="calf", status="failed", error=StepError("a <bug> & \x00"))
    path = tmp_path / "junit.xml"
    built = outcome(HEAVY, SPEED, checks=CHECKS)
    write_junit(path, [built, outcome(results=[failed], built=False)], StepError("first"))
    suites = ElementTree.parse(path).getroot()
    counts = [{k: s.get(k) for k in ("tests", "failures", "errors", "skipped")} for s in suites]
    assert counts[0] == {"tests": "4", "failures": "2", "errors": "0", "skipped": "1"}
    assert counts[1] == {"tests": "1", "failures": "0", "errors": "1", "skipped": "0"}
    assert counts[2]["errors"] == "1"
    assert "tiny.urdf:7" in str(ElementTree.tostring(suites))


def test_a_check_whose_errors_are_waived_fails_no_job(tmp_path):
    waived = outcome(SPEED, checks={"stand": CheckResult("fail")})
    write_junit(tmp_path / "junit.xml", [waived])
    (suite,) = ElementTree.parse(tmp_path / "junit.xml").getroot()
    assert (suite.get("failures"), suite.get("skipped")) == ("0", "1")
    waived.exit_code = 1  # by `--fail-on warning`
    write_junit(tmp_path / "strict.xml", [waived])
    (suite,) = ElementTree.parse(tmp_path / "strict.xml").getroot()
    assert (suite.get("failures"), suite.get("skipped")) == ("1", "1")
    assert "0 passed, 1 failed, waived by the recipe (`stand`)" in markdown(waived)


def test_a_build_leaves_all_three(warm_legs: Place):
    words = ("--log-json", "events.ndjson", "--report-junit", "junit.xml")
    done = warm_legs.build(*words, GITHUB_STEP_SUMMARY="summary.md")
    assert done.returncode == 0, done.stderr
    lines = (warm_legs.folder / "events.ndjson").read_text().splitlines()
    events = [json.loads(line) for line in lines]
    assert "13 bodies" in next(e["text"] for e in events if e["event"] == "message")
    assert next(e for e in events if e["event"] != "message")["event"] == "planned"
    assert (events[-1]["event"], events[-1]["ready"]) == ("outcome", True)
    finished = [e for e in events if e["event"] == "finished"]
    assert {e["status"] for e in finished} <= {"ran", "cached"}
    suite = ElementTree.parse(warm_legs.folder / "junit.xml").getroot()[0]
    assert suite.get("name") == "legs"
    assert int(suite.get("tests", 0)) > 0
    assert "### legs: " in (warm_legs.folder / "summary.md").read_text()
    again = warm_legs.build(GITHUB_STEP_SUMMARY="summary.md")
    assert "0 ran" in again.stdout
    assert (warm_legs.folder / "summary.md").read_text().count("### legs") == 2


def test_every_mistake_is_told_everywhere(legs: Place):
    legs.edit("kp: 20", "kp: x")
    legs.edit("targets: [urdf]", "targets: [mcjf]")
    words = ("--log-json", "events.ndjson", "--report-junit", "junit.xml")
    assert legs.build(*words, GITHUB_STEP_SUMMARY="summary.md").returncode == 2
    assert json.loads((legs.folder / "events.ndjson").read_text())["event"] == "error"
    cases = ElementTree.parse(legs.folder / "junit.xml").iter("error")
    places = [case.get("message").split(": ")[0] for case in cases]
    assert places == ["legs.yaml:7:35", "legs.yaml:8:11"]
    assert "not built" in (legs.folder / "summary.md").read_text()
