"""What does not fall freely is found."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from tiny import TinyRobot, check_inputs, pendulum, run_step, tiny_quadruped

from assetbuild.checks.free_fall import FreeFall
from assetbuild.findings import Finding
from assetbuild.pipeline.recipes import whole_model
from assetbuild.robot.model import Simulation
from assetbuild.simulators.experiments import Fall
from assetbuild.targets.mjcf import Mjcf


def check(robot: TinyRobot, folder: Path, spoil: dict[str, str] | None = None) -> list[Finding]:
    inputs = check_inputs(folder, robot, Mjcf(robot="robot"), "mjcf")
    path = inputs / "mjcf/robot.xml"
    text = path.read_text()
    for old, new in (spoil or {}).items():
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    return run_step(FreeFall(robot="robot"), inputs, folder / "out")


def test_quadruped_falls_as_the_integrator_must(tmp_path: Path) -> None:
    assert check(tiny_quadruped(), tmp_path) == []
    figures = json.loads((tmp_path / "out/figures.json").read_text())
    assert figures["drop_m"] == pytest.approx(9.81 / 2 * 0.4 * 0.405, rel=1e-9)


def test_side_wind_of_gravity_is_no_error_but_along_it(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    moon = replace(robot.control, simulation=Simulation(gravity=(0.5, 0.0, -1.62)))
    assert check(replace(robot, control=moon), tmp_path) == []


@pytest.mark.parametrize(
    ("spoil", "severity"),
    [
        ({'<freejoint name="floating_base_joint"/>': ""} | {"<key ": "<!-- <key "}, "error"),
        ({'<body name="trunk"': '<body name="trunk" gravcomp="0.5"'}, "error"),
        ({'<body name="FR_calf"': '<body name="FR_calf" gravcomp="0.5"'}, "warning"),
    ],
    ids=["welded to the world", "half weightless", "one calf half weightless"],
)
def test_what_does_not_fall_freely_is_found(
    tmp_path: Path, spoil: dict[str, str], severity: str
) -> None:
    if "<key " in spoil:
        spoil = {k: v for k, v in spoil.items() if k != "<key "}
        spoil |= {"<keyframe>": "<!--", "</keyframe>": "-->"}
    found = check(tiny_quadruped(), tmp_path, spoil)
    assert [(f.rule, f.severity) for f in found] == [("free_fall.drop", severity)]


def test_fixed_base_is_not_dropped_and_says_so(tmp_path: Path) -> None:
    found = check(pendulum(), tmp_path)
    assert [(f.rule, f.severity) for f in found] == [("free_fall.fixed_base", "info")]


def test_file_that_does_not_load_is_an_error(tmp_path: Path) -> None:
    found = check(tiny_quadruped(), tmp_path, {"</mujoco>": ""})
    assert [(f.rule, f.severity) for f in found] == [("free_fall.load", "error")]


def test_recipe_decides_whether_and_how_long() -> None:
    base = {"schema": "assetbuild/v1", "robot": "r", "source": {"path": ".", "urdf": "r.urdf"}}
    asked = whole_model().model_validate(base | {"validate": {"free_fall": {"seconds": 0.2}}})
    unasked = whole_model().model_validate(base | {"validate": {"free_fall": None}})
    elsewhere = whole_model().model_validate(base | {"validate": {"simulators": ["physx"]}})
    assert FreeFall.configure(asked) == FreeFall(robot="r", drop=Fall(seconds=0.2))
    assert FreeFall.configure(unasked) is None
    assert FreeFall.configure(elsewhere) is None
