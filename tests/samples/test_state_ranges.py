"""`dr.yaml` says each range in the robot's own numbers, and where it comes from."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from robot_files import run_step, write_robot_ports
from tiny import tiny_quadruped

from assetbuild.robot.inertia import pseudo_inertia
from assetbuild.robot.randomize import deform
from assetbuild.robot.ranges import Randomize, RandomMatter, first_match_groups
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


def test_every_number_of_the_file_is_the_recipes_or_the_robots(tmp_path: Path) -> None:
    """The expected numbers are computed by hand for a trunk of 6.01 kg."""
    matter = {"density": [0.5, 2], "com": [0.02, 0.01, 0], "stretch": 0.1, "shear": 0.05}
    payload = {"link": "imu", "mass": [0, 3], "size": [0.2, 0.15, 0.1], "at": [0, 0, 0.1]}
    joints = {"kd": [0.5, 3], "delay": [1, 2], "encoder_bias": 0.01}
    ranges = {"seed": 2**63 - 1, "links": {"trunk": matter}, "payloads": [payload]}
    found, _ = stated(tmp_path, RANGES | ranges | {"joints": {".*_calf_joint": joints}})
    robot = tiny_quadruped()
    calf, trunk = robot.control.by_joint["FR_calf_joint"], robot.tree.by_body["trunk"].inertial
    assert trunk is not None
    assert found["seed"] == 2**63 - 1
    row = found["links"]["trunk"]
    assert row["density"] == [0.5, 2]
    assert row["mass"] == {"nominal": trunk.mass_kg, "range": [3.005, 12.02]}
    assert row["com"] == {"nominal": list(trunk.com_m), "shift": [0.02, 0.01, 0]}
    half = math.log(2.0) / 2.0
    assert row["log_cholesky"]["alpha"] == pytest.approx([-half, half])
    assert row["log_cholesky"]["d"] == [-0.1, 0.1] and row["log_cholesky"]["s"] == [-0.05, 0.05]
    assert row["log_cholesky"]["t"] == [[-0.02, 0.02], [-0.01, 0.01], [0, 0]]
    assert {word: found["payloads"][0][word] for word in payload} == payload
    drive = found["joints"]["FR_calf_joint"]
    assert drive["kd"] == {"nominal": calf.kd, "range": [calf.kd / 2, calf.kd * 3]}
    assert (drive["delay"], drive["encoder_bias"]) == ([1, 2], [-0.01, 0.01])
    assert found["contact"]["friction"]["nominal"] == robot.control.contact.friction[0]


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
    ranges = RandomMatter(density=(0.8, 1.25), com=(0.02, 0.01, 0.0))
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
    rows = first_match_groups({"a.*": 1, "x": 2, ".*": 3}, ["ab", "b", "ac"])
    assert rows == [("a.*", 1, ("ab", "ac")), (".*", 3, ("b",))]
