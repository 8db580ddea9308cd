"""A picture is its pixels, however they are stored; exchanged ones are found in every format."""

from __future__ import annotations

import io
import json
import os
from dataclasses import replace
from pathlib import Path

import pytest
from gripper import gripper
from PIL import Image
from tiny import TinyRobot, check_inputs, run_step, tiny_quadruped

from assetbuild.facts.compare import FLOAT32, Precision, differences
from assetbuild.facts.reader import Reader
from assetbuild.facts.readers.mjcf import MjcfFacts
from assetbuild.facts.readers.urdf import UrdfFacts
from assetbuild.facts.readers.usd import UsdReader
from assetbuild.facts.reference import Assets, Reference
from assetbuild.facts.surface import pixel_digest
from assetbuild.findings import Finding
from assetbuild.kinds import Target
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.shapes import Material, Mesh, MeshAsset, Shape
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.urdf import Urdf
from assetbuild.targets.usd import Usd

WEDGE = b"""v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1
f 1/1 3/3 2/2\nf 1/1 2/2 4/4\nf 1/1 4/4 3/3\nf 2/2 3/3 4/4
"""


def textured() -> TinyRobot:
    """A trunk of oak and a hip of steel."""

    def png(colour: str) -> bytes:
        out = io.BytesIO()
        Image.new("RGB", (4, 4), colour).save(out, "PNG")
        return out.getvalue()

    robot = tiny_quadruped()
    shapes = replace(
        robot.shapes,
        shapes=(
            *robot.shapes.of("collision"),
            Shape("trunk_look", "trunk", "visual", Mesh("wedge"), material="wood"),
            Shape("hip_look", "FR_hip", "visual", Mesh("wedge"), material="metal"),
        ),
        materials=(
            Material("wood", texture="oak-11111111.png"),
            Material("metal", texture="steel-22222222.png"),
        ),
        meshes=(MeshAsset("wedge", "wedge.obj", 4, 4, convex=False),),
    )
    pictures = {"oak-11111111.png": png("brown"), "steel-22222222.png": png("silver")}
    return replace(robot, shapes=shapes, meshes={"wedge.obj": WEDGE, **pictures})


@pytest.mark.parametrize(
    ("reader", "target", "name", "pictures"),
    [
        (MjcfFacts(robot="robot"), Mjcf(robot="robot"), "mjcf", "mjcf/assets"),
        (UsdReader(robot="robot"), Usd(robot="robot"), "usd", "usd/payloads/textures"),
    ],
    ids=["mjcf", "usd"],
)
def test_pictures_that_are_exchanged_are_found(
    reader: Reader, target: Target, name: str, pictures: str, tmp_path: Path
) -> None:
    inputs = check_inputs(tmp_path, textured(), target, name)
    assert run_step(reader, inputs, tmp_path / "whole") == []
    one, other = sorted((inputs / pictures).glob("*.png"))
    first, second = one.read_bytes(), other.read_bytes()
    one.write_bytes(second)
    other.write_bytes(first)
    for picture in (one, other):  # MuJoCo keeps what it read by name and time
        os.utime(picture, (1, 1))
    found = run_step(reader, inputs, tmp_path / "exchanged")
    assert {f.severity for f in found} == {"error"}
    assert any("texture" in f.rule for f in found), [f.rule for f in found]


def test_the_same_pixels_are_the_same_picture(tmp_path: Path):
    red = Image.new("RGB", (3, 2), (200, 10, 10))
    stored = {
        "plain.png": red, "opaque.png": red.convert("RGBA"), "palette.png": red.quantize(4),
        "other.bmp": red,
    }  # fmt: skip
    for name, picture in stored.items():
        picture.save(tmp_path / name)
    assert len({pixel_digest(tmp_path / name) for name in stored}) == 1


# --- copies of the robot's own files -------------------------------------------------------------


FORMS: dict[str, tuple[type[Reader], type]] = {"mjcf": (MjcfFacts, Mjcf), "urdf": (UrdfFacts, Urdf)}


def written(form: str, folder: Path) -> Path:
    return check_inputs(folder, gripper(), FORMS[form][1](robot="robot"), form)


def proved(form: str, inputs: Path) -> list[Finding]:
    return run_step(FORMS[form][0](robot="robot"), inputs, inputs.parent / "out")


def test_a_copy_says_what_a_full_reading_says(tmp_path: Path) -> None:
    inputs = written("urdf", tmp_path)
    reference = Reference.of_ports(inputs, {})
    unknown = replace(reference, assets=replace(reference.assets, files=()))
    reader, file = UrdfFacts(robot="robot"), inputs / "urdf/robot.urdf"
    known, read = (reader.found(file, one) for one in (reference, unknown))
    assert reference.assets.files
    assert differences(read, known, Precision(FLOAT32)) == []


def test_a_copy_with_one_other_number_is_read(tmp_path: Path) -> None:
    inputs = written("urdf", tmp_path)
    mesh = inputs / "urdf/meshes/tile.obj"
    text = mesh.read_text()
    assert "v 0 0 0" in text
    mesh.write_text(text.replace("v 0 0 0", "v 0 0 0.0001", 1))
    found = {(f.rule, f.subject) for f in proved("urdf", inputs)}
    assert ("equal.urdf.mean_corner", "shape skin") in found


def test_a_bundle_states_no_bytes_so_its_files_are_read(tmp_path: Path) -> None:
    reference = Reference.of_ports(written("mjcf", tmp_path), {})
    assert json.loads(reference.to_json())["assets"]["files"] == []


def test_mujoco_reads_every_file_of_the_full_model(tmp_path: Path) -> None:
    """What it makes of a file is compared with what the build measured, whatever its bytes are."""
    inputs = written("mjcf", tmp_path)
    file = inputs / "assets.json"
    assets = decode(Assets, file.read_bytes())
    doubled = tuple((name, replace(own, area=2.0 * own.area)) for name, own in assets.surfaces)
    file.write_bytes(encode(replace(assets, surfaces=doubled, pixels=(("wood.png", "0" * 16),))))
    assert {"equal.mjcf.area", "equal.mjcf.texture"} <= {f.rule for f in proved("mjcf", inputs)}
