"""A rule makes findings of its id, with the severities that it declares and no others."""

from __future__ import annotations

import json

import pytest

from assetbuild.cli.summary import every_finding_line
from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import write_figures

SAG = Rule("stand.sag", ("warning", "error"), "the base sinks", "raise kp")
EQUAL = Rule("equal.mjcf.*", "error", "the model differs from the robot", "report it")


def test_a_rule_makes_a_finding_of_its_usual_severity():
    made = SAG("robot", "sank by 0.1 m", "raise kp", data={"sag_m": 0.1})
    expected = Finding(
        "stand.sag", "warning", "robot", "sank by 0.1 m", "raise kp", data={"sag_m": 0.1}
    )
    assert made == expected


def test_a_call_may_state_another_declared_severity_and_no_other():
    assert SAG("robot", "sank", severity="error").severity == "error"
    with pytest.raises(ValueError, match=r"`stand\.sag` does not declare the severity `info`"):
        SAG("robot", "sank", severity="info")


NONE = Rule("stand.still", "info", "the base stands", "nothing, where that is meant")


@pytest.mark.parametrize(
    ("rule", "hint", "shown"),
    [
        (SAG, "", ["hint: raise kp"]),
        (SAG, "kp 80", ["hint: kp 80"]),
        (NONE, "", []),
        (NONE, "kp 80", ["hint: kp 80"]),
        (EQUAL.named("mass"), "", ["hint: report it"]),
    ],
)
def test_a_finding_without_a_hint_shows_the_advice_of_its_rule(
    rule: Rule, hint: str, shown: list[str]
):
    assert [line.strip() for line in every_finding_line([rule("robot", "sank", hint)])[1:]] == shown


def test_a_call_names_the_part_that_differs():
    assert EQUAL.named("mass")("link trunk", "2 kg").rule == "equal.mjcf.mass"
    with pytest.raises(ValueError, match="`named` gives it one"):
        EQUAL("link trunk", "2 kg")
    with pytest.raises(ValueError, match=r"`stand\.sag` has no `\*`"):
        SAG.named("mass")


@pytest.mark.parametrize(
    ("value", "other"),
    [
        (0.1 + 0.2, 0.3),
        (1e-17, -3e-17),  # what cancels, beside a limit
        (0.02378234101856, 0.02378234101857),
    ],
)
def test_the_last_bits_of_a_figure_are_not_in_its_report(tmp_path, value, other):
    def written(number: float) -> bytes:
        files = Files(tmp_path, tmp_path)
        figures = {"drift_m": number, "rows": [{"mass_kg": number}], "gap": {"foot": number}}
        write_figures(files, figures, {"drift_m": 0.02, "gap": 1e-3})
        return (tmp_path / "figures.json").read_bytes()

    assert written(value) == written(other)


def test_a_figure_keeps_a_thousandth_of_its_limit(tmp_path):
    write_figures(
        Files(tmp_path, tmp_path), {"error": 1.23456e-9, "big": 123456.0}, {"error": 2e-9}
    )
    assert json.loads((tmp_path / "figures.json").read_text()) == {"error": 1.235e-9, "big": 123456}


def test_the_numbers_of_a_finding_keep_twelve_digits_and_no_noise():
    found = Rule("a.b", "info", "", "")(
        "robot", "", data={"kg": 0.1 + 0.2, "moments": (-2.5e-22, 3.4e-23, 3e-06), "n": 3, "x": "y"}
    )
    assert found.data == {"kg": 0.3, "moments": (0.0, 0.0, 3e-06), "n": 3, "x": "y"}
    assert str(found.data["moments"]) == "(0.0, 0.0, 3e-06)"  # no negative zero
