"""Loops that stay closed are fine in every simulator; what opens, fails or goes to NaN is found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from checks.engines import needs_physx
from pxr import Usd, UsdPhysics
from robot_files import checked, edit, laid_out, mjcf_inputs, ranked, rules, run_step, usd_inputs
from tiny import TinyRobot, four_bar, pendulum, tiny_quadruped, with_drives, with_mimic

from assetbuild.checks._mujoco import Loops
from assetbuild.checks._newton import NewtonLoops
from assetbuild.checks._physx import PhysxLoops
from assetbuild.checks.full_effort import FullEffort
from assetbuild.findings import Finding
from assetbuild.robot.closure import close
from assetbuild.robot.model import Keyframe
from assetbuild.robot.sides import Side
from assetbuild.robot.softness import CouplingError, LimitError, bare_inertia, softened
from assetbuild.simulators.experiments import Experiment, Motion, Outcome
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.mjx import Mjx

FREE = ("coupler_joint", "rocker_joint")
NO_POSE = np.zeros((3, 3))
OPEN = [("loop.opens", "error")]


@pytest.mark.parametrize("is_lost", [False, True])
def test_a_loop_that_the_mjcf_has_lost_opens(is_lost: bool, tmp_path: Path) -> None:
    inputs = mjcf_inputs(tmp_path, four_bar())
    if is_lost:
        edit(inputs / "mjcf/robot.xml", ("<equality>", "<!--"), ("</equality>", "-->"))
    found = run_step(Loops(robot="robot"), inputs, tmp_path / "out")
    assert ranked(found) == (OPEN if is_lost else [])


def without_loop(stage: Usd.Stage) -> None:
    joints = [UsdPhysics.Joint(prim) for prim in stage.Traverse() if prim.IsA(UsdPhysics.Joint)]
    (loop,) = (joint for joint in joints if joint.GetExcludeFromArticulationAttr().Get())
    loop.GetPrim().SetActive(False)


@needs_physx
@pytest.mark.parametrize("is_lost", [False, True])
def test_a_loop_that_the_usd_has_lost_opens_in_physx(is_lost: bool, tmp_path: Path) -> None:
    bar, start = four_bar(), {"crank_joint": 0.3, "coupler_joint": -1.4, "rocker_joint": -1.7}
    closed = close(bar.tree, bar.control.loops, start, FREE)
    home = Keyframe("home", tuple(closed.positions.items()))
    bar = replace(bar, control=replace(bar.control, keyframes=(home,)))
    inputs = usd_inputs(tmp_path, bar, without_loop if is_lost else None)
    found = run_step(PhysxLoops(robot="robot"), inputs, tmp_path / "out")
    assert ranked(found) == (OPEN if is_lost else [])


def motion(robot: TinyRobot, asked: Experiment, kind: str) -> Motion:
    """As a program answers that moves the crank; where nothing holds the loop, it alone."""
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


@pytest.mark.parametrize("kind", ["closed", "open", "nan", "refused"])
def test_a_loop_that_newton_does_not_hold_is_an_error(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = four_bar()

    def perform(_: NewtonLoops, __: Path, experiments: Sequence[Experiment]) -> dict[str, Outcome]:
        (asked,) = experiments
        assert asked.steps * asked.setting.timestep == 3.0 and asked.setting.base == "asset"
        assert set(asked.start or ()) == {"crank_joint", *FREE}
        if kind == "refused":
            return {"loops": Outcome(None, None, "ValueError: no articulation")}
        return {"loops": Outcome(None, motion(robot, asked, kind))}

    monkeypatch.setattr(NewtonLoops, "perform", perform)
    check = NewtonLoops(robot="bot", environment="newton")
    findings, figures = checked(check, laid_out(tmp_path / "in", robot), tmp_path / "out")
    assert ranked(findings) == ([] if kind == "closed" else OPEN)
    if kind == "closed":
        assert figures["largest_gap"] < 1e-6 and figures["swing"]["crank_joint"] > 0.0


# --- Full effort against limits and mimic joints: a soft model fails, a stiffened one passes ---


LIMITS, COUPLINGS = LimitError.model_validate({}), CouplingError.model_validate({})


def stiff(robot: TinyRobot) -> TinyRobot:
    control = softened(robot.tree, robot.control, (Side(),), LIMITS, COUPLINGS)
    return replace(robot, control=control)


def strong() -> TinyRobot:
    """The pendulum with 500 N m: MuJoCo's default lets it (1 - d) t^2 F / I = 0.12 rad past."""
    return with_drives(pendulum(), model="pd", kp=500.0, kd=50.0, effort=500.0)


