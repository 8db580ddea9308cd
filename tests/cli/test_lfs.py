"""A clone without git-LFS holds pointer files: each is called that, wherever it is read."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest
from urdfs import inertial, link, mesh, robot, shape

from .conftest import Place, new_legs

POINTER = (
    "version https://git-lfs.github.com/spec/v1\n"
    "oid sha256:4d7a214614ab2935c943f9e0ff69d22eadbb8f32b1258daaa5e2ca24d17e2393\nsize 12345\n"
)
SAID = "this is a git-LFS pointer: the file itself was not downloaded"
HINT = "hint: run `git lfs pull` in the repository that it comes from"
OBJ = "mtllib part.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\nf 1/1 3/1 2/1\n"
URDF = robot(link("base", inertial(), shape("visual", mesh("part.obj"))))
MJCF = """<mujoco><asset><mesh name="part" file="part.obj"/></asset>
<worldbody><body><freejoint/><geom type="mesh" mesh="part" mass="1"/></body></worldbody></mujoco>
"""


@pytest.fixture
def place(tmp_path: Path) -> Place:
    """A robot with a mesh, its material and its picture; tests put a pointer in place of one."""
    legs = new_legs(tmp_path / "place")
    for name, text in {"part.obj": OBJ, "robot.urdf": URDF, "robot.xml": MJCF}.items():
        (legs.robot / name).write_text(text)
    (legs.robot / "part.mtl").write_text("newmtl a\nmap_Kd part.png\n")
    xacro = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="one">'
    include = '<xacro:include filename="more.xacro"/></robot>'
    (legs.robot / "robot.xacro").write_text(xacro + include)
    legs.edit('- {joints: ".*", model: pd, kp: 20, kd: 1, effort: 10, velocity: 20}', "[]")
    return legs


@pytest.mark.parametrize(
    ("key", "pointer"),
    [
        ("urdf: robot.urdf", "robot.urdf"),
        ("urdf: robot.urdf", "part.mtl"),
        ("urdf: robot.urdf", "part.png"),
        ("xacro: robot.xacro", "more.xacro"),
        ("mjcf: robot.xml", "robot.xml"),
        ("mjcf: robot.xml", "part.obj"),
        ("urdf: robot.urdf", "../legs.yaml"),
    ],
)
def test_a_pointer_in_the_place_of_a_file_is_called_that(place: Place, key: str, pointer: str):
    place.edit("urdf: four_legs.urdf", key)
    (place.robot / pointer).write_text(POINTER)
    error, hint = place.refused("build", place.name).splitlines()[-2:]
    assert error.startswith("error: ") and SAID in error and Path(pointer).name in error
    assert hint == HINT


def test_an_archive_that_is_a_pointer_and_a_member_that_is_one(place: Place):
    place.edit("path: robot, urdf: four_legs.urdf", "path: robot.zip, urdf: robot.urdf")
    archive = place.folder / "robot.zip"
    archive.write_text(POINTER)
    assert f"error: the archive: {SAID}" in place.refused("build", place.name)
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("robot.urdf", POINTER)
    assert f"error: robot.urdf: {SAID}\n{HINT}" in place.refused("build", place.name)


def test_init_of_a_pointer_says_so(place: Place):
    (place.robot / "robot.urdf").write_text(POINTER)
    told = place.refused("init", "robot/robot.urdf", "-o", "-")
    assert SAID in told and HINT in told
