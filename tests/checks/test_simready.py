"""SimReady's verdict: what is required and lacking is an error, what is optional one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from assetbuild.checks.simready import SimReady, judged
from assetbuild.engine.world import World
from assetbuild.simulators.environments import ask

CODE = "com.nvidia.simready"
METADATA = {
    "passed": False,
    "blocking_failure": True,
    "failing requirements": f"['{CODE}.SR.004']",
    "requirement_messages": json.dumps({f"{CODE}.SR.004": ["Required fields are empty: author."]}),
}
ROS = {
    "passed": False,
    "blocking_failure": False,
    "optional requirements": f"['{CODE}.ROS.001', '{CODE}.ROS.002']",
}
MET = {"passed": True, "blocking_failure": False}


def test_a_required_field_that_is_empty_is_an_error_with_its_code_and_the_key_to_set():
    features = {"FET_033_STANDARD": METADATA, "FET_025_ROS": ROS, "FET_001_STANDARD": MET}
    error, info = judged(features, "Robot-Body")
    assert (error.rule, error.severity) == ("simready.required", "error")
    assert "SR.004: Required fields are empty: author." in error.message
    assert error.hint is not None and "`about`" in error.hint
    assert (info.rule, info.severity) == ("simready.optional", "info")
    assert "1 of 3 features" in info.message and "FET_025_ROS (ROS.001, ROS.002)" in info.message


def test_the_thumbnail_is_drawn_beside_the_checks():
    only = METADATA | {"failing requirements": f"['{CODE}.SR.002']"}
    both = METADATA | {"failing requirements": f"['{CODE}.SR.002', '{CODE}.SR.004']"}
    assert list(judged({"FET_031_STANDARD": only}, "Robot-Body")) == []
    assert len(list(judged({"FET_031_STANDARD": both}, "Robot-Body"))) == 1


def test_no_answer_is_an_error():
    (finding,) = judged({}, "Robot-Body", "it took more than 600 s")
    assert (finding.rule, finding.severity) == ("simready.no_result", "error")
    assert "it took more than 600 s" in finding.message
    (finding,) = judged({}, "Robot-Body")
    assert "no feature" in finding.message


def test_all_met_is_silence():
    assert list(judged({"FET_001_STANDARD": MET}, "Robot-Body")) == []


@pytest.mark.slow
def test_an_empty_stage_fails_the_real_validator(tmp_path: Path):
    python = SimReady.home.python(World())
    if python is None:
        pytest.skip("the validator is not here: `assetbuild smoke RECIPE --consumer simready`")
    stage = tmp_path / "asset/empty.usda"
    stage.parent.mkdir()
    stage.write_text("#usda 1.0\n")
    program = Path(__file__).parents[2] / "assetbuild/simulators/_simready_child.py"
    job: dict[str, object] = {"file": str(stage), "profile": "Robot-Body", "version": "3.0.0"}
    answer, failure = ask(python, program, job, tmp_path, 300.0)
    assert answer is not None, failure
    features = answer["features"]
    assert isinstance(features, dict)
    assert any(finding.severity == "error" for finding in judged(features, "Robot-Body"))
