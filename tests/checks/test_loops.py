"""Loops that stay closed are fine in every simulator; what opens, fails or goes to NaN is found."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdPhysics
from tiny import TinyRobot, check_inputs, four_bar, run_step, write_robot_ports

from assetbuild.checks._newton import NewtonLoops
from assetbuild.checks._physx import PhysxLoops
from assetbuild.checks.loops import Loops
from assetbuild.robot.closure import close
from assetbuild.robot.model import Keyframe
from assetbuild.simulators.experiments import Experiment, Motion, Outcome
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.usd import Usd as UsdTarget

FREE = ("coupler_joint", "rocker_joint")
NO_POSE = np.zeros((3, 3))
OPEN = [("loop.opens", "error")]
needs_physx = pytest.mark.skipif(
    importlib.util.find_spec("ovphysx") is None, reason="needs the extra `physx`"
)


def rules(check: Loops | PhysxLoops | NewtonLoops, inputs: Path, out: Path) -> list[tuple]:
    return [(finding.rule, finding.severity) for finding in run_step(check, inputs, out)]


@pytest.mark.parametrize("is_lost", [False, True])
def test_a_loop_that_the_mjcf_has_lost_opens(is_lost: bool, tmp_path: Path) -> None:
    inputs = check_inputs(tmp_path, four_bar(), Mjcf(robot="robot"), "mjcf")
    path = inputs / "mjcf/robot.xml"
    if is_lost:
        text = path.read_text()
        assert "<equality>" in text
        path.write_text(text.replace("<equality>", "<!--").replace("</equality>", "-->"))
    assert rules(Loops(robot="robot"), inputs, tmp_path / "out") == (OPEN if is_lost else [])


@needs_physx
@pytest.mark.parametrize("is_lost", [False, True])
def test_a_loop_that_the_usd_has_lost_opens_in_physx(is_lost: bool, tmp_path: Path) -> None:
    bar, start = four_bar(), {"crank_joint": 0.3, "coupler_joint": -1.4, "rocker_joint": -1.7}
    closed = close(bar.tree, bar.control.loops, start, FREE)
    home = Keyframe("home", tuple(closed.positions.items()))
    bar = replace(bar, control=replace(bar.control, keyframes=(home,)))
    inputs = check_inputs(tmp_path, bar, UsdTarget(robot="robot"), "usd")
    if is_lost:
        stage = Usd.Stage.Open(str(inputs / "usd/robot.usda"))
        joints = [prim for prim in stage.Traverse() if prim.IsA(UsdPhysics.Joint)]
        (loop,) = (
            prim for prim in joints if UsdPhysics.Joint(prim).GetExcludeFromArticulationAttr().Get()
        )
        loop.SetActive(False)
        stage.Save()
        del stage
    assert rules(PhysxLoops(robot="robot"), inputs, tmp_path / "out") == (OPEN if is_lost else [])


def motion(robot: TinyRobot, asked: Experiment, kind: str) -> Motion:
    """As a program answers that moves the crank; where nothing holds the loop, it alone."""
    assert asked.sine is not None
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
    inputs = write_robot_ports(tmp_path / "in", robot)
    found = rules(NewtonLoops(robot="bot", environment="newton"), inputs, tmp_path / "out")
    assert found == ([] if kind == "closed" else OPEN)
    figures = json.loads((tmp_path / "out/figures.json").read_text())
    if kind == "closed":
        assert figures["largest_gap"] < 1e-6 and figures["swing"]["crank_joint"] > 0.0
