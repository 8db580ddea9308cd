"""The URDF that we write reads back as the same robot."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from tiny import TinyRobot, examples, pendulum, robots, run_step, tiny_quadruped, write_robot_ports

from assetbuild.findings import Finding
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Limits, Tree
from assetbuild.robot.shapes import Material, Shapes, SourceShapes
from assetbuild.robot.tree import depth_first, held_by_world
from assetbuild.source.urdf.read_urdf import ReadUrdf
from assetbuild.targets.urdf import Urdf


def emit(robot: TinyRobot, tmp_path: Path, name: str = "a") -> tuple[Path, list[Finding]]:
    inputs = write_robot_ports(tmp_path / f"{name}_in", robot)
    findings = run_step(Urdf(robot="bot"), inputs, tmp_path / f"{name}_out")
    return tmp_path / f"{name}_out" / "urdf", findings


def read_back(folder: Path, base: str = "floating") -> tuple[Tree, SourceShapes]:
    inputs, outputs = folder.parent / "again_in", folder.parent / "again_out"
    inputs.mkdir()
    (inputs / "robot.urdf").write_bytes((folder / "bot.urdf").read_bytes())
    run_step(ReadUrdf(file="bot.urdf", base=base), inputs, outputs)  # type: ignore[arg-type] # a literal
    for mesh in json.loads((outputs / "meshes.json").read_text()):
        assert (folder / mesh["path"]).is_file()
    tree = decode(Tree, (outputs / "links.json").read_bytes())
    return tree, decode(SourceShapes, (outputs / "shapes.json").read_bytes())


def xml(folder: Path) -> ET.Element:
    return ET.parse(folder / "bot.urdf").getroot()  # noqa: S314 # our own file


@settings(max_examples=examples(30), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(robot=robots())
def test_mass_properties_and_limits_survive_to_the_bit(
    robot: TinyRobot, tmp_path_factory: pytest.TempPathFactory
):
    bare = replace(robot, links=replace(robot.links, frames=()))
    folder, _ = emit(bare, tmp_path_factory.mktemp("a"))
    tree, _ = read_back(folder, robot.links.base)
    expected = held_by_world(robot.links)
    assert tree.bodies == expected.bodies
    for ours, theirs in zip(tree.joints, expected.joints, strict=True):
        assert (ours.name, ours.kind, ours.parent) == (theirs.name, theirs.kind, theirs.parent)
        assert (ours.limits.lower, ours.limits.upper) == (theirs.limits.lower, theirs.limits.upper)
        if theirs.kind != "fixed":
            assert ours.axis == pytest.approx(theirs.axis, abs=1e-15)
        difference = ours.X_parent_joint.matrix() - theirs.X_parent_joint.matrix()
        assert abs(difference).max() < 1e-12


def test_every_link_fixed_joint_and_shape_is_there(tmp_path: Path):
    robot = tiny_quadruped()
    folder, findings = emit(robot, tmp_path)
    tree, shapes = read_back(folder)
    assert findings == []
    assert {b.name for b in tree.bodies} == {b.name for b in robot.links.bodies}
    assert {j.name for j in tree.joints} == {j.name for j in robot.links.joints}
    capsules = 8  # each becomes three pieces
    assert len(shapes.shapes) == len(robot.shapes.shapes) + 2 * capsules
    assert {m.name for m in shapes.materials} == {"grey", "red"}


def test_a_capsule_is_a_cylinder_between_two_spheres(tmp_path: Path):
    folder, _ = emit(pendulum(), tmp_path)
    pieces = xml(folder).findall("link[@name='arm']/collision")
    found = [(p.find("geometry")[0].tag, p.find("origin").get("xyz")) for p in pieces]  # type: ignore[index,union-attr] # both are there
    assert found == [
        ("cylinder", "0.0 0.0 -0.25"),
        ("sphere", "0.0 0.0 -0.04999999999999999"),
        ("sphere", "0.0 0.0 -0.45"),
    ]


def test_effort_velocity_damping_and_friction_are_the_actuators(tmp_path: Path):
    robot = tiny_quadruped()
    first, *rest = robot.control.actuators
    changed = replace(first, effort=1.5, velocity=2.5, damping=0.25, friction=0.75)
    control = replace(robot.control, actuators=(changed, *rest))
    folder, _ = emit(replace(robot, control=control), tmp_path)
    joint = xml(folder).find(f"joint[@name='{first.joint}']")
    assert joint is not None
    assert joint.find("limit").attrib == {  # type: ignore[union-attr] # it is there
        "lower": "-0.86",
        "upper": "0.86",
        "effort": "1.5",
        "velocity": "2.5",
    }
    assert joint.find("dynamics").attrib == {"damping": "0.25", "friction": "0.75"}  # type: ignore[union-attr] # as above


def test_a_limit_that_nobody_stated_is_left_out_and_told(tmp_path: Path):
    robot = pendulum()
    joint = replace(robot.links.joints[0], limits=Limits(-1.0, 1.0))
    control = replace(
        robot.control, actuators=(replace(robot.control.actuators[0], effort=None, velocity=None),)
    )
    links = replace(robot.links, joints=(joint,))
    folder, (finding,) = emit(replace(robot, links=links, control=control), tmp_path)
    assert (finding.rule, finding.subject) == ("urdf.limit.unstated", "robot")
    assert finding.data == {"effort and velocity": ("swing_joint",)}
    assert xml(folder).find("joint/limit").attrib == {"lower": "-1.0", "upper": "1.0"}  # type: ignore[union-attr] # it is there


def test_a_limit_of_0_that_counts_as_unlimited_stays_0(tmp_path: Path):
    """Or no parser of URDFs would take the file."""
    robot = pendulum()
    joint = replace(robot.links.joints[0], limits=Limits(-1.0, 1.0, 0.0, 0.0))
    control = replace(
        robot.control, actuators=(replace(robot.control.actuators[0], effort=None, velocity=None),)
    )
    links = replace(robot.links, joints=(joint,))
    folder, findings = emit(replace(robot, links=links, control=control), tmp_path)
    limit = xml(folder).find("joint/limit").attrib  # type: ignore[union-attr] # it is there
    assert (limit["effort"], limit["velocity"]) == ("0.0", "0.0")
    assert not findings


def test_any_name_is_escaped(tmp_path: Path):
    robot = pendulum()
    odd = "a<b>&\"c' 材质"
    links = replace(robot.links, name=odd)
    shapes = Shapes(materials=(Material(odd),))
    folder, _ = emit(replace(robot, links=links, shapes=shapes), tmp_path)
    assert xml(folder).get("name") == odd
    tree, read = read_back(folder, "fixed")
    assert (tree.name, read.materials[0].name) == (odd, odd)


def test_meshes_and_textures_lie_beside_it_under_relative_paths(tmp_path: Path):
    robot = tiny_quadruped()
    wood = Material("wood", texture="wood.png")
    shapes = replace(robot.shapes, materials=(*robot.shapes.materials, wood))
    meshes = {**robot.meshes, "wood.png": b"png"}
    folder, _ = emit(replace(robot, shapes=shapes, meshes=meshes), tmp_path)
    assert sorted(p.name for p in (folder / "meshes").iterdir()) == ["trunk_box.obj", "wood.png"]
    assert [m.get("filename") for m in xml(folder).iter("mesh")] == ["meshes/trunk_box.obj"]


def test_the_same_robot_gives_the_same_bytes(tmp_path: Path):
    texts = {
        (emit(tiny_quadruped(), tmp_path, name)[0] / "bot.urdf").read_bytes() for name in ("a", "b")
    }
    assert len(texts) == 1


def test_links_are_written_depth_first_as_the_tree_has_them(tmp_path: Path):
    robot = tiny_quadruped()
    names, joints = depth_first(robot.links.root, robot.links.joints)
    bodies = tuple(robot.links.by_body[name] for name in names)
    folder, _ = emit(
        replace(robot, links=replace(robot.links, bodies=bodies, joints=joints)), tmp_path
    )
    assert [link.get("name") for link in xml(folder).findall("link")] == list(names)
