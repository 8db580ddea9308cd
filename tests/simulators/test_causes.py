"""A robot that PhysX loses: the cause that is named is the one that was planted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from tiny import tiny_quadruped, with_mimic

from assetbuild.simulators.experiments import Experiment, Outcome, Setting
from assetbuild.simulators.physx import causes as physx_causes
from assetbuild.simulators.physx.causes import cause_of, overlap_hint

LOST = Outcome(None, None, "PhysX lost its numbers (NaN) after 0.1 s")
FINE = Outcome(None, None)
EXPERIMENT = Experiment("sine", Setting(0.002, (0.0, 0.0, -9.81)), steps=1)


def answer(monkeypatch: pytest.MonkeyPatch, healed_by: tuple[str, ...]) -> None:
    """A PhysX that keeps its numbers only without the speed limits of `healed_by`."""

    def perform(_: Path, experiments: tuple[Experiment, ...]) -> dict[str, Outcome]:
        (one,) = experiments
        return {one.name: FINE if one.setting.unhurried == healed_by else LOST}

    monkeypatch.setattr(physx_causes.physx, "perform", perform)


def test_speed_limits_of_followers_are_named_where_they_are_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    robot = with_mimic(tiny_quadruped(), "FL_hip_joint", "FR_hip_joint", 1.5, 0.0)
    answer(monkeypatch, ("FL_hip_joint",))
    found = cause_of(tmp_path, EXPERIMENT, robot.tree, robot.control)
    assert found is not None
    said, hint = found
    assert "1 joints that mimic others (`FL_hip_joint`)" in said
    assert "velocity: unlimited" in hint


def test_nothing_is_named_where_it_changes_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    robot = with_mimic(tiny_quadruped(), "FL_hip_joint", "FR_hip_joint", 1.5, 0.0)
    answer(monkeypatch, ("another",))
    assert cause_of(tmp_path, EXPERIMENT, robot.tree, robot.control) is None
    free = tuple(replace(a, velocity=None) for a in robot.control.actuators)
    answer(monkeypatch, ())
    control = replace(robot.control, actuators=free)
    assert cause_of(tmp_path, EXPERIMENT, robot.tree, control) is None


def test_the_exclude_to_write_is_there_with_its_depths() -> None:
    hint = overlap_hint({("body", "thigh_fr"): 0.0119, ("body", "thigh_fl"): 0.0111})
    assert "(11.9, 11.1 mm)" in hint
    assert "`collision.exclude.pairs: [[body, thigh_fr], [body, thigh_fl]]`" in hint
    assert overlap_hint({}) == ""
