"""`diff` reads what a bundle's script wrote in Isaac Lab; the check `smoke_isaaclab` runs it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from tiny import tiny_quadruped, write_robot_ports

from assetbuild.errors import UsageError
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.table import Key, Table
from assetbuild.report.diff import changes
from assetbuild.report.sides import Form, Side, foreign_side
from assetbuild.simulators.readings import FALL, FALL_S, FORMAT, HEIGHT, fall_m

ROBOT = tiny_quadruped()
DRIVES = {drive.joint: drive for drive in ROBOT.control.actuators}
DT = ROBOT.control.simulation.timestep


def written(folder: Path, stiffness: float = 1.0) -> Path:
    """Readings in the words of the script. stiffness: factor on what it holds."""
    masses = {b.name: b.inertial.mass_kg if b.inertial else 0.0 for b in ROBOT.tree.bodies}
    facts: list[list[Any]] = [["body", name, "mass, kg", mass] for name, mass in masses.items()]
    for joint in ROBOT.tree.moving_joints:
        own, drive = ["joint", joint.name], DRIVES[joint.name]
        facts += [[*own, "lower", joint.limits.lower], [*own, "upper", joint.limits.upper]]
        facts += [[*own, "kp", stiffness * drive.kp], [*own, "kd", drive.kd]]
        facts += [[*own, "armature", drive.armature], [*own, "effort", drive.effort]]
    facts.append(["robot", "robot", FALL, fall_m(9.81, DT)])
    facts.append(["robot", "robot", HEIGHT, 0.28])
    told = {"format": FORMAT, "simulator": "Isaac Lab 3, newton_mjwarp", "facts": facts}
    path = folder / "robot_isaaclab.json"
    path.write_text(json.dumps(told))
    return path


def ours(height: float, folder: Path) -> Side:
    inputs = write_robot_ports(folder / "inputs", ROBOT)
    facts = dict(robot_table(Reference.of_ports(inputs, {})).facts)
    facts[Key("robot", "", FALL)] = fall_m(9.81, DT)
    facts[Key("robot", "", HEIGHT)] = height
    return Side("ours", {"robot": Form(lambda: Table(facts))})


def test_readings_of_the_same_robot_differ_in_nothing(tmp_path: Path) -> None:
    readings = foreign_side(written(tmp_path))
    assert "Isaac Lab 3" in readings.name
    assert changes(ours(0.289, tmp_path), readings).rows == ()


def test_a_gain_in_degrees_and_a_robot_that_sinks_are_told(tmp_path: Path) -> None:
    readings = foreign_side(written(tmp_path, stiffness=57.29577951308232))
    rows = changes(ours(0.30, tmp_path), readings).rows
    found = {(c.rank, c.quantity): c.note for c in rows}
    assert "degrees" in found["CRITICAL", "kp"]
    assert ("MEDIUM", HEIGHT) in found


def test_the_fall_is_that_of_steps_not_of_the_parabola():
    steps, speed, fallen = round(FALL_S / 0.005), 0.0, 0.0
    for _ in range(steps):
        speed += 9.81 * 0.005
        fallen += speed * 0.005
    assert fall_m(9.81, 0.005) == pytest.approx(fallen, rel=1e-12)


@pytest.mark.parametrize("text", ["{}", "[1]", "no json", json.dumps({"format": "other"})])
def test_other_files_are_no_readings(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(UsageError, match="holds no readings"):
        foreign_side(tmp_path / "a.json")
