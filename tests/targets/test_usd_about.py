"""The USD says whose robot it is in words that libraries of assets read, and invents none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pxr import Sdf
from tiny import check_inputs, tiny_quadruped

from assetbuild.robot.sections import About
from assetbuild.targets.usd import Usd

ABOUT = About(author="A. Maker", vendor="Legs Ltd", description="It walks", tags=("dog", "toy"))
TARGET = Usd(robot="robot", about_robot=ABOUT, licence="MIT", urdf="robots/quad.urdf")


def metadata(inputs: Path) -> dict[str, Any]:  # Any: values of USD's dictionaries
    layer = Sdf.Layer.FindOrOpen(str(inputs / "usd/robot.usda"))
    layer.Reload(force=True)
    return dict(layer.customLayerData["SimReady_Metadata"])


def test_it_says_what_the_recipe_says_and_what_the_robot_weighs(tmp_path: Path) -> None:
    inputs = check_inputs(tmp_path, tiny_quadruped(), TARGET, "usd")
    said = metadata(inputs)
    assert (said["author"], said["vendor"], said["tags"]) == ("A. Maker", "Legs Ltd", "dog, toy")
    assert (said["asset_license"], said["source_file"]) == ("MIT", "quad.urdf")
    assert said["rigid_body_count"] == 13
    masses = [body.inertial.mass_kg for body in tiny_quadruped().tree.bodies if body.inertial]
    assert said["mass"] == pytest.approx(sum(masses))
    assert said["usd_date_generated"].startswith("not recorded")
    assert all(side > 0.0 for side in said["asset_extents"])


def test_what_nobody_states_is_left_out(tmp_path: Path) -> None:
    said = metadata(check_inputs(tmp_path, tiny_quadruped(), Usd(robot="robot"), "usd"))
    assert not {"author", "vendor", "description", "asset_license", "source_file"} & set(said)