def coupled() -> TinyRobot:
    return with_mimic(tiny_quadruped(), "FL_calf_joint", "FR_calf_joint", 1.0, 0.0)


def pushed(
    robot: TinyRobot, folder: Path, source: str | None = None
) -> tuple[list[Finding], dict[str, dict]]:
    check = FullEffort(robot="robot", source=source)
    return checked(check, mjcf_inputs(folder, robot), folder / "out")


def test_a_strong_joint_runs_past_mujocos_default_limits(tmp_path: Path) -> None:
    robot = strong()
    (found,), figures = pushed(robot, tmp_path / "soft")
    assert (found.rule, found.severity) == ("limits.soft", "warning")
    error = figures["mjcf"]["limits"]["turn"]["error"]
    inertia = bare_inertia(robot.tree, robot.control)["swing_joint"]
    # At rest the limit carries what the drive, which pulls back, leaves of the load.
    limit = inertia / (0.05 * 0.02**2)
    assert error == pytest.approx(500.0 / (limit + 500.0), rel=0.1)
    assert pushed(stiff(robot), tmp_path / "stiff")[0] == []
    (told,), _ = pushed(robot, tmp_path / "told", source="arm.xml")
    assert told.severity == "info", "its MJCF says how soft they are"


def test_followers_part_from_a_strong_leader(tmp_path: Path) -> None:
    """36 N m against calves of 0.02 kg m2; MuJoCo's default parts them by 0.03 rad."""
    findings, figures = pushed(coupled(), tmp_path / "soft")
    assert "couplings.soft" in rules(findings)
    assert figures["mjcf"]["couplings"]["turn"]["joint"] == "FL_calf_joint"
    findings, figures = pushed(stiff(coupled()), tmp_path / "stiff")
    assert "couplings.soft" not in rules(findings)
    assert figures["mjcf"]["couplings"]["turn"]["error"] < 1.1 * COUPLINGS.turn


def test_a_soft_loop_opens_where_a_drive_pushes_against_it(tmp_path: Path) -> None:
    robot = four_bar()
    (loop,), rows = robot.control.loops, robot.control.actuators
    rows = (replace(rows[0], effort=500.0), *rows[1:])

    def found(folder: str, **softness: tuple[float, ...]) -> tuple[set[str], float]:
        control = replace(robot.control, actuators=rows, loops=(replace(loop, **softness),))
        findings, figures = pushed(replace(robot, control=control), tmp_path / folder)
        row = figures["mjcf"]["couplings"]["slide"]
        assert row["joint"] == "loop coupler_loop"
        return rules(findings), row["error"]

    open_by, soft = found("soft", solref=(0.02, 1.0), solimp=(0.9, 0.95, 0.001, 0.5, 2.0))
    assert "couplings.soft" in open_by
    open_by, hard = found("stiff")
    assert "couplings.soft" not in open_by
    # r = (1 - d) t^2 F / I: 500 times less by d, 16 times by t.
    assert soft / hard > 1000.0


def test_the_mjx_file_is_pushed_too(tmp_path: Path) -> None:
    targets = (Mjcf(robot="robot"), "mjcf"), (Mjx(robot="robot"), "mjx")
    inputs = laid_out(tmp_path / "in", stiff(coupled()), *targets)
    findings, figures = checked(FullEffort(robot="robot"), inputs, tmp_path / "out")
    assert findings == [] and figures.keys() == {"mjcf", "mjx"}
