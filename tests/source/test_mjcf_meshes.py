"""Meshes of an MJCF: files and what stands in its text lie where MuJoCo puts them."""

# ruff: noqa: E501 # one broken file per line reads better than wrapped XML

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from mjcfs import TET, read
from source.test_read_mjcf import robot

from assetbuild.robot.pose import rotation_of
from assetbuild.robot.shapes import MeshFile


def test_an_unevenly_scaled_mesh_keeps_its_scale(tmp_path: Path):
    head = '<asset><mesh file="tet.obj" scale="1 -2 3" refpos="1 1 1"/></asset>'
    text = robot('<body name="a"><geom type="mesh" mesh="tet"/></body>', head=head)
    shape = read(text, tmp_path, tet_obj=TET).shapes.shapes[0]
    assert shape.geometry == MeshFile("arm/tet.obj", (1.0, -2.0, 3.0))
    assert shape.X_link_shape.xyz == pytest.approx((-1.0, 2.0, -3.0))


def test_meshes_of_one_file_name_in_two_folders_are_two(tmp_path: Path):
    head = (
        '<asset><mesh name="l" file="left/hand.obj"/><mesh name="r" file="right/hand.obj"/></asset>'
    )
    body = '<body name="a"><geom name="l" type="mesh" mesh="l"/><geom name="r" type="mesh" mesh="r"/></body>'
    far = TET.replace("v 0 0 3", "v 0 0 9")
    reading = read(robot(body, head=head), tmp_path, left__hand_obj=TET, right__hand_obj=far)
    paths = [s.geometry.path for s in reading.shapes.shapes if isinstance(s.geometry, MeshFile)]
    assert paths == ["arm/left/hand.obj", "arm/right/hand.obj"] * 2, "they collide and are drawn"
    mass = reading.links.by_body["a"].inertial
    assert mass is not None and mass.mass_kg == pytest.approx(4000.0), "1 m3 and 3 m3 of water"


POINTS = 'vertex="0 0 0 1 0 0 0 2 0 0 0 3"'
INLINE = {
    "with faces": f'{POINTS} face="0 2 1 0 1 3 0 3 2 1 2 3"',
    "the hull of its points": POINTS,
    "made by MuJoCo": 'builtin="wedge" params="3 3 90 30 .1" inertia="convex"',
    "turned and scaled": f'{POINTS} scale="2 2 2" refpos=".1 .2 .3" refquat="1 .3 .2 .1"',
}


@pytest.mark.parametrize("what", INLINE)
def test_a_mesh_in_the_text_becomes_a_file(what: str, tmp_path: Path):
    text = robot(
        '<body name="a"><geom type="mesh" mesh="m"/></body>',
        head=f'<asset><mesh name="m" {INLINE[what]}/></asset>',
    )
    reading, model = read(text, tmp_path), mujoco.MjModel.from_xml_string(text)
    assert [mesh["path"] for mesh in reading.meshes] == ["(inline)/0.obj"]
    inertial = reading.links.by_body["a"].inertial
    assert inertial is not None
    assert inertial.mass_kg == pytest.approx(model.body_mass[1], rel=1e-6)
    assert inertial.com_m == pytest.approx(model.body_ipos[1], abs=1e-6)
    shape = reading.shapes.shapes[0]
    points = [
        [float(word) for word in line.split()[1:]]
        for line in (reading.files / "(inline)/0.obj").read_text().splitlines()
        if line.startswith("v ")
    ]
    assert isinstance(shape.geometry, MeshFile)
    ours = np.array([shape.X_link_shape.apply(np.array(p) * shape.geometry.scale) for p in points])
    turn = rotation_of(tuple(model.geom_quat[0]))
    theirs = model.mesh_vert @ turn.T + model.geom_pos[0]
    assert np.sort(ours, axis=0) == pytest.approx(np.sort(theirs, axis=0), abs=1e-6)
