"""The loops in Newton: what it is asked, and that loops which open, or a NaN, are findings."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from tiny import TinyRobot, four_bar, run_step, write_robot_ports

from assetbuild.checks.newton_loops import NewtonLoops
from assetbuild.findings import Finding
from assetbuild.robot.closure import close

FREE = ("coupler_joint", "rocker_joint")


def motion(robot: TinyRobot, job: dict[str, Any], *, held: bool) -> dict[str, Any]:
    """As a program answers that moves the crank; where nothing holds the loop, it alone."""
    middle, swing, _, _ = job["servos"]["crank_joint"]
    pose, tracks = dict(job["start"]), {name: [] for name in job["start"]}
    for share in (0.0, 0.5, 1.0):
        pose |= {"crank_joint": middle + share * swing}
        if held:
            pose = dict(close(robot.tree, robot.control.loops, pose, FREE).positions)
        for name, track in tracks.items():
            track.append(pose[name])
    return {"finite": True, "time": [0.0, 1.0, 2.0], "joints": tracks}


def judged(folder: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> tuple[list[Finding], dict]:
    robot = four_bar()

    def answer(_: object, program: str, job: dict[str, Any]) -> tuple[dict[str, Any] | None, str]:
        assert program == "_newton_loops_child.py" and job["steps"] * job["dt"] == 3.0
        assert set(job["start"]) == {"crank_joint", *FREE} and not job["hold"]
        found = {
            "closed": lambda: motion(robot, job, held=True),
            "open": lambda: motion(robot, job, held=False),
            "nan": lambda: {"finite": False},
            "refused": lambda: {"failure": "ValueError: no articulation"},
        }
        return found[kind](), ""

    monkeypatch.setattr(NewtonLoops, "answer", answer)
    inputs = write_robot_ports(folder / "in", robot)
    findings = run_step(NewtonLoops(robot="bot", environment="newton"), inputs, folder / "out")
    return findings, json.loads((folder / "out/figures.json").read_text())


@pytest.mark.parametrize(
    ("kind", "rules"),
    [
        ("closed", []),
        ("open", [("loop.opens", "error")]),
        ("nan", [("loop.opens", "error")]),
        ("refused", [("smoke.failed", "error")]),
    ],
)
def test_a_loop_that_newton_does_not_hold_is_an_error(
    kind: str, rules: list[tuple[str, str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    findings, figures = judged(tmp_path, monkeypatch, kind)
    assert [(finding.rule, finding.severity) for finding in findings] == rules
    if kind == "closed":
        assert figures["largest_gap"] < 1e-6 and figures["swing"]["crank_joint"] > 0.0
