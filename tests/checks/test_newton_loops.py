"""The loops in Newton: what it is asked, and that loops which open, or a NaN, are findings."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from tiny import TinyRobot, four_bar, run_step, write_robot_ports

from assetbuild.checks.newton_loops import NewtonLoops
from assetbuild.findings import Finding
from assetbuild.robot.closure import close
from assetbuild.simulators.experiments import Motion
from assetbuild.simulators.physx import Experiment, Outcome

FREE = ("coupler_joint", "rocker_joint")
NO_POSE = np.zeros((3, 3))


def motion(robot: TinyRobot, asked: Experiment, kind: str) -> Motion:
    """As a program answers that moves the crank; where nothing holds the loop, it alone."""
    assert asked.sine is not None
    middle, swing = asked.sine.middle["crank_joint"], asked.sine.swing["crank_joint"]
    pose, tracks = dict(asked.start or {}), {name: [] for name in asked.start or {}}
    for share in (0.0, 0.5, 1.0):
        pose |= {"crank_joint": middle + share * swing}
        if kind == "closed":
            pose = dict(close(robot.tree, robot.control.loops, pose, FREE).positions)
        for name, track in tracks.items():
            track.append(np.nan if kind == "nan" else pose[name])
    joints = {name: np.array(track) for name, track in tracks.items()}
    return Motion(np.array([0.0, 1.0, 2.0]), joints, NO_POSE, np.zeros((3, 4)), NO_POSE)


def judged(folder: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> tuple[list[Finding], dict]:
    robot = four_bar()

    def perform(_: NewtonLoops, __: Path, experiments: Sequence[Experiment]) -> dict[str, Outcome]:
        (asked,) = experiments
        assert asked.steps * asked.setting.timestep == 3.0
        assert set(asked.start or ()) == {"crank_joint", *FREE} and asked.setting.base == "asset"
        if kind == "refused":
            return {"loops": Outcome(None, None, "ValueError: no articulation")}
        return {"loops": Outcome(None, motion(robot, asked, kind))}

    monkeypatch.setattr(NewtonLoops, "perform", perform)
    inputs = write_robot_ports(folder / "in", robot)
    findings = run_step(NewtonLoops(robot="bot", environment="newton"), inputs, folder / "out")
    return findings, json.loads((folder / "out/figures.json").read_text())


@pytest.mark.parametrize(
    ("kind", "rules"),
    [
        ("closed", []),
        ("open", [("loop.opens", "error")]),
        ("nan", [("loop.opens", "error")]),
        ("refused", [("loop.opens", "error")]),
    ],
)
def test_a_loop_that_newton_does_not_hold_is_an_error(
    kind: str, rules: list[tuple[str, str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    findings, figures = judged(tmp_path, monkeypatch, kind)
    assert [(finding.rule, finding.severity) for finding in findings] == rules
    if kind == "closed":
        assert figures["largest_gap"] < 1e-6 and figures["swing"]["crank_joint"] > 0.0
