"""Drawn robots, written into tree and control; `dr.yaml` says each range and its source."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from robot_files import run_step, write_robot_ports
from tiny import tiny_quadruped, with_control

from assetbuild.robot.actuators import RowError
from assetbuild.robot.codec import decode
from assetbuild.robot.inertia import pseudo_inertia
from assetbuild.robot.model import Actuator, Control, MjcfOnly, Tree
from assetbuild.robot.randomize import Samples, deform
from assetbuild.robot.ranges import Randomize, RandomMatter, first_match_groups
from assetbuild.samples.draw_samples import ApplySample, DrawSamples
from assetbuild.samples.state_ranges import StateRanges

WIDE = {
    "seed": 7,
    "links": {".*": {"density": [0.5, 2.0], "com": 0.002, "stretch": 0.05, "shear": 0.05}},
    "joints": {".*": {"kp": [0.9, 1.1], "effort": [0.5, 0.6], "delay": [1, 3]}},
    "friction": [0.4, 1.2],
}


@pytest.fixture
def ports(tmp_path: Path) -> Path:
    """The ports of the quadruped."""
    return write_robot_ports(tmp_path / "ports", tiny_quadruped())


def drawn(ports: Path, randomize: dict, keep: int = 4, judge: int = 100) -> Samples:
    step = DrawSamples(randomize=Randomize.model_validate(randomize), keep=keep, judge=judge)
    run_step(step, ports, ports)
    return decode(Samples, (ports / "samples.json").read_bytes())


@pytest.mark.slow
def test_the_same_seed_draws_the_same_robots_and_another_seed_others(ports):
    first, more = drawn(ports, WIDE), drawn(ports, WIDE, keep=9)
    assert first.samples == more.samples[:4]
    assert drawn(ports, {**WIDE, "seed": 8}).samples != first.samples


def test_a_sample_lands_in_tree_and_control(ports):
    samples = drawn(ports, WIDE)
    before = decode(Control, (ports / "control.json").read_bytes())
    run_step(ApplySample(index=2), ports, ports)
    tree = decode(Tree, (ports / "tree.json").read_bytes())
    control = decode(Control, (ports / "control.json").read_bytes())
    sample = samples.samples[2]
    assert {b.body: b.inertial for b in sample.bodies}.items() <= {
        b.name: b.inertial for b in tree.bodies
    }.items()
    assert control.contact.friction[0] == sample.friction
    for old, new, by in zip(before.actuators, control.actuators, sample.joints, strict=True):
        assert new.kp == old.kp * by.kp
        assert 0.9 <= by.kp <= 1.1 and by.delay in (1, 2, 3)
        assert new.effort is None or new.effort == old.effort * by.effort


def test_a_payload_adds_its_whole_mass_to_the_body_that_carries_it(ports):
    body = decode(Tree, (ports / "tree.json").read_bytes()).bodies[0]
    payload = {"link": body.name, "mass": [2, 2], "size": [0.1, 0.1, 0.1]}
    samples = drawn(ports, {"payloads": [payload]})
    (loaded,) = samples.samples[0].bodies
    assert loaded.inertial.mass_kg == pytest.approx(body.inertial.mass_kg + 2)
    assert samples.samples[0].payloads_kg == (2.0,)


@pytest.mark.parametrize(
    ("randomize", "message"),
    [
        ({"links": {"trnk": {}}}, "matches no body"),
        ({"joints": {"nothing": {}}}, "matches no moving joint"),
        ({"payloads": [{"link": "x", "mass": [0, 1], "size": [1, 1, 1]}]}, "no link `x`"),
    ],
)
def test_a_pattern_that_means_nothing_is_refused_with_its_key(ports, randomize, message):
    step = StateRanges(robot="r", randomize=Randomize.model_validate(randomize))
    with pytest.raises(RowError, match=message) as caught:
        step.check(decode(Tree, (ports / "tree.json").read_bytes()))
    assert caught.value.key[0] == "randomize"


def test_ranges_of_gains_that_no_drive_has_are_told(tmp_path: Path):
    """As on joints whose drives only MJCF holds: tendons, muscles, transmissions."""
    robot = tiny_quadruped()
    rows = tuple(
        Actuator(a.joint, "passive", damping=0.1) if a.joint.startswith("FR") else a
        for a in robot.control.actuators
    )
    only = MjcfOnly("actuator", '<general name="m" tendon="t"/>')
    ports = write_robot_ports(tmp_path, with_control(robot, actuators=rows, mjcf_only=(only,)))
    step = StateRanges(robot="r", randomize=Randomize.model_validate(WIDE))
    (found,) = [f for f in run_step(step, ports, tmp_path / "out") if f.rule == "randomize.idle"]
    assert found.severity == "warning"
    assert "MJCF's alone" in found.message
    silent = ("FR_hip_joint", "FR_thigh_joint", "FR_calf_joint")
    assert found.data == {"kp": silent, "effort": silent}
    write_robot_ports(tmp_path, robot)
    assert "randomize.idle" not in {f.rule for f in run_step(step, ports, tmp_path / "out")}


# --- dr.yaml ----------------------------------------------------------------------------------

RANGES = {
    "links": {
        "trunk": {"density": [0.8, 1.25], "com": [0.02, 0.01, 0], "source": "weighed"},
        ".*": {},
    },
    "payloads": [{"link": "imu", "mass": [0, 1], "size": [0.1, 0.1, 0.1], "source": "lidar"}],
    "joints": {".*_calf_joint": {"kp": [0.5, 2], "delay": [0, 3], "source": "datasheet"}},
    "friction": [0.4, 1.2],
}


def stated(ports: Path, ranges: dict[str, Any]) -> tuple[dict[str, Any], list[Any]]:
    step = StateRanges(robot="tiny", randomize=Randomize.model_validate(ranges))
    findings = run_step(step, ports, ports)
    return yaml.safe_load((ports / "dr.yaml").read_text()), findings


def test_a_reader_sees_no_rounding_noise_and_no_negative_zero(ports: Path) -> None:
    ranges = {"links": {"trunk": {"density": [0.9, 1.1]}}, "joints": {".*": {"kp": [0.9, 1.1]}}}
    stated(ports, ranges)
    text = (ports / "dr.yaml").read_text()
    assert not re.search(r"-0\.0\b(?!\d)|\d(0{6}|9{6})\d", text), text


def test_every_number_of_the_file_is_the_recipes_or_the_robots(ports: Path) -> None:
    """The expected numbers are computed by hand for a trunk of 6.01 kg."""
    matter = {"density": [0.5, 2], "com": [0.02, 0.01, 0], "stretch": 0.1, "shear": 0.05}
    payload = {"link": "imu", "mass": [0, 3], "size": [0.2, 0.15, 0.1], "at": [0, 0, 0.1]}
    joints = {"kd": [0.5, 3], "delay": [1, 2], "encoder_bias": 0.01}
    ranges = {"seed": 2**63 - 1, "links": {"trunk": matter}, "payloads": [payload]}
    found, _ = stated(ports, RANGES | ranges | {"joints": {".*_calf_joint": joints}})
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


def test_the_log_cholesky_numbers_are_the_density_and_the_shift(ports: Path) -> None:
    """U J Uᵀ about the body's origin, as trainers do it, is our draw at the end of its ranges."""
    found, _ = stated(ports, RANGES)
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


def test_ranges_without_a_reason_are_told(ports: Path) -> None:
    _, findings = stated(ports, RANGES)
    assert [(f.rule, f.data["without"]) for f in findings] == [
        ("randomize.source", ("links..*", "friction"))
    ]
    reasons = {**RANGES, "friction_source": "measured"}
    reasons["links"] = {".*": {"source": "CAD"}}
    assert stated(ports, reasons)[1] == []


def test_the_first_pattern_takes_a_name() -> None:
    rows = first_match_groups({"a.*": 1, "x": 2, ".*": 3}, ["ab", "b", "ac"])
    assert rows == [("a.*", 1, ("ab", "ac")), (".*", 3, ("b",))]
