"""A pincher of 15 N holds what it should; one with little friction or effort does not."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from simulators.test_mujoco_hands import COUPLED, PINCHER, robot
from tiny import run_step

from assetbuild.checks.grip import Gripping
from assetbuild.findings import Finding

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


def judged(inputs: Path, check: Gripping) -> tuple[list[Finding], dict[str, dict]]:
    findings = run_step(check, inputs, inputs.parent / "out")
    return findings, json.loads((inputs.parent / "out/figures.json").read_text())


def test_a_pincher_holds_cube_cylinder_and_sphere(tmp_path: Path) -> None:
    findings, figures = judged(pincher(tmp_path), Gripping(robot="robot"))
    assert findings == []
    rows = figures["mjcf"]["palm"]
    assert [row["shape"] for row in rows] == ["cube", "cube", "cylinder", "cylinder"] + [
        "sphere"
    ] * 2
    for row in rows:
        assert row["held"]
        assert row["width_m"] == 0.04
        # The one drive of 40 N presses with both fingers, less the spring that its error leaves.
        one, other = row["forces_n"]
        assert one == pytest.approx(other, rel=0.02)
        assert 2.0 < one < 20.0


def test_a_pincher_without_strength_loses_them_and_says_what_it_holds(tmp_path: Path) -> None:
    weak = {'forcerange="-40 40"': 'forcerange="-1 1"'}
    (lost,), _ = judged(pincher(tmp_path, **weak), Gripping(robot="robot"))
    assert lost.rule == "grip.lost"
    assert "a cube of 40 mm and 0.5 kg is lost" in lost.message
    assert "it holds a cube of 0.05 kg" in lost.message


def test_a_pyramidal_cone_lets_them_slip(tmp_path: Path) -> None:
    soft = {'cone="elliptic" impratio="50"': 'cone="pyramidal" impratio="1"'}
    (lost,), figures = judged(pincher(tmp_path, **soft), Gripping(robot="robot"))
    assert "slips by" in lost.message
    assert max(row["slip_m"] for row in figures["mjcf"]["palm"] if row["held"]) > 0.002


def test_a_robot_without_a_hand_is_told(tmp_path: Path) -> None:
    inputs = pincher(tmp_path, **{'forcerange="-40 40"': 'forcerange="-40 40" group="1"'})
    flange = (inputs / "mjcf/robot.xml").read_text().replace('type="slide"', 'type="hinge"')
    (inputs / "mjcf/robot.xml").write_text(flange)
    (found,), _ = judged(inputs, Gripping(robot="robot"))
    assert (found.rule, found.severity) == ("grip.hand", "info")


def test_keyframes_that_are_not_there_are_an_error_of_the_recipe(tmp_path: Path) -> None:
    check = Gripping(robot="robot", open="open", closed="fist")
    (found,), _ = judged(pincher(tmp_path), check)
    assert (found.rule, found.severity) == ("grip.hand", "warning")
    assert "no keyframe `open`" in found.message
