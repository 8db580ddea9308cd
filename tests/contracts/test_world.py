"""Nothing asks the world around the one door: what a build looked at stands in its record."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

ROBOTS = Path(__file__).parents[1] / "robots"
TILE = """mtllib tile.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl skin
f 1/1 2/2 3/3
f 1/1 3/3 4/4
"""
LINK = """<link name="{name}"><inertial><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>{visual}</link>"""
ARM = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="tip" default="hand"/>
  {base}
  <xacro:include filename="$(find arm_parts)/*.xacro"/>
</robot>
"""
PART = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  {tip}
  <joint name="joint" type="continuous"><parent link="base"/><child link="$(arg tip)"/>
    <axis xyz="0 0 1"/></joint>
</robot>
"""
MJCF = """<mujoco model="arm"><compiler meshdir="assets"/>
<asset><mesh file="a.obj" scale=".1 .1 .1"/></asset>
<worldbody><include file="body.xml"/></worldbody></mujoco>"""
BODY = """<mujocoinclude><body name="base"><geom size=".1" group="3"/>
<geom type="mesh" mesh="a" contype="0" conaffinity="0" group="2"/>
<body name="tip" pos="0 0 .3"><joint name="j" axis="0 1 0" range="-30 30" damping="0.1"/>
<geom name="ball" size=".05" group="3"/></body></body></mujocoinclude>"""
TET = "v 0 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
HEAD = "schema: assetbuild/v1\nrobot: r\ncollision: {default: {method: keep}}\n"
PD = 'actuators: [{joints: ".*", model: pd, kp: 9, kd: 1, effort: 30, velocity: 20}]\n'
TARGETS = "targets: [urdf, mjcf, mjx, usd, mjlab, isaaclab]\n"
MOTORS = "hip: {rotor_inertia: 1.0e-4, gear: 6, effort: 30, velocity: 20}\n"


def urdf(folder: Path) -> str:
    """A dog with a mesh, its material, its picture behind a link, a licence, a motor file."""
    robot = folder / "dog"
    robot.mkdir()
    text = (ROBOTS / "four_legs.urdf").read_text()
    shape = '<visual><geometry><mesh filename="tile.obj"/></geometry></visual>'
    at = text.index("</inertial>") + len("</inertial>")
    (robot / "dog.urdf").write_text(text[:at] + shape + text[at:])
    (robot / "tile.obj").write_text(TILE)
    (robot / "tile.mtl").write_text("newmtl skin\nmap_Kd skin.png\n")
    Image.new("RGB", (4, 4), "red").save(robot / "red.png")
    (robot / "skin.png").symlink_to("red.png")
    (robot / "LICENSE").write_text("MIT")
    (folder / "motors.yaml").write_text(MOTORS)
    rows = 'actuators: [{joints: ".*", model: pd, kp: 9, kd: 1, motor: hip}]\n'
    source = "source: {path: dog, urdf: dog.urdf, license: MIT}\nmotor_file: motors.yaml\n"
    return HEAD + source + rows + TARGETS


def xacro(folder: Path) -> str:
    """A xacro with an argument, that includes all files of a package."""
    parts = folder / "robot/parts"
    parts.mkdir(parents=True)
    (folder / "robot/arm.xacro").write_text(ARM.format(base=LINK.format(name="base", visual="")))
    (parts / "tip.xacro").write_text(PART.format(tip=LINK.format(name="$(arg tip)", visual="")))
    source = (
        "source:\n  path: robot\n  xacro: arm.xacro\n  args: {tip: finger}\n"
        "  packages: {arm_parts: parts}\n  license: MIT\nbase: fixed\n"
    )
    return HEAD + source + PD + TARGETS


def mjcf(folder: Path) -> str:
    """An MJCF with an include and a mesh."""
    (folder / "robot/assets").mkdir(parents=True)
    (folder / "robot/arm.xml").write_text(MJCF)
    (folder / "robot/body.xml").write_text(BODY)
    (folder / "robot/assets/a.obj").write_text(TET)
    return HEAD + "source: {path: robot, mjcf: arm.xml, license: MIT}\n" + PD + TARGETS


def composite(folder: Path) -> str:
    """The xacro's arm on the dog."""
    (folder / "arm.yaml").write_text(xacro(folder).replace("robot: r", "robot: arm"))
    row = "compose: [{recipe: arm.yaml, as: arm_, at: {link: trunk}}]\n"
    return urdf(folder) + row


@pytest.fixture(params=[urdf, xacro, mjcf, composite], ids=lambda made: made.__name__)
def built(request: pytest.FixtureRequest, tmp_path: Path) -> dict[str, Any]:
    """What a cold build of a robot asked, and what it recorded."""
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "r.yaml").write_text(request.param(folder))
    return asking(folder, folder / "r.yaml")


def asking(folder: Path, recipe: Path) -> dict[str, Any]:
    """Run `asking.py` with an empty store."""
    program = Path(__file__).with_name("asking.py")
    out = folder / "out" / "r"
    out.parent.mkdir()
    environment = {**os.environ, "ASSETBUILD_CACHE": str(folder.parent / "store")}
    done = subprocess.run(
        [sys.executable, str(program), str(recipe), str(out)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    assert not found["errors"]
    assert found["whole"]
    return found


@pytest.mark.slow
def test_all_that_a_cold_build_looked_at_stands_in_its_record(built: dict[str, Any]):
    assert built["lacking"] == []
    files = {subject for kind, subject, _ in built["recorded"] if kind == "bytes"}
    assert {Path(file).name for file in files} >= {"r.yaml"}
    assert ["variable", "MUJOCO_GL", ""] in built["recorded"]
