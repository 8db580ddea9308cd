"""The verdict of a whole build: what blocks it, and what it says was not tried."""

from __future__ import annotations

import json
from typing import Any

import pytest

from .conftest import Place

ROW = '  - {joints: ".*", model: pd, kp: 20, kd: 1, effort: 10, velocity: 20}\n'
TABLE = f"actuators:\n{ROW}"
REASON = 'rules: {actuator.none: {severity: info, because: "a display model"}}\n'
PASSIVE = 'actuators:\n  - {joints: ".*", model: passive}\n'


def verdict(legs: Place) -> dict[str, Any]:
    done = legs.build()
    assert done.returncode == 0, done.stdout + done.stderr
    told: dict[str, Any] = json.loads((legs.bundle / "report/report.json").read_text())["verdict"]
    assert f"ready for training: {'yes' if told['ready'] else 'no'}" in done.stdout
    for part in ("formats", "physics"):
        assert told[part]["sentence"] in done.stdout
    return told


@pytest.mark.parametrize("rows", [PASSIVE + REASON, "actuators: []\n", ""])
def test_a_robot_that_nothing_drives_is_not_ready(warm_legs: Place, rows: str):
    """Not by passive rows, not by a waiver alone, and not by an empty table alone."""
    warm_legs.edit(TABLE, rows)
    told = verdict(warm_legs)
    assert not told["ready"]
    assert told["blocked_by"] == ["actuator.none"]
    assert "`actuators: []`" in told["next_step"]


def test_a_robot_that_nothing_drives_on_purpose_is_ready_with_a_reason(warm_legs: Place):
    warm_legs.edit(TABLE, "actuators: []\n" + REASON)
    told = verdict(warm_legs)
    assert told["ready"]
    assert told["trainers"]["mjlab"]["command"] == "assetbuild smoke legs.yaml --consumer mjlab"


@pytest.mark.parametrize(
    ("asked", "why"),
    [("free_fall: {}", "`targets` lacks `mjcf`"), ("smoke: [mjlab]", "`targets` lacks `mjlab`")],
)
def test_a_robot_is_ready_only_when_all_that_was_asked_for_has_run(
    warm_legs: Place, asked: str, why: str
):
    warm_legs.edit("targets:", f"validate: {{{asked}}}\ntargets:")
    told = verdict(warm_legs)
    assert not told["ready"]
    assert told["blocked_by"] == ["check.not_run"]
    report = json.loads((warm_legs.bundle / "report/report.json").read_text())
    (finding,) = [f for f in report["findings"] if f["rule"] == "check.not_run"]
    assert why in finding["message"]
    assert finding["where"].startswith("legs.yaml:")
