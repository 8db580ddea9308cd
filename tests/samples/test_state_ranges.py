"""`dr.yaml` says each range in the robot's own numbers, and where it comes from."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from tiny import run_step, tiny_quadruped, write_robot_ports

from assetbuild.robot.inertia import pseudo_inertia
from assetbuild.robot.randomize import InertialRanges, deform
from assetbuild.robot.ranges import Randomize, claimed
from assetbuild.samples.state_ranges import StateRanges

RANGES = {
    "links": {
        "trunk": {"density": [0.8, 1.25], "com": [0.02, 0.01, 0], "source": "weighed"},
        ".*": {},
    },
    "payloads": [{"link": "imu", "mass": [0, 1], "size": [0.1, 0.1, 0.1], "source": "lidar"}],
    "joints": {".*_calf_joint": {"kp": [0.5, 2], "delay": [0, 3], "source": "datasheet"}},
    "friction": [0.4, 1.2],
}


def stated(folder: Path, ranges: dict[str, Any]) -> tuple[dict[str, Any], list[Any]]:
    inputs = write_robot_ports(folder / "in", tiny_quadruped())
    step = StateRanges(robot="tiny", randomize=Randomize.model_validate(ranges))
    findings = run_step(step, inputs, folder / "out")
    return yaml.safe_load((folder / "out/dr.yaml").read_text()), findings


def test_each_range_stands_in_the_robots_numbers(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    found, _ = stated(tmp_path, RANGES)
    trunk = robot.tree.by_body["trunk"].inertial
    assert trunk is not None
    assert found["links"]["trunk"]["mass"]["range"] == pytest.approx(
        [0.8 * trunk.mass_kg, 1.25 * trunk.mass_kg]
    )
    assert found["links"]["trunk"]["com"]["shift"] == [0.02, 0.01, 0]
    assert found["links"]["FR_calf"]["density"] == [0.8, 1.2], "the default"
    calf = robot.control.by_joint["FR_calf_joint"]
    assert found["joints"]["FR_calf_joint"]["kp"]["range"] == [calf.kp / 2, calf.kp * 2]
    assert "FR_hip_joint" not in found["joints"], "nothing was said about it"
    assert found["payloads"][0]["body"] == "trunk", "where the link was merged into"
    assert found["contact"]["friction"]["range"] == [0.4, 1.2]


def test_the_log_cholesky_numbers_are_the_density_and_the_shift(tmp_path: Path) -> None:
    """U J Uᵀ about the body's origin, as trainers do it, is our draw at the end of its ranges."""
    found, _ = stated(tmp_path, RANGES)
    inertial = tiny_quadruped().tree.by_body["trunk"].inertial
    assert inertial is not None
    row = found["links"]["trunk"]["log_cholesky"]
    change = np.eye(4)
    change[:3, 3] = [high for _, high in row["t"]]
    change *= math.exp(row["alpha"][1])
    theirs = change @ pseudo_inertia(inertial) @ change.T
    ranges = InertialRanges((0.8, 1.25), (0.02, 0.01, 0.0))
    ours = deform(inertial, ranges, np.array([[1.0, 1, 1, 1, 0, 0, 0, 0, 0, 0]]))[0]
    assert np.allclose(theirs, ours, rtol=1e-12, atol=1e-15)


def test_ranges_without_a_reason_are_told(tmp_path: Path) -> None:
    _, findings = stated(tmp_path, RANGES)
    assert [(f.rule, f.data["without"]) for f in findings] == [
        ("randomize.source", ("links..*", "friction"))
    ]
    reasons = {**RANGES, "friction_source": "measured"}
    reasons["links"] = {".*": {"source": "CAD"}}
    assert stated(tmp_path, reasons)[1] == []


def test_the_first_pattern_takes_a_name() -> None:
    rows = claimed({"a.*": 1, "x": 2, ".*": 3}, ["ab", "b", "ac"])
    assert rows == [("a.*", 1, ("ab", "ac")), (".*", 3, ("b",))]
