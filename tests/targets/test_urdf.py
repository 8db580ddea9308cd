"""The URDF that we write reads back as the same robot."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from defusedxml.ElementTree import fromstring
from hypothesis import HealthCheck, given, settings
from random_robots import examples, robots
from robot_files import run_step, write_robot_ports
from tiny import CRANK_M, GROUND_M, TinyRobot, four_bar, pendulum, with_control

from assetbuild.checks._pinocchio import UrdfLoads, loaded
from assetbuild.control.keep import KeepRatings
from assetbuild.facts.readers.urdf import UrdfFacts
from assetbuild.findings import Finding
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Actuator, JointKind, Keyframe, Limits, LoopEnd, Tree
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import SourceShapes
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
    return with_control(replace(robot, links=links), actuators=(row,))


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


# --- loops as mimic joints -----------------------------------------------------------------------


def bar(
    rocker: float = CRANK_M, start: float = 0.5, turn: float = 0.5, coupler: float = -0.5
) -> TinyRobot:
    """A four-bar whose coupler is as long as the ground: a parallelogram, unless the rocker is
    longer than the crank. The angles are those of its start.
    """
    robot = four_bar()
    (loop,) = robot.control.loops
    ends = (LoopEnd("coupler", Pose((GROUND_M, 0, 0))), LoopEnd("rocker", Pose((rocker, 0, 0))))
    loop = replace(loop, a=ends[0], b=ends[1], urdf="mimic")
    angles = (("crank_joint", start), ("coupler_joint", coupler), ("rocker_joint", turn))
    joints = tuple(
        replace(j, limits=replace(j.limits, lower=0.2, upper=1.5)) if j.name == "crank_joint" else j
        for j in robot.tree.joints
    )
    tree = replace(robot.tree, joints=joints)
    control = replace(robot.control, loops=(loop,), keyframes=(Keyframe("home", angles),))
    return replace(robot, tree=tree, links=tree, control=control)


def written(robot: TinyRobot, folder: Path) -> tuple[list[Finding], dict[str, dict[str, str]]]:
    """Findings, and the <mimic> of each joint of the URDF, whose facts are what they should be."""
    inputs = write_robot_ports(folder / "in", robot)
    told = run_step(KeepRatings(), inputs, inputs)
    told += run_step(Urdf(robot="bar"), inputs, inputs)
    read_back = run_step(UrdfFacts(robot="bar"), inputs, folder / "check")
    assert {finding.rule for finding in read_back} <= {"lost.urdf"}
    root = fromstring((inputs / "urdf/bar.urdf").read_bytes())
    mimics = {str(j.get("name")): j.find("mimic") for j in root.iterfind("joint")}
    return told, {name: dict(m.attrib) for name, m in mimics.items() if m is not None}


def test_the_sides_of_a_parallelogram_follow_its_crank_exactly(tmp_path: Path):
    (found,), mimics = written(bar(), tmp_path)
    assert (found.rule, found.severity) == ("urdf.loop_mimic", "warning")
    assert max(found.data.values()) < 1e-8
    for name, slope in (("coupler_joint", -1.0), ("rocker_joint", 1.0)):
        assert mimics[name]["joint"] == "crank_joint"
        assert float(mimics[name]["multiplier"]) == pytest.approx(slope, abs=1e-8)
        assert float(mimics[name]["offset"]) == pytest.approx(0.0, abs=1e-8)


def test_the_error_is_told_where_the_line_is_none(tmp_path: Path):
    """The rocker of another four-bar, by the law of cosines, at 1000 angles of the crank."""
    rocker, start = 0.15, 0.5
    # The range is walked from 0.5 in steps of 1.5 / 8 rad, within the limits.
    crank = np.linspace(start - 0.1875, start + 5 * 0.1875, 1000)
    x, z = CRANK_M * np.cos(crank) - GROUND_M, CRANK_M * np.sin(crank)
    far = np.hypot(x, z)
    bend = np.arccos((far**2 + rocker**2 - GROUND_M**2) / (2 * far * rocker))
    angle = np.arctan2(z, x) - bend
    turn = float(np.interp(start, crank, angle))
    ends = rocker * np.exp(1j * turn) + GROUND_M - CRANK_M * np.exp(1j * start)
    robot = bar(rocker, start, turn, float(np.angle(ends)) - start)
    (found,), mimics = written(robot, tmp_path)
    line = [float(mimics["rocker_joint"][word]) for word in ("offset", "multiplier")]
    off = np.abs(line[0] + line[1] * crank - angle).max()
    assert found.data["rocker_joint"] == pytest.approx(off, rel=1e-6)
    assert off > 0.01


@pytest.mark.parametrize(("driven", "said"), [((), "here none"), (("rocker_joint",), "here `c")])
def test_a_loop_that_does_not_follow_one_drive_is_an_error(
    driven: tuple[str, ...], said: str, tmp_path: Path
):
    robot = bar()
    rows = {row.joint: row for row in robot.control.actuators}
    rows |= {name: replace(rows["crank_joint"], joint=name) for name in driven}
    if not driven:
        rows["crank_joint"] = Actuator("crank_joint", "passive")
    robot = with_control(robot, actuators=tuple(rows.values()))
    (found, told), mimics = written(robot, tmp_path)
    assert (found.rule, told.rule, mimics) == ("loop.mimic", "urdf.loop", {})
    assert said in found.message


def test_a_joint_that_cannot_move_has_no_line(tmp_path: Path):
    robot = bar()
    locked = tuple(
        replace(j, limits=Limits(0.5, 0.5, 5.0, 10.0)) if j.name == "crank_joint" else j
        for j in robot.tree.joints
    )
    tree = replace(robot.tree, joints=locked)
    (found, _), _ = written(replace(robot, tree=tree, links=tree), tmp_path)
    assert "cannot move" in found.message
