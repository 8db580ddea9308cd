"""A rule makes findings of its id, with the severities that it declares and no others."""

from __future__ import annotations

import pytest

from assetbuild.findings import Finding, Rule

SAG = Rule("stand.sag", ("warning", "error"), "the base sinks", "raise kp")
EQUAL = Rule("equal.mjcf.*", "error", "the model differs from the robot", "report it")


def test_a_rule_makes_a_finding_of_its_usual_severity():
    made = SAG("robot", "sank by 0.1 m", "raise kp", data={"sag_m": 0.1})
    expected = Finding(
        "stand.sag", "warning", "robot", "sank by 0.1 m", "raise kp", data={"sag_m": 0.1}
    )
    assert made == expected


def test_a_call_may_state_another_declared_severity():
    assert SAG("robot", "sank", severity="error").severity == "error"


def test_a_severity_that_was_not_declared_is_refused():
    with pytest.raises(ValueError, match=r"`stand\.sag` does not declare the severity `info`"):
        SAG("robot", "sank", severity="info")


def test_a_call_names_the_part_that_differs():
    assert EQUAL.named("mass")("link trunk", "2 kg").rule == "equal.mjcf.mass"
    with pytest.raises(ValueError, match="`named` gives it one"):
        EQUAL("link trunk", "2 kg")
    with pytest.raises(ValueError, match=r"`stand\.sag` has no `\*`"):
        SAG.named("mass")
