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
from tiny import TinyRobot, examples, pendulum, robots, run_step, write_robot_ports

from assetbuild.checks.urdf_loads import UrdfLoads, loaded
from assetbuild.findings import Finding
from assetbuild.robot.codec import decode
from assetbuild.robot.model import JointKind, Limits, Tree
from assetbuild.robot.shapes import Material, Shapes, SourceShapes
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
