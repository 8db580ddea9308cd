"""A picture is its pixels, however they are stored; exchanged ones are found in every format."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from gripper import gripper
from PIL import Image
from tiny import check_inputs, run_step

from assetbuild.facts.compare import FLOAT32, Precision, differences
from assetbuild.facts.reader import Reader
from assetbuild.facts.readers.mjcf import MjcfFacts
from assetbuild.facts.readers.urdf import UrdfFacts
from assetbuild.facts.reference import Assets, Reference
from assetbuild.facts.surface import pixel_digest
from assetbuild.findings import Finding
from assetbuild.robot.codec import decode, encode
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.urdf import Urdf


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
