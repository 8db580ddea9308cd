"""What a build prints at its end fits the screen, the reason before what follows from it."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import pytest

from assetbuild.cli import report
from assetbuild.cli.parser import given_as
from assetbuild.cli.plan import told_of_all
from assetbuild.cli.progress import Forecast, Progress, shown_time
from assetbuild.cli.summary import (
    every_finding_line,
    finding_lines,
    shown_figures,
    shown_report,
    shown_rows,
)
from assetbuild.engine.execute import Costs, Event
from assetbuild.engine.explain import Explanation
from assetbuild.engine.journal import Change
from assetbuild.engine.make import NodeResult
from assetbuild.findings import Finding, worst_first
from assetbuild.report.document import make_report
from assetbuild.report.summary import WITHHELD
from assetbuild.report.verdict import CheckResult, verdict_rows

HEAVY = [
    Finding("mass.density", "warning", f"link finger_{i}", "9000 kg per cubic metre" * 3, "look")
    for i in range(40)
]
REFUSED = Finding("mjcf.load", "error", "robot", "MuJoCo refuses r.xml", "read the lints")
FOLLOWS = [Finding(f"{n}.load", "error", "robot", "nothing") for n in ("free_fall", "stand")]
FELL = Finding("physx.free_fall", "error", "robot", "fell 0.125 m")


def test_a_rule_is_told_once_with_the_names_of_all_it_speaks_of():
    lines = finding_lines(HEAVY)
    assert len(lines) == 3
    assert lines[2].startswith("      and 39 more: link finger_1, link finger_2")


def test_the_report_of_a_bundle_tells_each_rule_once_with_its_id():
    seen = [Finding("mesh.up_axis", "info", f"mesh {n}", "the file says Y_UP") for n in range(30)]
    first, more = every_finding_line(seen)
    assert first == "info mesh.up_axis: mesh 0: the file says Y_UP"
    assert more.startswith("  and 29 more: mesh 1, mesh 2,") and more.endswith("mesh 8, ...")


def test_explain_counts_what_nothing_touched_since_its_first_build():
    first, kp = (Change("first"),), (Change("field", "rows[0].kp", 20.0, 25.0),)
    found = [
        Explanation("read_urdf", "up to date", last_at="noon", last_changes=first),
        Explanation("control", "up to date", last_at="noon", last_changes=kp),
        Explanation("mjcf", "waits", last_at="noon", last_changes=first),
    ]
    text = "\n".join(told_of_all(found))
    assert "field rows[0].kp: 20.0 -> 25.0" in text
    assert "mjcf: waits" in text and "read_urdf" not in text
    assert text.endswith("1 of 3 steps: untouched since their first build")


def test_what_follows_from_an_error_is_one_line_after_it():
    lines = finding_lines(worst_first([*FOLLOWS, REFUSED]))
    assert lines[0].startswith("    error mjcf.load")
    assert lines[-1].startswith("    error free_fall.load, stand.load: caused by the errors above")


def test_the_error_that_mujoco_names_comes_first_and_what_repeats_it_follows():
    why = "Error: inertia must satisfy A + B >= C Element name 'thigh', id 3, line 4"
    refused = [
        Finding("equal.unreadable", "error", "robot", f"the MJCF: MuJoCo refuses it: {why}"),
        Finding("inertia.triangle", "error", "link thigh", "A + B < C", "edit it"),
        Finding("mjcf.load", "error", "robot", f"MuJoCo refuses r.xml: {why}6"),
    ]
    made = make_report("r", refused, {}, {}, lambda _: "")
    assert made.verdict.blocked_by == ("inertia.triangle",)
    assert made.verdict.next_step == "link thigh: edit it"
    assert made.findings[0].rule == "inertia.triangle"
    last = finding_lines(made.findings)[-1]
    assert last.endswith("equal.unreadable, mjcf.load: caused by the errors above")


def test_a_command_is_printed_with_the_path_as_given():
    commands = {"mjlab": "assetbuild smoke r.yaml --consumer mjlab"}
    verdict = make_report("r", [], {}, {}, lambda _: "", commands).verdict
    (row,) = (said for _, said in shown_rows(verdict, Path("my robots/r.yaml")) if "smoke" in said)
    assert "; run `assetbuild smoke 'my robots/r.yaml' --consumer mjlab`" in row
    (row,) = (said for _, said in verdict_rows(verdict) if "smoke" in said)
    assert "in the folder of the recipe, run `assetbuild smoke r.yaml --consumer mjlab`" in row


def test_the_expected_time_is_the_work_shared_among_cores_or_the_longest_chain():
    costs = Costs({"a": 4.0, "b": 2.0, "c": 2.0}, {"a": 6.0, "b": 2.0, "c": 2.0})
    sums = Forecast(2, costs)
    assert sums.left_s({}) == 6.0, "c follows a"
    assert sums.left_s({"a": 3.0}) == 3.0
    sums.done("a")
    assert sums.left_s({}) == 2.0
    assert (shown_time(8.2), shown_time(125.0)) == ("8 s", "2 min 05 s")


def test_the_expected_time_follows_what_steps_took_and_says_what_it_does_not_know():
    costs = Costs({"a": 3.0, "b": 9.0}, {"a": 3.0, "b": 9.0}, frozenset({"b"}))
    sums = Forecast(1, costs)
    assert (sums.word, sums.left_s({})) == ("at least", 12.0)
    sums.done("a", 6.0)
    assert sums.left_s({}) == 1.5 * 9.0, "twice as slow as expected, half believed"
    assert sums.left_s({"b": 6.0}) == 1.5 * 9.0 - 6.0
    sums.plan(Costs({"c": 2.0}, {"c": 2.0}))
    assert (sums.word, sums.left_s({})) == ("about", 3.0)


def test_no_total_is_shown_before_all_steps_are_known(capsys: pytest.CaptureFixture[str]):
    ran = NodeResult(label="read_urdf", status="ran", seconds=0.1)
    shown = Progress("tiny")
    shown.on_event(Event("finished", 1, 9, ran.label, ran, whole=False))
    shown.on_event(Event("finished", 10, 75, ran.label, ran))
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "tiny: [1/?] read_urdf, 0.1 s"
    assert lines[1] == "tiny: [10/75] read_urdf, 0.1 s"


def test_a_step_that_takes_long_leaves_a_line_when_it_begins(capsys: pytest.CaptureFixture[str]):
    shown = Progress("tiny")
    seconds = {"pose": 3.0, "check smoke_mjlab": 90.0}
    shown.on_event(Event("planned", 0, 9, costs=Costs(seconds, seconds)))
    for label in seconds:
        shown.on_event(Event("started", 1, 9, label))
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["tiny: [1/9] check smoke_mjlab begins, 1 min 30 s expected"]


def told(folder: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """All that the console shows of `FELL`, by whatever verb."""
    saw = CheckResult("pass", {"summary": "the root went to 0.125 m"})
    trainer = {"isaaclab": "assetbuild smoke tiny.yaml --consumer isaaclab"}
    made = make_report("tiny", [FELL], {"smoke_isaaclab": saw}, {}, lambda _: "", trainer)
    ran = NodeResult(label="check physx_free_fall", status="ran", seconds=98.5)
    Progress("tiny").on_event(Event("finished", 1, 2, ran.label, ran))
    (folder / "report").mkdir(exist_ok=True)
    (folder / "report/report.json").write_text(json.dumps(made.to_json()))
    report.run(argparse.Namespace(bundle=folder, open=False, pictures=None))
    printed = capsys.readouterr()
    shown = shown_report(made).verdict
    rows = [said for _, said in shown_rows(shown, Path("tiny.yaml"))]
    lines = [*rows, *finding_lines([FELL]), shown.next_step, shown_figures("isaaclab", "0.125 m")]
    return "\n".join([*lines, printed.out, printed.err])


@pytest.mark.parametrize("name", ["CI", "GITHUB_ACTIONS"])
def test_in_a_public_log_physx_passes_or_fails_without_figures(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    for other in ("CI", "GITHUB_ACTIONS"):
        monkeypatch.delenv(other, raising=False)
    at_home = told(tmp_path, capsys)
    assert at_home.count("0.125") == 6
    assert "98.5" in at_home
    monkeypatch.setenv(name, "true")
    in_public = told(tmp_path, capsys)
    assert not any(figure in in_public for figure in ("0.125", "98.5"))
    assert in_public.count(WITHHELD) == 6
    assert "error physx.free_fall" in in_public


def test_a_recipe_of_the_installed_library_is_named_as_one_types_it(tmp_path, monkeypatch):
    """An environment in the folder where one works holds the library."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("assetbuild.library.INSTALLED", tmp_path / "venv/_recipes")
    (tmp_path / "venv/_recipes").mkdir(parents=True)
    for name in ("venv/_recipes/go1.yaml", "mine.yaml"):
        (tmp_path / name).write_text("")
    assert given_as(tmp_path / "venv/_recipes/go1.yaml") == "go1"
    assert given_as(tmp_path / "mine.yaml") == "mine.yaml"
