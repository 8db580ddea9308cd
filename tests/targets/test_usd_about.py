"""The USD says whose robot it is in words that libraries of assets read, and invents none."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from pxr import Gf, Sdf
from tiny import check_inputs, run_step, tiny_quadruped

from assetbuild.facts.readers.usd import UsdReader
from assetbuild.findings import Finding
from assetbuild.looks.annotate import thumbnail
from assetbuild.robot.about import About
from assetbuild.targets.usd import Usd

ABOUT = About(author="A. Maker", vendor="Legs Ltd", description="It walks", tags=("dog", "toy"))
TARGET = Usd(robot="robot", about_robot=ABOUT, licence="MIT", urdf="robots/quad.urdf")
OPTIONS: dict[str, Any] = {  # Any: plain JSON
    "about": ABOUT.model_dump(mode="json"),
    "source.license": "MIT",
    "source.urdf": "robots/quad.urdf",
}


def metadata(inputs: Path) -> dict[str, Any]:  # Any: values of USD's dictionaries
    layer = Sdf.Layer.FindOrOpen(str(inputs / "usd/robot.usda"))
    layer.Reload(force=True)
    return dict(layer.customLayerData["SimReady_Metadata"])


def compared(inputs: Path, folder: Path) -> list[Finding]:
    return run_step(UsdReader(robot="robot", options=OPTIONS), inputs, folder / "out")


def test_it_says_what_the_recipe_says_and_what_the_robot_weighs(tmp_path: Path) -> None:
    inputs = check_inputs(tmp_path, tiny_quadruped(), TARGET, "usd")
    said = metadata(inputs)
    assert (said["author"], said["vendor"], said["tags"]) == ("A. Maker", "Legs Ltd", "dog, toy")
    assert (said["asset_license"], said["source_file"]) == ("MIT", "quad.urdf")
    assert said["rigid_body_count"] == 13
    assert said["usd_date_generated"].startswith("not recorded")
    assert all(side > 0.0 for side in said["asset_extents"])
    assert compared(inputs, tmp_path) == []


def test_what_nobody_states_is_left_out(tmp_path: Path) -> None:
    said = metadata(check_inputs(tmp_path, tiny_quadruped(), Usd(robot="robot"), "usd"))
    assert not {"author", "vendor", "description", "asset_license", "source_file"} & set(said)


@pytest.mark.parametrize(
    ("word", "wrong"),
    [
        ("mass", 2.0),
        ("rigid_body_count", 3),
        ("asset_extents", Gf.Vec3f(9.0)),
        ("author", "Somebody else"),
        ("colour", "red"),
    ],
)
def test_a_wrong_or_an_invented_word_is_found(tmp_path: Path, word: str, wrong: object) -> None:
    inputs = check_inputs(tmp_path, tiny_quadruped(), TARGET, "usd")
    said = metadata(inputs) | {word: wrong}
    layer = Sdf.Layer.FindOrOpen(str(inputs / "usd/robot.usda"))
    layer.customLayerData = {"SimReady_Metadata": said}
    layer.Save()
    assert [f.severity for f in compared(inputs, tmp_path)] == ["error"]


def test_words_in_a_payload_are_not_overlooked(tmp_path: Path) -> None:
    inputs = check_inputs(tmp_path, tiny_quadruped(), TARGET, "usd")
    payload = next((inputs / "usd/payloads").glob("*.usd*"))
    layer = Sdf.Layer.FindOrOpen(str(payload))
    layer.customLayerData = {"SimReady_Metadata": {"mass": 2.0}}
    layer.Save()
    assert [f.rule for f in compared(inputs, tmp_path)] == ["equal.unread"]


def test_the_thumbnail_is_a_square_of_256_pixels() -> None:
    picture = thumbnail(np.zeros((300, 500, 3), np.uint8))
    assert Image.open(io.BytesIO(picture)).size == (256, 256)
