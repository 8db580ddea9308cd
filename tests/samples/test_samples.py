"""Drawn robots, written into tree and control."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from robot_files import run_step, write_robot_ports
from tiny import tiny_quadruped

from assetbuild.robot.actuators import RowError
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.model import Actuator, Control, MjcfOnly, Tree
from assetbuild.robot.randomize import Samples
from assetbuild.robot.ranges import Randomize
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


@pytest.fixture(scope="module")
def widely(tmp_path_factory: pytest.TempPathFactory) -> Samples:
    """Four robots drawn from `WIDE`."""
    folder = write_robot_ports(tmp_path_factory.mktemp("widely"), tiny_quadruped())
    return drawn(folder, WIDE)


@pytest.mark.slow
def test_the_same_seed_draws_the_same_robots_and_another_seed_others(ports, widely):
    first, more = widely, drawn(ports, WIDE, keep=9)
    assert first.samples == more.samples[:4]
    assert drawn(ports, {**WIDE, "seed": 8}).samples != first.samples


def test_a_sample_lands_in_tree_and_control(ports, widely):
    samples = widely
    (ports / "samples.json").write_bytes(encode(samples))
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
    control = replace(robot.control, actuators=rows, mjcf_only=(only,))
    ports = write_robot_ports(tmp_path, replace(robot, control=control))
    step = StateRanges(robot="r", randomize=Randomize.model_validate(WIDE))
    (found,) = [f for f in run_step(step, ports, tmp_path / "out") if f.rule == "randomize.idle"]
    assert found.severity == "warning"
    assert "MJCF's alone" in found.message
    silent = ("FR_hip_joint", "FR_thigh_joint", "FR_calf_joint")
    assert found.data == {"kp": silent, "effort": silent}
    write_robot_ports(tmp_path, robot)
    assert "randomize.idle" not in {f.rule for f in run_step(step, ports, tmp_path / "out")}
