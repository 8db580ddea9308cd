"""The URDF that we write reads back as the same robot."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import pinocchio
import pytest
from hypothesis import HealthCheck, given, settings
from tiny import TinyRobot, examples, pendulum, robots, run_step, tiny_quadruped, write_robot_ports

from assetbuild.checks.urdf_loads import UrdfLoads, loaded
from assetbuild.findings import Finding
from assetbuild.robot.codec import decode
from assetbuild.robot.model import JointKind, Limits, Tree
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


@settings(max_examples=examples(20), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(robot=robots())
def test_any_robot_loads_in_urdfdom(robot: TinyRobot, tmp_path_factory: pytest.TempPathFactory):
    folder, _ = emit(robot, tmp_path_factory.mktemp("u"))
    assert loaded(folder / "bot.urdf")[1] == ""


UNLIMITED = 1e9


def one_joint(kind: JointKind, limits: Limits) -> TinyRobot:
    """A pendulum on such a joint, whose row in the actuator table limits nothing."""
    robot = pendulum()
    joint = replace(robot.links.joints[0], kind=kind, limits=limits)
    row = replace(robot.control.actuators[0], effort=None, velocity=None)
    links = replace(robot.links, joints=(joint,))
    return replace(robot, links=links, control=replace(robot.control, actuators=(row,)))


@pytest.mark.parametrize(
    ("kind", "limits", "unstated"),
    [
        ("revolute", Limits(-1.0, 1.0), "effort and velocity"),
        ("revolute", Limits(-1.0, 1.0, 5.0), "velocity"),
        ("revolute", Limits(-1.0, None, 5.0, 2.0), "upper"),
        ("revolute", Limits(-1.0, 1.0, 0.0, 0.0), "effort and velocity"),
        ("prismatic", Limits(), "lower and upper and effort and velocity"),
        ("continuous", Limits(None, None, 5.0), "velocity"),
        ("continuous", Limits(None, None, None, 2.0), "effort"),
        ("continuous", Limits(), ""),
        ("revolute", Limits(-1.0, 1.0, 5.0, 2.0), ""),
    ],
)
def test_a_limit_that_nobody_stated_is_unlimited_for_urdfdom_and_for_us(
    kind: JointKind, limits: Limits, unstated: str, tmp_path: Path
):
    """pinocchio, which reads through urdfdom, sees 1e9 or none; our reader sees the same robot."""
    robot = one_joint(kind, limits)
    folder, findings = emit(robot, tmp_path)
    assert [(f.rule, f.severity, f.data) for f in findings] == (
        [("urdf.limit.unstated", "info", {unstated: ("swing_joint",)})] if unstated else []
    )
    model = pinocchio.buildModelFromUrdf(str(folder / "bot.urdf"))
    for name, theirs in (("effort", model.effortLimit), ("velocity", model.velocityLimit)):
        stated = getattr(limits, name) or None
        assert theirs[0] == stated if stated else theirs[0] >= UNLIMITED
    if kind != "continuous":
        assert model.upperPositionLimit[0] == (limits.upper or UNLIMITED)
    again = read_back(folder, "fixed")[0].joints[0]
    wanted = replace(limits, effort=limits.effort or None, velocity=limits.velocity or None)
    assert (again.kind, again.limits) == (kind, wanted)


@pytest.mark.parametrize("attribute", ["effort", "velocity"], ids=lambda name: f"without {name}")
def test_a_urdf_that_urdfdom_refuses_is_an_error(attribute: str, tmp_path: Path):
    folder, _ = emit(pendulum(), tmp_path)
    path, inputs = folder / "bot.urdf", folder.parent
    assert run_step(UrdfLoads(robot="bot"), inputs, tmp_path / "good") == []
    path.write_text(re.sub(f' {attribute}="[^"]*"', "", path.read_text()))
    (finding,) = run_step(UrdfLoads(robot="bot"), inputs, tmp_path / "bad")
    assert (finding.rule, finding.severity) == ("urdf.refused", "error")
    assert f"limit has no {attribute}" in finding.message


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
