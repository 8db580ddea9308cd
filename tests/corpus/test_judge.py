"""The judges of the corpus see a pose, a mass or a mesh that is not the source's."""

from __future__ import annotations

from pathlib import Path

import pytest
import trimesh
from urdfs import LIMIT, inertial, joint, link, mesh, robot, shape

from tests.corpus.judge import evaluate

URDF = robot(
    link("base", inertial(2.0), shape("visual", mesh("box.stl"), "0.1 0 0")),
    link("arm", inertial(xyz="0 0 0.1")),
    joint("elbow", "base", "arm", xyz="0 0 0.1"),
)
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


def judged(folder: Path, source: str, built: str, *, edited: bool = False) -> str:
    """What is said of two texts."""
    given = folder / ("source.xml" if "<mujoco>" in source else "source.urdf")
    given.write_text(source)
    (folder / "mjcf").mkdir()
    (folder / "mjcf/r.xml").write_text(built)
    return evaluate(given, folder, Path, edited=edited)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('effort="9"', 'effort="-1"'),
        ('effort="9"', ""),
        ('<origin xyz="0 0 0.1"/><parent', '<origin xyz="0 0 0.1" rpy="0 0 0 0"/><parent'),
        ('<origin xyz="0 0 0.1"/><parent', '<origin xyz="0 0 0.1," rpy="0,0, 0"/><parent'),
        (LIMIT, ""),
    ],
)
def test_what_pinocchio_alone_refuses_is_judged(old: str, new: str, tmp_path: Path):
    assert old in URDF
    assert judged(tmp_path, URDF.replace(old, new), MJCF) == "equal"


def test_an_edited_robot_may_weigh_something_else(tmp_path: Path):
    assert judged(tmp_path, URDF, MJCF.replace('mass="1"', 'mass="5"'), edited=True) == "equal"


def test_a_joint_beside_its_body_and_a_ref_are_no_difference(tmp_path: Path):
    """Our frame of a link stands in its joint, and positions count from 0."""
    own = MJCF.replace('<joint name="elbow"', '<joint name="elbow" pos="0 0 .05" ref="20"')
    moved = MJCF.replace('pos="0 0 0.1"><joint', 'pos="0 0 0.15"><joint')
    moved = moved.replace(
        '<inertial pos="0 0 0.1"',
        '<site name="arm_origin" pos="0 0 -.05"/><inertial pos="0 0 0.05"',
    )
    assert judged(tmp_path, own, moved) == "equal"
