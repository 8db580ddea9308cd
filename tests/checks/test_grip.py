"""A pincher holds what it should; with a weak drive or a pyramidal cone it does not."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hands import COUPLED, PINCHER, robot
from tiny import run_step

from assetbuild.checks.grip import Gripping
from assetbuild.findings import Finding
from assetbuild.simulators.gripping import GripWish

PADS = 'priority="1" solref="0.004 1" solimp="0.95 0.99 0.001"'


def pincher(folder: Path, **changed: str) -> Path:
    text = robot(PINCHER, ["left"], folder, COUPLED).read_text()
    for old, new in {'size=".01 .005 .03"': f'size=".01 .005 .03" {PADS}', **changed}.items():
        assert old in text
        text = text.replace(old, new)
    inputs = folder / "inputs"
    (inputs / "mjcf").mkdir(parents=True)
    (inputs / "mjcf/robot.xml").write_text(text)
    return inputs


def evaluate(inputs: Path, check: Gripping) -> tuple[list[Finding], dict[str, dict]]:
    findings = run_step(check, inputs, inputs.parent / "out")
    return findings, json.loads((inputs.parent / "out/figures.json").read_text())


def test_a_pincher_holds_cube_cylinder_and_sphere(tmp_path: Path) -> None:
    findings, figures = evaluate(pincher(tmp_path), Gripping(robot="robot"))
    assert findings == []
    rows = figures["mjcf"]["palm"]
    assert [row["shape"][:2] for row in rows] == ["cu", "cu", "cy", "cy", "sp", "sp"]
    for row in rows:
        assert row["held"]
        assert row["width_m"] == 0.04
        # The drive is commanded to 0 and held at 20 mm: 400 N/m times that, for two fingers.
        assert row["forces_n"] == pytest.approx([4.0, 4.0], rel=0.1)


def test_a_pincher_without_strength_loses_them_and_says_what_it_holds(tmp_path: Path) -> None:
    weak = {'forcerange="-40 40"': 'forcerange="-1 1"'}
    (lost,), _ = evaluate(pincher(tmp_path, **weak), Gripping(robot="robot"))
    assert lost.rule == "grip.lost"
    assert "a cube of 40 mm and 0.5 kg is lost" in lost.message
    assert "it holds a cube of 0.05 kg" in lost.message


@pytest.mark.slow
def test_a_pyramidal_cone_lets_them_slip(tmp_path: Path) -> None:
    soft = {'cone="elliptic" impratio="50"': 'cone="pyramidal" impratio="1"'}
    (lost,), figures = evaluate(pincher(tmp_path, **soft), Gripping(robot="robot"))
    assert "slips by" in lost.message
    assert max(row["slip_m"] for row in figures["mjcf"]["palm"] if row["held"]) > 0.002


def test_a_robot_without_a_hand_is_told(tmp_path: Path) -> None:
    turning = {'type="slide"': 'type="hinge"'}
    (found,), _ = evaluate(pincher(tmp_path, **turning), Gripping(robot="robot"))
    assert (found.rule, found.severity) == ("grip.hand", "info")


def test_keyframes_that_are_not_there_are_an_error_of_the_recipe(tmp_path: Path) -> None:
    check = Gripping(robot="robot", wish=GripWish(keyframes=("open", "fist")))
    (found,), _ = evaluate(pincher(tmp_path), check)
    assert (found.rule, found.severity) == ("grip.hand", "warning")
    assert "no keyframe `open`" in found.message


@pytest.mark.slow
def test_an_object_that_does_not_fit_is_told(tmp_path: Path) -> None:
    """A block on the palm takes the room between the fingers."""
    block = {'pos="0 0 -.005"/>': 'pos="0 0 -.005"/><geom type="box" size=".02 .05 .2"/>'}
    (found,), _ = evaluate(pincher(tmp_path, **block), Gripping(robot="robot"))
    assert (found.rule, found.severity) == ("grip.hand", "warning")
    assert "no object fits" in found.message


@pytest.mark.slow
def test_a_solver_that_stops_early_lets_them_slip(tmp_path: Path) -> None:
    """MuJoCo scales its tolerance by the whole robot's mean inertia: heavy ones stop early."""
    early = {'cone="elliptic"': 'cone="elliptic" tolerance="0.1"'}
    (lost,), _ = evaluate(pincher(tmp_path, **early), Gripping(robot="robot"))
    assert lost.rule == "grip.lost"
