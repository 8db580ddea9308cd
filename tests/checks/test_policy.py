"""A policy that the recipe names must drive the robot that is built."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from policies import bundle_of, deployed, write_policy
from robot_files import figures, mjcf_inputs, run_step
from tiny import tiny_quadruped

from assetbuild.checks.policy import PolicyCheck
from assetbuild.errors import StepError
from assetbuild.findings import Finding
from assetbuild.robot.actuator_table import RowError


def checked(
    folder: Path, spoil: Callable[[dict[str, Any]], object], **fields: object
) -> list[Finding]:
    """What the check finds of a policy that stands, after it was spoiled."""
    bot = bundle_of(folder / "bot", bus=())
    said = deployed(bot)
    spoil(said)
    inputs = mjcf_inputs(folder, tiny_quadruped())
    own = write_policy(folder / "p", said)
    shutil.copytree(own, inputs / "own_policy")
    values = {"robot": "robot", "files": ("policy.onnx", "deploy.yaml"), "seconds": 1.0}
    step = PolicyCheck.model_validate(values | {"command": (0.0, 0.0, 0.0)} | fields)
    return run_step(step, inputs, folder / "out")


def test_a_policy_that_stands_passes(tmp_path: Path):
    assert [f for f in checked(tmp_path, lambda said: None) if f.severity != "info"] == []
    found = figures(tmp_path / "out")
    assert found["verdict"] == "stands" and found["seconds"] == 1.0


def test_one_that_falls_is_an_error(tmp_path: Path):
    """Its joints hold nothing."""
    found = checked(tmp_path, lambda said: said.update(stiffness=[0.1] * 12, damping=[0.01] * 12))
    assert "policy.fails" in {f.rule for f in found if f.severity == "error"}


def test_one_that_does_not_follow_is_an_error(tmp_path: Path):
    found = checked(tmp_path, lambda said: None, command=(0.5, 0.0, 0.0))
    fails = [f for f in found if f.rule == "policy.fails"]
    assert "does not follow the command: 0.00 m/s forward, 0.5 m/s asked for" in fails[0].message


def test_what_cannot_be_replayed_is_one_error(tmp_path: Path):
    with pytest.raises(StepError, match="the network takes 45 numbers"):
        checked(tmp_path, lambda said: said["observations"].pop("base_ang_vel"))


def test_its_files_are_inputs_of_the_step_and_two_of_one_name_are_refused():
    step = PolicyCheck(robot="robot", files=("a/policy.onnx", "deploy.yaml"))
    assert {port: path for port, (_, path) in step.own_files().items()} == {
        "own_policy/policy.onnx": "a/policy.onnx",
        "own_policy/deploy.yaml": "deploy.yaml",
    }
    with pytest.raises(RowError, match=r"`policy\.onnx` is named twice"):
        PolicyCheck(robot="robot", files=("a/policy.onnx", "b/policy.onnx")).own_files()
