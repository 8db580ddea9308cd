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

RECIPE = """schema: assetbuild/v1
robot: r
source: {{path: {path}, {main}, license: MIT}}
collision: {{default: {{method: none}}}}
targets: [urdf]
"""
LAUGHS = "".join(f'<!ENTITY e{n + 1} "{f"&e{n};" * 10}">' for n in range(9))
BOMB = f'<!DOCTYPE x [<!ENTITY e0 "ha">{LAUGHS}]><robot name="&e9;"/>'.encode()
XACRO = b'<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">%s</robot>'
CORNERS = np.arange(18.0).reshape(2, 3, 3)
OBJ = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n"


def showing(*meshes: str) -> bytes:
    """A URDF whose only link shows these."""
    shown = [shape("visual", mesh(name)) for name in meshes]
    return robot(link("base", inertial(), *shown)).encode()


def picture_bomb() -> bytes:
    """A PNG of 900 million pixels in 70 bytes."""
    out = io.BytesIO()
    Image.new("RGB", (2, 2)).save(out, format="PNG")
    data = out.getvalue().replace(struct.pack(">II", 2, 2), struct.pack(">II", 30_000, 30_000), 1)
    return data.replace(data[29:33], struct.pack(">I", zlib.crc32(data[12:29])), 1)


def escaping_archive() -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("r.urdf", showing("m.stl"))
        archive.writestr("../../escaped.stl", stl(CORNERS))
    return out.getvalue()


CASES: dict[str, tuple[dict[str, bytes | str], int, str]] = {
    "entities in a description": (
        {"r.urdf": BOMB}, 2, "r.urdf:1: a DOCTYPE is not allowed",
    ),
    "a picture without end": (
        {
            "r.urdf": showing("m.obj"),
            "m.obj": OBJ,
            "a.mtl": b"newmtl m\nmap_Kd w.png\n",
            "w.png": picture_bomb(),
        },
        1, "the picture `w.png` is too large",
    ),
    "a name that no disk holds": (
        {"r.urdf": showing("a" * 300 + ".stl")}, 2, "no file `aaaa",
    ),
    "a mesh from elsewhere": (
        {"r.urdf": showing("../secret.stl"), "../secret.stl": stl(CORNERS)},
        2, "leads out of the source",
    ),
    "a link out of the source": (
        {"r.urdf": showing("m.stl"), "../secret.stl": stl(CORNERS), "m.stl": "../secret.stl"},
        2, "is a link that leads out of the source",
    ),
    "a xacro that includes a file outside": (
        {
            "../secret.xacro": XACRO % b'<link name="secret"/>',
            "r.xacro": XACRO % b'<xacro:include filename="../secret.xacro"/>',
        },
        2, "secret.xacro",
    ),
    "an archive that escapes": ({"../robot.zip": escaping_archive()}, 2, "escaped.stl"),
}  # fmt: skip
"""Name -> files of the source (a text: what a link leads to), exit code, words of the error."""


@pytest.fixture
def tiny(tmp_path: Path) -> Place:
    place = Place(tmp_path / "work", tmp_path / "store", "r.yaml")
    place.robot.mkdir(parents=True)
    return place


def write(place: Place, files: dict[str, bytes | str]) -> None:
    """The files, and the recipe of the robot among them."""
    for name, data in files.items():
        path = place.robot / name
        if isinstance(data, str):
            path.symlink_to(data)
        else:
            path.write_bytes(data)
    source = "robot.zip" if "../robot.zip" in files else "robot"
    main = "xacro: r.xacro" if "r.xacro" in files else "urdf: r.urdf"
    place.recipe.write_text(RECIPE.format(path=source, main=main))


def everything(folder: Path) -> set[str]:
    """All paths but those of the store."""
    return {
        str(path) for path in folder.rglob("*") if folder / "store" not in (path, *path.parents)
    }


@pytest.mark.parametrize("name", CASES)
def test_a_hostile_file_is_one_error(tiny: Place, name: str):
    files, code, says = CASES[name]
    write(tiny, files)
    outside = tiny.folder.parent / "temporary"
    outside.mkdir()
    before = everything(tiny.folder.parent)
    variables = {"TMPDIR": str(outside), "HOME": str(outside)}
    assert says in tiny.refused("build", "r.yaml", code=code, **variables)
    assert everything(tiny.folder.parent) == before


def test_every_broken_mesh_is_named_at_once(tiny: Place):
    meshes = {"a.stl": stl(CORNERS, count=9), "b.stl": b"garbage", "c.stl": stl(CORNERS**2)}
    write(tiny, {"r.urdf": showing(*meshes), **meshes})
    done = tiny.build("-j1")
    assert done.returncode == 1
    assert done.stderr.count("error: ") == 2, done.stderr
    assert "a.stl: the header promises 9 faces" in done.stderr
    assert "b.stl: 7 bytes are too few" in done.stderr
    assert not (tiny.folder / "build").exists()
