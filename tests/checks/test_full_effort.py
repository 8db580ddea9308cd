"""Full effort against limits and mimic joints: a soft model fails, a stiffened one passes."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from tiny import TinyRobot, check_inputs, four_bar, pendulum, run_step, tiny_quadruped, with_mimic

from assetbuild.checks.full_effort import FullEffort
from assetbuild.findings import Finding
from assetbuild.robot.sides import Side
from assetbuild.robot.softness import CouplingError, LimitError, bare_inertia, softened
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.mjx import Mjx

LIMITS, COUPLINGS = LimitError.model_validate({}), CouplingError.model_validate({})


def stiff(robot: TinyRobot) -> TinyRobot:
    control = softened(robot.tree, robot.control, (Side(),), LIMITS, COUPLINGS)
    return replace(robot, control=control)


def strong() -> TinyRobot:
    """The pendulum with 500 N m: MuJoCo's default lets it (1 - d) t^2 F / I = 0.12 rad past."""
    robot = pendulum()
    (row,) = robot.control.actuators
    row = replace(row, model="pd", kp=500.0, kd=50.0, effort=500.0)
    return replace(robot, control=replace(robot.control, actuators=(row,)))


def coupled() -> TinyRobot:
    return with_mimic(tiny_quadruped(), "FL_calf_joint", "FR_calf_joint", 1.0, 0.0)


def evaluate(
    robot: TinyRobot, folder: Path, source: str | None = None
) -> tuple[list[Finding], dict[str, dict]]:
    inputs = check_inputs(folder, robot, Mjcf(robot="robot"), "mjcf")
    check = FullEffort(robot="robot", source=source)
    findings = run_step(check, inputs, folder / "out")
    return findings, json.loads((folder / "out/figures.json").read_text())


def test_a_strong_joint_runs_past_mujocos_default_limits(tmp_path: Path) -> None:
    robot = strong()
    (found,), figures = evaluate(robot, tmp_path / "soft")
    assert (found.rule, found.severity) == ("limits.soft", "warning")
    error = figures["mjcf"]["limits"]["turn"]["error"]
    inertia = bare_inertia(robot.tree, robot.control)["swing_joint"]
    # At rest the limit carries what the drive, which pulls back, leaves of the load.
    limit = inertia / (0.05 * 0.02**2)
    assert error == pytest.approx(500.0 / (limit + 500.0), rel=0.1)
    assert evaluate(stiff(robot), tmp_path / "stiff")[0] == []
    (told,), _ = evaluate(robot, tmp_path / "told", source="arm.xml")
    assert told.severity == "info", "its MJCF says how soft they are"


def test_followers_part_from_a_strong_leader(tmp_path: Path) -> None:
    """36 N m against calves of 0.02 kg m2; MuJoCo's default parts them by 0.03 rad."""
    findings, figures = evaluate(coupled(), tmp_path / "soft")
    assert "couplings.soft" in {f.rule for f in findings}
    assert figures["mjcf"]["couplings"]["turn"]["joint"] == "FL_calf_joint"
    findings, figures = evaluate(stiff(coupled()), tmp_path / "stiff")
    assert "couplings.soft" not in {f.rule for f in findings}
    assert figures["mjcf"]["couplings"]["turn"]["error"] < 1.1 * COUPLINGS.turn


def test_a_soft_loop_opens_where_a_drive_pushes_against_it(tmp_path: Path) -> None:
    robot = four_bar()
    (loop,), rows = robot.control.loops, robot.control.actuators
    rows = (replace(rows[0], effort=500.0), *rows[1:])

    def found(folder: str, **softness: tuple[float, ...]) -> tuple[set[str], float]:
        control = replace(robot.control, actuators=rows, loops=(replace(loop, **softness),))
        findings, figures = evaluate(replace(robot, control=control), tmp_path / folder)
        row = figures["mjcf"]["couplings"]["slide"]
        assert row["joint"] == "loop coupler_loop"
        return {f.rule for f in findings}, row["error"]

    rules, soft = found("soft", solref=(0.02, 1.0), solimp=(0.9, 0.95, 0.001, 0.5, 2.0))
    assert "couplings.soft" in rules
    rules, stiff = found("stiff")
    assert "couplings.soft" not in rules
    # r = (1 - d) t^2 F / I: 500 times less by d, 16 times by t.
    assert soft / stiff > 1000.0


def test_the_mjx_file_is_pushed_too(tmp_path: Path) -> None:
    inputs = check_inputs(tmp_path, stiff(coupled()), Mjcf(robot="robot"), "mjcf")
    run_step(Mjx(robot="robot"), inputs, tmp_path / "made")
    shutil.copytree(tmp_path / "made/mjx", inputs / "mjx")
    assert run_step(FullEffort(robot="robot"), inputs, tmp_path / "out") == []
    assert set(json.loads((tmp_path / "out/figures.json").read_text())) == {"mjcf", "mjx"}
