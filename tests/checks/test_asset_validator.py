"""A failure of the asset validator is an error with its prim; warnings are one line a rule."""

from __future__ import annotations

from pathlib import Path

import pytest

from assetbuild.checks.asset_validator import AssetValidator, judged
from assetbuild.engine.world import World
from assetbuild.simulators.environments import ask

LOOSE = {"rule": "ManifoldChecker", "severity": "WARNING", "message": "3 edges", "path": "/r/m"}
UNBOUND = {"rule": "TypeChecker", "severity": "FAILURE", "message": "untyped", "path": "/r/x"}
BROKEN = {"rule": "validator", "severity": "ERROR", "message": "cannot open", "path": ""}


def test_failures_are_errors_and_warnings_are_counted_by_rule():
    untyped, cannot, loose = judged([LOOSE, UNBOUND, LOOSE | {"path": "/r/n"}, BROKEN])
    assert (untyped.rule, untyped.severity) == ("asset_validator.failure", "error")
    assert (untyped.subject, untyped.message) == ("prim /r/x", "TypeChecker: untyped")
    assert (cannot.subject, cannot.severity) == ("robot", "error")
    assert (loose.rule, loose.severity) == ("asset_validator.warning", "info")
    assert loose.data["times"] == 2
    assert "`/r/m`, `/r/n`" in loose.message


def test_nothing_is_silence():
    assert list(judged([])) == []


@pytest.mark.parametrize(
    ("failure", "said"), [("it ended by signal 11", "by signal 11"), ("", "no list of issues")]
)
def test_no_answer_is_an_error(failure: str, said: str):
    (finding,) = judged(None, failure)
    assert (finding.rule, finding.severity) == ("asset_validator.no_result", "error")
    assert finding.message.endswith(said)


@pytest.mark.slow
def test_a_stage_without_units_fails_the_real_validator(tmp_path: Path):
    python = AssetValidator.home.python(World())
    if python is None:
        pytest.skip("not here: `assetbuild smoke RECIPE --consumer asset_validator`")
    stage = tmp_path / "bad.usda"
    stage.write_text('#usda 1.0\ndef Xform "a"\n{\n}\n')
    program = Path(__file__).parents[2] / "assetbuild/simulators/_asset_validator_child.py"
    answer, failure = ask(python, program, {"file": str(stage)}, tmp_path, 300.0)
    assert answer is not None, failure
    issues = answer["issues"]
    assert isinstance(issues, list)
    said = [f.message for f in judged(issues) if f.severity == "error"]
    assert any("upAxis" in message for message in said)
