"""Files made to do harm: one clear error, its exit code, and nothing written outside."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tiny import stl
from urdfs import inertial, link, mesh, robot, shape

from .conftest import Place

URDF = robot(link("base", inertial(), shape("visual", mesh("{mesh}"))))
RECIPE = """schema: assetbuild/v1
robot: r
source: {{path: {path}, {main}, license: MIT}}
collision: {{default: {{method: none}}}}
targets: [urdf]
"""
LAUGHS = "".join(f'<!ENTITY e{n + 1} "{f"&e{n};" * 10}">' for n in range(9))
BOMB = f'<!DOCTYPE x [<!ENTITY e0 "ha">{LAUGHS}]>'


def picture_bomb() -> bytes:
    """A PNG of 900 million pixels in 70 bytes."""
    out = io.BytesIO()
    Image.new("RGB", (2, 2)).save(out, format="PNG")
    data = out.getvalue().replace(struct.pack(">II", 2, 2), struct.pack(">II", 30_000, 30_000), 1)
    return data.replace(data[29:33], struct.pack(">I", zlib.crc32(data[12:29])), 1)


CORNERS = np.arange(18.0).reshape(2, 3, 3)
OBJ = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n"
CASES: dict[str, tuple[dict[str, bytes], int, str]] = {
    "entities in a description": (
        {"r.urdf": f'{BOMB}<robot name="&e9;"/>'.encode()},
        2,
        "r.urdf:1: a DOCTYPE is not allowed",
    ),
    "a picture without end": (
        {
            "r.urdf": URDF.format(mesh="m.obj").encode(),
            "m.obj": OBJ,
            "a.mtl": b"newmtl m\nmap_Kd w.png\n",
            "w.png": picture_bomb(),
        },
        1,
        "the picture `w.png` is too large",
    ),
    "a name that no disk holds": (
        {"r.urdf": URDF.format(mesh="a" * 300 + ".stl").encode()},
        2,
        "no file `aaaa",
    ),
    "a mesh from elsewhere": (
        {"r.urdf": URDF.format(mesh="../secret.stl").encode(), "../secret.stl": stl(CORNERS)},
        2,
        "leads out of the source",
    ),
}


@pytest.fixture
def tiny(tmp_path: Path) -> Place:
    return Place(tmp_path / "work", tmp_path / "store")


def refused(place: Place, code: int, says: str, source: str, main: str) -> None:
    (place.folder / "r.yaml").write_text(RECIPE.format(path=source, main=main))
    outside = place.folder.parent / "temporary"
    outside.mkdir()
    before = everything(place.folder.parent)
    done = place.run("build", "r.yaml", TMPDIR=str(outside), HOME=str(outside))
    assert done.returncode == code, done.stdout + done.stderr
    assert "Traceback" not in done.stderr + done.stdout
    assert done.stderr.count("error: ") == 1, done.stderr
    assert says in done.stderr, done.stderr
    assert everything(place.folder.parent) == before


def everything(folder: Path) -> set[str]:
    """All paths but those of the store."""
    return {
        str(path) for path in folder.rglob("*") if folder / "store" not in (path, *path.parents)
    }


@pytest.mark.parametrize("name", CASES)
def test_a_hostile_file_is_one_error(tiny: Place, name: str):
    files, code, says = CASES[name]
    for path, data in files.items():
        target = tiny.folder / "robot" / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(data)
    refused(tiny, code, says, "robot", "urdf: r.urdf")


def test_a_link_out_of_the_source_is_one_error(tiny: Place):
    (tiny.folder / "robot").mkdir(parents=True)
    (tiny.folder / "secret.stl").write_bytes(stl(CORNERS))
    (tiny.folder / "robot/r.urdf").write_text(URDF.format(mesh="m.stl"))
    (tiny.folder / "robot/m.stl").symlink_to("../secret.stl")
    refused(tiny, 2, "is a link that leads out of the source", "robot", "urdf: r.urdf")


def test_an_archive_that_escapes_is_one_error(tiny: Place):
    tiny.folder.mkdir()
    with zipfile.ZipFile(tiny.folder / "robot.zip", "w") as archive:
        archive.writestr("r.urdf", URDF.format(mesh="m.stl"))
        archive.writestr("../../escaped.stl", stl(CORNERS))
    refused(tiny, 2, "escaped.stl", "robot.zip", "urdf: r.urdf")


def test_every_broken_mesh_is_named_at_once(tiny: Place):
    (tiny.folder / "robot").mkdir(parents=True)
    meshes = {
        "a.stl": stl(CORNERS, count=9),
        "b.stl": b"garbage",
        "c.stl": stl(CORNERS**2),
    }
    for name, data in meshes.items():
        (tiny.folder / "robot" / name).write_bytes(data)
    shown = "".join(
        f'<visual><geometry><mesh filename="{name}"/></geometry></visual>' for name in meshes
    )
    text = URDF.format(mesh="c.stl").replace("</link>", f"{shown}</link>")
    (tiny.folder / "robot/r.urdf").write_text(text)
    (tiny.folder / "r.yaml").write_text(RECIPE.format(path="robot", main="urdf: r.urdf"))
    done = tiny.run("build", "r.yaml", "-j1")
    assert done.returncode == 1
    assert done.stderr.count("error: ") == 2, done.stderr
    assert "a.stl: the header promises 9 faces" in done.stderr
    assert "b.stl: 7 bytes are too few" in done.stderr
    assert not (tiny.folder / "build").exists()


def test_a_xacro_that_includes_a_file_outside_is_one_error(tiny: Place):
    (tiny.folder / "robot").mkdir(parents=True)
    head = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    (tiny.folder / "secret.xacro").write_text(f'{head}<link name="secret"/></robot>')
    include = '<xacro:include filename="../secret.xacro"/>'
    (tiny.folder / "robot/r.xacro").write_text(f"{head}{include}</robot>")
    refused(tiny, 2, "secret.xacro", "robot", "xacro: r.xacro")
