"""Two pictures that are exchanged, in the source or in one format, are noticed."""

from __future__ import annotations

import io
import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image
from tiny import run_step, tiny_quadruped, write_robot_ports

from assetbuild.checks.textures import Textures
from assetbuild.findings import Finding
from assetbuild.robot.shapes import Material, Mesh, MeshAsset, Shape
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.usd import Usd

TEXTURED = """v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1
f 1/1 3/3 2/2\nf 1/1 2/2 4/4\nf 1/1 4/4 3/3\nf 2/2 3/3 4/4
"""
SOURCE = """<robot name="r">
  <material name="wood"><texture filename="package://r/looks/oak.png"/></material>
  <link name="trunk"><visual><material name="wood"/></visual></link>
  <link name="FR_hip"><visual><material name="m"><texture filename="steel.png"/></material>
  </visual></link></robot>"""


def png(color: str) -> bytes:
    out = io.BytesIO()
    Image.new("RGB", (4, 4), color).save(out, "PNG")
    return out.getvalue()


def built(folder: Path) -> Path:
    """A trunk of oak and a hip of steel, in both formats."""
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
        meshes=(MeshAsset("wedge", "wedge.obj", 4, 4, convex=True),),
    )
    files = {"oak-11111111.png": png("brown"), "steel-22222222.png": png("silver")}
    meshes = {"wedge.obj": TEXTURED.encode(), **files}
    inputs = write_robot_ports(folder / "in", replace(robot, shapes=shapes, meshes=meshes))
    for target, name in ((Mjcf(robot="r"), "mjcf"), (Usd(robot="r"), "usd")):
        run_step(target, inputs, folder / "built")
        (folder / "built" / name).rename(inputs / name)
    (inputs / "source.urdf").write_text(SOURCE)
    return inputs


def told(inputs: Path) -> list[Finding]:
    out = inputs.parent / "out"
    shutil.rmtree(out, ignore_errors=True)
    return run_step(Textures(robot="r"), inputs, out)


def test_every_shape_wears_its_own_picture(tmp_path: Path) -> None:
    assert told(built(tmp_path)) == []
    figures = json.loads((tmp_path / "out/figures.json").read_text())
    assert figures == {"materials": 2, "MJCF": 2, "USD": 2}


@pytest.mark.parametrize(
    ("folder", "said"), [("mjcf/assets", "MJCF"), ("usd/payloads/textures", "USD")]
)
def test_exchanged_files_of_one_format_are_told(folder: str, said: str, tmp_path: Path) -> None:
    inputs = built(tmp_path)
    one, other = sorted((inputs / folder).glob("*.png"))
    first, second = one.read_bytes(), other.read_bytes()
    one.write_bytes(second)
    other.write_bytes(first)
    found = told(inputs)
    assert [(f.rule, f.severity) for f in found] == [("texture.exchanged", "warning")] * 2
    assert [f.subject for f in found] == ["material wood", "material metal"]
    assert f"in the {said} it shows the picture of `metal`" in found[0].message


def test_exchanged_materials_of_one_file_are_told(tmp_path: Path) -> None:
    inputs = built(tmp_path)
    path = inputs / "mjcf/r.xml"
    text = path.read_text()
    assert text.count("oak-11111111.png") == text.count("steel-22222222.png") == 1
    text = text.replace("oak-11111111.png", "x").replace("steel-22222222.png", "oak-11111111.png")
    path.write_text(text.replace('"x"', '"steel-22222222.png"'))
    assert {f.subject for f in told(inputs)} == {"material wood", "material metal"}


def test_pictures_other_than_the_source_states_are_told(tmp_path: Path) -> None:
    inputs = built(tmp_path)
    swapped = SOURCE.replace("oak", "x").replace("steel", "oak").replace("x.png", "steel.png")
    (inputs / "source.urdf").write_text(swapped)
    found = told(inputs)
    assert [f.rule for f in found] == ["texture.exchanged"] * 2
    assert "its materials in the source name `steel`" in found[0].message


def test_a_picture_inside_of_a_mesh_is_none_that_the_source_states(tmp_path: Path) -> None:
    inputs = built(tmp_path)
    (inputs / "source.urdf").write_text(SOURCE.replace("oak", "birch"))
    assert told(inputs) == []
