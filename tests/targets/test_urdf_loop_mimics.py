"""A URDF follows a loop by mimic joints where the recipe asks for it, and says how well."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from defusedxml.ElementTree import fromstring
from tiny import CRANK_M, GROUND_M, TinyRobot, four_bar, run_step, write_robot_ports

from assetbuild.control.keep import KeepRatings
from assetbuild.facts.readers.urdf import UrdfFacts
from assetbuild.findings import Finding
from assetbuild.robot.model import Actuator, Keyframe, Limits, LoopEnd
from assetbuild.robot.pose import Pose
from assetbuild.targets.urdf import Urdf


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
    control = replace(robot.control, actuators=tuple(rows.values()))
    (found, told), mimics = written(replace(robot, control=control), tmp_path)
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
