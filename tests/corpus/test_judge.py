"""The judges of the corpus see a pose, a mass or a mesh that is not the source's."""

from __future__ import annotations

from pathlib import Path

import pytest
import trimesh

from corpus.judge import evaluate

URDF = """<robot name="r"><link name="base"><inertial><mass value="2"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
<visual><origin xyz="0.1 0 0"/><geometry><mesh filename="box.stl"/></geometry></visual></link>
<link name="arm"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<joint name="elbow" type="revolute"><parent link="base"/><child link="arm"/>
<origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="10" velocity="3"/></joint></robot>"""
MJCF = """<mujoco><worldbody><body name="base"><inertial pos="0 0 0" mass="2"
diaginertia="0.01 0.01 0.01"/><body name="arm" pos="0 0 0.1"><joint name="elbow" axis="0 1 0"/>
<inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.01"/></body></body></worldbody>
</mujoco>"""


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("", "", "equal"),
        ('pos="0 0 0.1"><joint', 'pos="0 0 0.11"><joint', "pose of arm by 0.01"),
        ('axis="0 1 0"', 'axis="0 -1 0"', "pose of arm"),
        ('mass="1"', 'mass="1.1"', "mass 3.1 instead of 3 kg"),
        ('<inertial pos="0 0 0.1"', '<inertial pos="0 0 0.2"', "centre of mass by 0.03"),
        ('name="elbow"', 'name="other"', "the joint elbow is not in ours"),
        ("MESH", "twice", "meshes of base: 0.24 instead of 0.06 m2"),
    ],
)
@pytest.mark.parametrize("source", ["urdf", "xml"])
def test_what_differs_is_said(source: str, old: str, new: str, says: str, tmp_path: Path):
    given, bundle = tmp_path / f"source.{source}", tmp_path / "bundle"
    for folder in ("mjcf", "urdf"):
        (bundle / folder).mkdir(parents=True)
    given.write_text(URDF if source == "urdf" else MJCF)
    (bundle / "urdf/r.urdf").write_text(URDF)
    (bundle / "mjcf/r.xml").write_text(MJCF.replace(old, new) if old else MJCF)
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "box.stl")
    edge = 0.2 if new == "twice" else 0.1
    trimesh.creation.box((edge, edge, edge)).export(bundle / "urdf/box.stl")
    said = evaluate(given, bundle, lambda uri: tmp_path / uri, edited=False)
    if source == "xml":
        of_mjcf = {"twice": "equal", 'name="other"': "no joint of the source is in ours"}
        says = of_mjcf.get(new, says)
    assert said.startswith(says)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('effort="10"', 'effort="-1"'),
        ('effort="10"', ""),
        ('<origin xyz="0 0 0.1"/><axis', '<origin xyz="0 0 0.1" rpy="0 0 0 0"/><axis'),
        ('<origin xyz="0 0 0.1"/><axis', '<origin xyz="0 0 0.1," rpy="0,0, 0"/><axis'),
        ('<limit lower="-1" upper="1" effort="10" velocity="3"/>', ""),
    ],
)
def test_what_pinocchio_alone_refuses_is_judged(old: str, new: str, tmp_path: Path):
    (tmp_path / "mjcf").mkdir()
    assert old in URDF
    (tmp_path / "source.urdf").write_text(URDF.replace(old, new))
    (tmp_path / "mjcf/r.xml").write_text(MJCF)
    assert evaluate(tmp_path / "source.urdf", tmp_path, Path, edited=False) == "equal"


def test_an_edited_robot_may_weigh_something_else(tmp_path: Path):
    (tmp_path / "mjcf").mkdir()
    (tmp_path / "source.urdf").write_text(URDF)
    (tmp_path / "mjcf/r.xml").write_text(MJCF.replace('mass="1"', 'mass="5"'))
    assert evaluate(tmp_path / "source.urdf", tmp_path, Path, edited=True) == "equal"


def test_a_joint_beside_its_body_and_a_ref_are_no_difference(tmp_path: Path):
    """Our frame of a link stands in its joint, and positions count from 0."""
    (tmp_path / "mjcf").mkdir()
    own = MJCF.replace('<joint name="elbow"', '<joint name="elbow" pos="0 0 .05" ref="20"')
    (tmp_path / "source.xml").write_text(own)
    moved = MJCF.replace('pos="0 0 0.1"><joint', 'pos="0 0 0.15"><joint')
    moved = moved.replace(
        '<inertial pos="0 0 0.1"',
        '<site name="arm_origin" pos="0 0 -.05"/><inertial pos="0 0 0.05"',
    )
    (tmp_path / "mjcf/r.xml").write_text(moved)
    assert evaluate(tmp_path / "source.xml", tmp_path, Path, edited=False) == "equal"
