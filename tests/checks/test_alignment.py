"""Two engines that simulate the same robot agree; each difference is a row of its own."""

from __future__ import annotations

import importlib.util
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from pxr import Usd, UsdPhysics
from tiny import TinyRobot, run_step, tiny_quadruped, write_robot_ports

from assetbuild.checks.alignment import Alignment
from assetbuild.checks.alignment.row import Row, findings_of
from assetbuild.findings import Finding
from assetbuild.recipe.models import Recipe, Sine
from assetbuild.report.summary import WITHHELD, public_message
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.usd import Usd as UsdTarget

Spoil = Callable[[Usd.Stage], object]
needs_physx = pytest.mark.skipif(
    importlib.util.find_spec("ovphysx") is None, reason="needs the extra `physx`"
)


def check(robot: TinyRobot, folder: Path, spoil: Spoil | None = None) -> list[Finding]:
    inputs = write_robot_ports(folder / "inputs", robot)
    for target, name in ((Mjcf(robot="robot"), "mjcf"), (UsdTarget(robot="robot"), "usd")):
        run_step(target, inputs, folder / "built")
        (folder / "built" / name).rename(inputs / name)
    if spoil is not None:
        stage = Usd.Stage.Open(str(inputs / "usd/robot.usda"))
        spoil(stage)
        stage.Save()
        del stage
    short = Sine(frequency=4.0, seconds=0.75, tolerance=0.02)
    found = run_step(Alignment(robot="robot", sine=short), inputs, folder / "out")
    return [finding for finding in found if finding.rule != "alignment.physx.gap"]


def rows_of(folder: Path) -> list[dict[str, object]]:
    rows = json.loads((folder / "out/figures.json").read_text())["rows"]
    assert isinstance(rows, list)
    return rows


@needs_physx
def test_quadruped_is_the_same_in_both(tmp_path: Path) -> None:
    assert check(tiny_quadruped(), tmp_path) == []
    rows = rows_of(tmp_path)
    assert {row["verdict"] for row in rows} == {"ok", "told"}
    ranks = [row["rank"] for row in rows]
    assert ranks == sorted(ranks, key=("CRITICAL", "HIGH", "MEDIUM", "LOW").index)
    landing = next(row for row in rows if row["row"] == "landing_s")
    assert landing["physx"] == pytest.approx(math.sqrt(2 / 9.81), rel=0.01)


@needs_physx
@pytest.mark.slow  # seven experiments in two engines
def test_gains_in_the_wrong_unit_are_a_critical_row(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        for prim in stage.Traverse():
            if prim.IsA(UsdPhysics.RevoluteJoint):
                drive = UsdPhysics.DriveAPI(prim, "angular")
                drive.GetDampingAttr().Set(3.0)  # N m s/rad where N m s/deg belong

    found = {f.rule: f for f in check(tiny_quadruped(), tmp_path, spoil)}
    row = found["alignment.physx.kd_plus_damping"]
    assert (row.severity, row.data["rank"], row.data["rows"]) == ("error", "CRITICAL", 12)
    assert "alignment.physx.sine" in found
    assert public_message(row) == WITHHELD


@needs_physx
@pytest.mark.slow  # a third run of seven experiments in two engines
def test_torque_motors_follow_the_sine_too(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    outside = tuple(replace(a, model="ideal_pd") for a in robot.control.actuators)
    robot = replace(robot, control=replace(robot.control, actuators=outside))
    assert [f for f in check(robot, tmp_path) if f.severity == "error"] == []
    assert any(row["row"] == "sine" for row in rows_of(tmp_path))


def test_mjcf_that_does_not_load_is_an_error(tmp_path: Path) -> None:
    inputs = write_robot_ports(tmp_path / "inputs", tiny_quadruped())
    (inputs / "mjcf").mkdir()
    (inputs / "mjcf/scene.xml").write_text("<mujoco>")
    found = run_step(Alignment(robot="robot"), inputs, tmp_path / "out")
    assert [(f.rule, f.severity) for f in found] == [("alignment.physx.load", "error")]


def test_rows_are_judged_by_two_limits() -> None:
    row = Row("kp", "CRITICAL", "joint a", 1.0, 1.0, 0.0, 0.1, 0.2)
    verdicts = [replace(row, off=off).verdict for off in (0.0, 0.15, 0.3, math.nan, None)]
    assert verdicts == ["ok", "warning", "error", "error", "told"]


def test_a_kind_of_row_is_one_finding_about_its_worst() -> None:
    row = Row("kp", "CRITICAL", "joint a", 1.0, 1.0, 0.0, 0.1, 0.2)
    rows = [
        row,
        replace(row, subject="joint b", off=0.3),
        replace(row, subject="joint c", off=0.15),
    ]
    (found,) = findings_of(rows)
    assert (found.rule, found.subject, found.severity) == (
        "alignment.physx.kp",
        "joint b",
        "error",
    )
    assert found.data["rows"] == 2


def test_recipe_decides() -> None:
    base = {"schema": "assetbuild/v1", "robot": "r", "source": {"path": ".", "urdf": "r.urdf"}}
    both = {"simulators": ["physx", "mujoco"], "sine": None}
    asked = Recipe.model_validate(base | {"validate": both})
    assert Alignment.configure(asked) == Alignment(robot="r", sine=None)
    one = Recipe.model_validate(base | {"validate": {"simulators": ["physx"]}})
    assert Alignment.configure(one) is None
