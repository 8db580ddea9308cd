"""The reader of facts of `dr.yaml` derives every range again and finds each wrong one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tiny import run_step, tiny_quadruped, write_robot_ports

from assetbuild.facts.readers.dr import Dr
from assetbuild.findings import Finding
from assetbuild.geometry.measure_assets import MeasureAssets
from assetbuild.robot.ranges import Randomize
from assetbuild.samples.state_ranges import StateRanges

RANGES: dict[str, Any] = {
    "seed": 2**63 - 1,
    "links": {
        "trunk": {"density": [0.8, 1.25], "com": [0.02, 0.01, 0], "source": "weighed"},
        ".*": {"stretch": 0.1, "shear": 0.2},
    },
    "payloads": [{"link": "imu", "mass": [0, 1], "size": [0.1, 0.2, 0.3], "source": "lidar"}],
    "joints": {
        ".*_calf_joint": {"kp": [0.5, 2], "delay": [0, 3], "source": "datasheet"},
        ".*_hip_joint": {"effort": [0.9, 1], "encoder_bias": 0.01},
    },
    "friction": [0.4, 1.2],
    "restitution": [0, 0.1],
}


def proved(folder: Path, *edits: tuple[str, str], ranges: dict[str, Any] = RANGES) -> list[Finding]:
    """`dr.yaml` of the tiny quadruped, edited, against the recipe and the robot."""
    robot = tiny_quadruped()
    first = replace(robot.control.actuators[0], effort=None)
    control = replace(robot.control, actuators=(first, *robot.control.actuators[1:]))
    ports = write_robot_ports(folder / "in", replace(robot, control=control))
    run_step(MeasureAssets(), ports, ports)
    said = Randomize.model_validate(ranges)
    run_step(StateRanges(robot="tiny", randomize=said), ports, ports / "ranges")
    path = ports / "ranges/dr.yaml"
    text = path.read_text()
    for old, new in edits:
        assert old in text, text
        text = text.replace(old, new, 1)
    path.write_text(text)
    options = {"randomize": said.model_dump(mode="json", by_alias=True)}
    return run_step(Dr(robot="tiny", options=options), ports, folder / "out")


@pytest.mark.parametrize(
    "ranges",
    [RANGES, {"joints": {"FR_.*": {}}}, {"links": {"imu|trunk": {}}}, {"friction": [1, 1]}],
    ids=["all", "joints", "links", "friction"],
)
def test_what_we_write_is_what_the_recipe_asks_for(ranges: dict[str, Any], tmp_path: Path):
    assert proved(tmp_path, ranges=ranges) == []
    assert '"facts": 0' not in (tmp_path / "out/figures.json").read_text()


@pytest.mark.parametrize(
    ("subject", "quantity", "old", "new"),
    [
        ("body trunk", "mass", "nominal: 6.01", "nominal: 6.1"),
        ("body trunk", "mass", "range: [4.808", "range: [4.9"),
        ("body trunk", "density", "density: [0.8, 1.25]", "density: [0.8, 1.26]"),
        ("body trunk", "com_x", "shift: [0.02, 0.01", "shift: [0.01, 0.02"),
        ("body trunk", "density", "alpha: [-0.11", "alpha: [-0.22"),
        ("body trunk", "com_x", "[-0.02, 0.02]", "[-0.02, 0.03]"),
        ("body FR_hip", "stretch", "d: [-0.1, 0.1]", "d: [-0.1, 0.11]"),
        ("body FR_hip", "shear_12", "s: [-0.2, 0.2]", "s: [0.2, -0.2]"),
        ("payload 0", "mass", "mass: [0.0, 1.0]", "mass: [0.0, 1.1]"),
        ("payload 0", "body", "body: trunk", "body: FR_hip"),
        ("payload 0", "size", "size: [0.1, 0.2", "size: [0.2, 0.1"),
        ("joint FR_calf_joint", "kp", "range: [50.0, 200.0]", "range: [50.0, 202.0]"),
        ("joint FR_calf_joint", "delay", "delay: [0, 3]", "delay: [0, 4]"),
        ("joint FR_hip_joint", "encoder_bias", "bias: [-0.01, 0.01]", "bias: [-0.01, 0.02]"),
        ("robot", "surface_friction", "friction:\n    nominal: 0.8", "friction:\n    nominal: 0.9"),
        ("robot", "restitution", "range: [0.0, 0.1]", "range: [0.0, 0.2]"),
        ("robot", "seed", f"seed: {2**63 - 1}", f"seed: {2**63 - 2}"),
    ],
)
def test_a_wrong_range_is_named(subject: str, quantity: str, old: str, new: str, tmp_path: Path):
    findings = proved(tmp_path, (old, new))
    assert (f"equal.dr.{quantity}", subject) in {(f.rule, f.subject) for f in findings}


@pytest.mark.parametrize(
    "text", ["[", "a: !!python/object:os.system {}", "a: b: c", "a: &a [1]\nb: *a"]
)
def test_what_is_no_yaml_is_one_error(text: str, tmp_path: Path):
    (found,) = proved(tmp_path, ("schema:", f"{text}\nschema:"))
    assert found.rule == "equal.unreadable"
