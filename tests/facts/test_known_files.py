"""A copy of the robot's own mesh or picture is known by its bytes, and proves no less."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest
from gripper import gripper
from tiny import check_inputs, run_step

from assetbuild.facts.compare import FLOAT32, Precision, differences
from assetbuild.facts.mjcf_meshes import leave_out_copies
from assetbuild.facts.reader import Reader
from assetbuild.facts.readers.bare import BareFacts
from assetbuild.facts.readers.mjcf import MjcfFacts
from assetbuild.facts.readers.mjx import MjxFacts
from assetbuild.facts.readers.urdf import UrdfFacts
from assetbuild.facts.reference import Assets, Reference
from assetbuild.findings import Finding
from assetbuild.robot.codec import decode, encode
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.mjlab import Mjlab
from assetbuild.targets.mjx import Mjx
from assetbuild.targets.urdf import Urdf

FORMS: dict[str, tuple[type[Reader], type, str, str]] = {
    "mjcf": (MjcfFacts, Mjcf, "robot.xml", "assets/tile.obj"),
    "mjx": (MjxFacts, Mjx, "robot_mjx.xml", "assets/tile.obj"),
    "mjlab": (BareFacts, Mjlab, "mjcf/robot_bare.xml", "mjcf/assets/tile.obj"),
    "urdf": (UrdfFacts, Urdf, "robot.urdf", "meshes/tile.obj"),
}
"""By target: reader, target, main file and a mesh of it."""


def written(form: str, folder: Path) -> Path:
    return check_inputs(folder, gripper(), FORMS[form][1](robot="robot"), form)


def proved(form: str, inputs: Path) -> list[Finding]:
    return run_step(FORMS[form][0](robot="robot"), inputs, inputs.parent / "out")


@pytest.mark.parametrize("form", FORMS)
def test_a_copy_proves_no_less_than_a_full_reading(form: str, tmp_path: Path) -> None:
    inputs = written(form, tmp_path)
    reference = Reference.of_ports(inputs, {})
    unknown = replace(reference, assets=replace(reference.assets, files=()))
    reader, main = FORMS[form][0](robot="robot"), inputs / form / FORMS[form][2]
    known, read = (reader.found(main, one) for one in (reference, unknown))
    assert reference.assets.files
    assert differences(read, known, Precision(FLOAT32)) == []
    scaled, count = re.subn(
        r'(<mesh [^>]*"[^"]*tile.obj")', r'\1 scale="1 1 1.001"', main.read_text(), count=1
    )
    assert count == 1
    mesh = inputs / form / FORMS[form][3]
    moved = mesh.read_text().replace("v 0 0 0", "v 0 0 0.0001", 1)
    for file, text, quantities in (
        (main, scaled, ("area", "scale")), (mesh, moved, ("mean_corner",)),
    ):  # fmt: skip
        whole = file.read_text()
        file.write_text(text)
        os.utime(file, (1, 1))  # MuJoCo keeps what it read by name and time
        found = {(f.rule, f.subject) for f in proved(form, inputs)}
        assert {(f"equal.{reader.form}.{q}", "shape skin") for q in quantities} & found
        file.write_text(whole)


def test_what_acts_is_compiled_from_its_file(tmp_path: Path) -> None:
    inputs = written("mjcf", tmp_path)
    known = Reference.of_ports(inputs, {}).assets.known
    path = inputs / "mjcf/robot.xml"
    copies = leave_out_copies(mujoco.MjSpec.from_file(str(path)), known)
    assert sorted(copies.surfaces) == ["tile"], "`block` collides"
    assert len(copies.pixels) == 1
    # A body whose mass follows from its mesh needs the mesh.
    path.write_text(re.sub(r"<inertial [^>]*/>", "", path.read_text()))
    copies = leave_out_copies(mujoco.MjSpec.from_file(str(path)), known)
    assert not copies.surfaces


def test_mujoco_reads_every_file_of_the_full_model(tmp_path: Path) -> None:
    """What it makes of a file is compared with what the build measured, whatever its bytes are."""
    inputs = written("mjcf", tmp_path)
    file = inputs / "assets.json"
    assets = decode(Assets, file.read_bytes())
    doubled = tuple((name, replace(own, area=2.0 * own.area)) for name, own in assets.surfaces)
    file.write_bytes(encode(replace(assets, surfaces=doubled, pixels=(("wood.png", "0" * 16),))))
    assert {"equal.mjcf.area", "equal.mjcf.texture"} <= {f.rule for f in proved("mjcf", inputs)}
