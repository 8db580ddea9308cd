"""A gain is no rating: what a URDF says stays as it is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from tiny import run_step, tiny_quadruped, write_robot_ports

from assetbuild.control.keep import KeepRatings
from assetbuild.robot.codec import encode
from assetbuild.robot.model import Control
from assetbuild.targets.urdf import Urdf


def kept(folder: Path, control: Control) -> bytes:
    (folder / "inputs").mkdir(parents=True)
    (folder / "inputs/control.json").write_bytes(encode(control))
    run_step(KeepRatings(), folder / "inputs", folder / "outputs")
    return (folder / "outputs/ratings.json").read_bytes()


def changed(control: Control, **values: float) -> Control:
    rows = [replace(row, **values) for row in control.actuators]
    return replace(control, actuators=tuple(rows))


@pytest.mark.parametrize("name", ["kp", "kd", "armature"])
def test_gains_keyframes_and_contacts_change_nothing(tmp_path: Path, name: str):
    control = tiny_quadruped().control
    other = changed(replace(control, keyframes=(), excludes=()), **{name: 1.25})
    assert kept(tmp_path / "a", control) == kept(tmp_path / "b", other)


@pytest.mark.parametrize("name", ["effort", "velocity", "damping", "friction"])
def test_each_rating_is_kept(tmp_path: Path, name: str):
    control = tiny_quadruped().control
    assert kept(tmp_path / "a", control) != kept(tmp_path / "b", changed(control, **{name: 1.25}))


def test_the_urdf_is_the_same_from_ratings_as_from_all_control_data(tmp_path: Path):
    robot = tiny_quadruped()
    texts = []
    for name in ("all", "ratings"):
        folder = write_robot_ports(tmp_path / name, robot)
        if name == "ratings":
            (folder / "ratings.json").write_bytes(kept(tmp_path / "kept", robot.control))
        run_step(Urdf(robot="it"), folder, tmp_path / f"{name}-out")
        texts.append((tmp_path / f"{name}-out/urdf/it.urdf").read_bytes())
    assert texts[0] == texts[1]
    assert b"effort" in texts[0]
