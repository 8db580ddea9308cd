"""Other people's programs judge what we built: their words become findings, silence one, too."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest
from robot_files import mjcf_inputs, ranked, run_step
from tiny import tiny_quadruped

from assetbuild.checks._foreign import (
    AssetValidator,
    ForeignTool,
    MjcfDoctor,
    Simcheck,
    SimReady,
    Validator,
)
from assetbuild.engine.world import World
from assetbuild.findings import Finding

CODE = "com.nvidia.simready"
METADATA = {
    "passed": False,
    "blocking_failure": True,
    "failing requirements": f"['{CODE}.SR.004']",
    "requirement_messages": json.dumps({f"{CODE}.SR.004": ["Required fields are empty: author."]}),
}
THUMBNAIL = {**METADATA, "failing requirements": f"['{CODE}.SR.002']"}
ROS = {
    "passed": False,
    "blocking_failure": False,
    "optional requirements": f"['{CODE}.ROS.001', '{CODE}.ROS.002']",
}
MET = {"passed": True, "blocking_failure": False}
LOOSE = {"rule": {"name": "Manifold"}, "severity": "WARNING", "message": "3 edges"}
UNBOUND = {"rule": {"name": "Types"}, "severity": "FAILURE", "message": "no", "at": {"path": "/x"}}


def evaluate(tool: ForeignTool, report: object) -> tuple[list[tuple[str, ...]], dict[str, object]]:
    """(rule, severity, subject) of what it says of a report, and its figures."""
    figures: dict[str, object] = {}
    text = report if isinstance(report, str) else json.dumps(report)
    return [(f.rule, f.severity, f.subject) for f in tool.judge(text, figures)], figures


def simready(features: Mapping[str, object]) -> object:
    return {"robot.usda": {"features_summary": features}}


def test_required_features_are_errors_and_optional_ones_one_line():
    tool = SimReady(robot="robot", environment="")
    features = {"FET_033": METADATA, "FET_025_ROS": ROS, "FET_001": MET, "FET_031": THUMBNAIL}
    found, figures = evaluate(tool, simready(features))
    assert [f[:2] for f in found] == [("simready.required", "error"), ("simready.optional", "info")]
    assert figures == {"profile": "Robot-Body 3.0.0", "met": 2, "of": 4}, "the thumbnail is later"
    required, optional = tool.judge(json.dumps(simready(features)), {})
    assert "SR.004: Required fields are empty: author." in required.message
    assert "`about`" in required.hint
    assert "1 of 4 features" in optional.message and "(ROS.001, ROS.002)" in optional.message


def test_failures_of_the_asset_validator_are_errors_and_warnings_one_line_a_rule():
    tool = AssetValidator(robot="robot", environment="")
    issues = [LOOSE, UNBOUND, LOOSE | {"at": {"path": "/n"}}, {"severity": "ERROR", "message": ""}]
    found, figures = evaluate(tool, {"rules": [{"issues": issues[:1]}, {"issues": issues[1:]}]})
    assert found == [
        ("asset_validator.failure", "error", "prim /x"),
        ("asset_validator.failure", "error", "robot"),
        ("asset_validator.warning", "info", "robot"),
    ]
    assert figures == {"failures": 2, "warnings": 2}
    assert evaluate(tool, {"rules": []})[0] == []


def test_linters_keep_their_ids():
    results = [
        {"id": "inertia.density", "status": "fail", "findings": [
            {"severity": "error", "message": "3e5 kg/m3", "target": "foot"}]},
        {"id": "joints.axis", "status": "pass", "findings": []},
    ]  # fmt: skip
    found, figures = evaluate(Simcheck(robot="robot"), {"results": results})
    assert (found, figures) == (
        [("simcheck.inertia.density", "error", "robot")],
        {"checks": 2, "passed": 1},
    )
    warned = [{"level": "WARN", "code": "timestep_large", "subject": "<option>", "message": ""}]
    page = "v0.2.1\nscene.xml - 1 warning\n" + json.dumps([{"findings": warned}], indent=2)
    assert evaluate(MjcfDoctor(robot="robot"), page)[0] == [
        ("doctor.timestep_large", "warning", "robot")
    ]


def run(
    tool: ForeignTool, program: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> list[Finding]:
    """What comes of a tool whose program is another."""
    inputs = mjcf_inputs(folder, tiny_quadruped())
    (inputs / "usd").mkdir()
    monkeypatch.setattr(ForeignTool, "interpreter", lambda _: Path(sys.executable))
    monkeypatch.setattr(Validator, "interpreter", ForeignTool.interpreter)
    escaped = program.replace("{", "{{").replace("}", "}}")
    monkeypatch.setattr(type(tool), "words", ("-c", escaped))
    return run_step(tool, inputs, folder / "out")


def test_a_report_is_printed_or_lies_beside_the_copied_folder(tmp_path: Path, monkeypatch):
    printed = 'import os; assert "robot.xml" in os.listdir(); print(\'[\\n{"findings": []}]\')'
    assert run(MjcfDoctor(robot="robot"), printed, tmp_path / "a", monkeypatch) == []
    written = 'open("../report.json", "w").write(\'{"rules": []}\'); raise SystemExit("3 checked")'
    validator = AssetValidator(robot="robot", environment="")
    assert run(validator, written, tmp_path / "b", monkeypatch) == []


@pytest.mark.parametrize(
    ("tool", "rule", "severity"),
    [
        (Simcheck(robot="robot"), "simcheck.broken", "warning"),
        (MjcfDoctor(robot="robot"), "doctor.broken", "warning"),
        (SimReady(robot="robot", environment=""), "simready.no_result", "error"),
        (AssetValidator(robot="robot", environment=""), "asset_validator.no_result", "error"),
    ],
)
@pytest.mark.parametrize("program", ["raise SystemExit('ouch')", "print('[] ouch')"])
def test_a_program_without_a_report_is_a_finding(
    tool: ForeignTool, rule: str, severity: str, program: str, tmp_path: Path, monkeypatch
):
    (found,) = run(tool, program, tmp_path, monkeypatch)
    assert ranked([found]) == [(rule, severity)]
    assert found.message.endswith("ouch")


def test_features_that_are_none_are_no_result():
    with pytest.raises(LookupError):
        evaluate(SimReady(robot="robot", environment=""), simready({}))


@pytest.mark.slow
@pytest.mark.parametrize("kind", [SimReady, AssetValidator])
def test_an_empty_stage_fails_the_real_validator(kind: type[Validator], tmp_path: Path):
    if kind.home.python(World()) is None:
        pytest.skip(f"not here: `assetbuild smoke RECIPE --consumer {kind.home.name}`")
    (tmp_path / "in/usd").mkdir(parents=True)
    (tmp_path / "in/usd/bad.usda").write_text('#usda 1.0\ndef Xform "a"\n{\n}\n')
    found = run_step(kind(robot="bad", environment=""), tmp_path / "in", tmp_path / "out")
    assert {f.rule.partition(".")[2] for f in found} & {"required", "failure"}
