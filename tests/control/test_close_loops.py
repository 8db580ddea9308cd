"""Keyframes of a robot with loops are moved until these close; loops that cannot are refused."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from robot_files import run_step, write_robot_ports
from tiny import four_bar

from assetbuild.control.close_loops import source_findings
from assetbuild.control.control import ControlStep
from assetbuild.robot.actuator_table import ActuatorRow, RowError
from assetbuild.robot.closure import close, gaps
from assetbuild.robot.codec import decode_file
from assetbuild.robot.dynamics import dynamics
from assetbuild.robot.loops import LoopRow
from assetbuild.robot.model import Control
from assetbuild.robot.model import Keyframe as SourceKeyframe
from assetbuild.robot.pose import Pose
from assetbuild.robot.sections import Keyframe

COUPLER = {"link": "coupler", "xyz": (0.2, 0.0, 0.0)}
ROCKER = {"link": "rocker", "xyz": (0.15, 0.0, 0.0)}
ROWS = ({"joints": "crank_joint", "model": "pd", "kp": 20.0, "effort": 5.0},
        {"joints": "coupler_joint|rocker_joint", "model": "passive"})  # fmt: skip


def step(*loops: dict[str, Any], rows=ROWS, home: dict[str, float] | None = None) -> ControlStep:
    said = {"crank_joint": 0.3} if home is None else home
    return ControlStep(
        rows=tuple(ActuatorRow.model_validate(row) for row in rows),
        loops=tuple(LoopRow.model_validate(loop) for loop in loops),
        keyframes={"home": Keyframe.model_validate({"joints": said})},
    )


def loop(name: str = "pin", a: dict[str, Any] = COUPLER, b: dict[str, Any] = ROCKER, **more: Any):
    return {"name": name, "a": a, "b": b, **more}


def refused(made: ControlStep) -> RowError:
    with pytest.raises(RowError) as found:
        made.check(four_bar().tree)
    return found.value


@pytest.fixture
def inputs(tmp_path: Path) -> Path:
    """The ports of the linkage, before its drives are known."""
    ports = write_robot_ports(tmp_path / "in", four_bar())
    (ports / "control.json").unlink()
    return ports


def test_joints_without_a_value_are_moved_until_the_loop_closes(inputs: Path, tmp_path: Path):
    findings = run_step(step(loop()), inputs, tmp_path)
    control = decode_file(Control, tmp_path / "control.json")
    (home,) = control.keyframes
    assert dict(home.joints)["crank_joint"] == 0.3
    assert max(gaps(four_bar().tree, control.loops, dict(home.joints)).values()) < 1e-9
    rules = {finding.rule for finding in findings}
    assert "loop.home" in rules and "actuator.tuned" not in rules


def test_the_way_in_which_a_loop_closes_is_said_by_rounded_values(inputs: Path, tmp_path: Path):
    run_step(step(loop()), inputs, tmp_path)
    (home,) = decode_file(Control, tmp_path / "control.json").keyframes
    rough = {name: round(q, 2) for name, q in home.joints} | {"crank_joint": 0.3}
    findings = run_step(step(loop(), home=rough), inputs, tmp_path)
    (again,) = decode_file(Control, tmp_path / "control.json").keyframes
    assert dict(again.joints) == pytest.approx(dict(home.joints), abs=1e-8)
    assert "loop.home" in {finding.rule for finding in findings}
    one_is_enough = step(loop(), home={k: rough[k] for k in ("crank_joint", "rocker_joint")})
    one_is_enough.check(four_bar().tree)
    rough["rocker_joint"] += 0.3
    assert "stays open" in refused(step(loop(), home=rough)).message


def test_a_frequency_acts_on_all_that_the_crank_moves_through_its_loop(
    inputs: Path, tmp_path: Path
):
    drive = {"joints": "crank_joint", "model": "pd", "frequency": 2.0, "damping_ratio": 1.0}
    rows = ({**drive, "inertia": "home"}, ROWS[1])
    findings = run_step(step(loop(), rows=rows), inputs, tmp_path)
    control = decode_file(Control, tmp_path / "control.json")
    tree, (home,) = four_bar().tree, control.keyframes

    def pose(crank: float) -> dict[str, float]:
        start = dict(home.joints) | {"crank_joint": crank}
        return dict(close(tree, control.loops, start, {"coupler_joint", "rocker_joint"}).positions)

    # The kinetic energy at 1 rad/s of the crank, by differences of closed poses.
    robot, ahead, behind = dynamics(tree, pose(0.3), {}), pose(0.3 + 1e-5), pose(0.3 - 1e-5)
    rates = np.array([(ahead[name] - behind[name]) / 2e-5 for name in robot.joints])
    inertia = float(rates @ robot.mass @ rates)
    kp = pytest.approx(inertia * (4.0 * math.pi) ** 2, rel=1e-5)
    assert control.actuators[0].kp == kp
    assert [f.data["kp_max"] for f in findings if f.rule == "actuator.tuned"] == [kp]


# All bars lie along x: the ends of the loop are 0.2 + 0.15 and 0.1 + 0.2 m from the crank's axis.
@pytest.mark.parametrize(
    ("ground", "severities"), [(0.2, ["warning"]), (0.1505, ["info"]), (0.15, [])]
)
def test_a_keyframe_of_the_source_that_leaves_a_loop_open_is_reported(
    ground: float, severities: list[str]
):
    robot = four_bar()
    *others, rocker = robot.tree.joints
    moved = replace(rocker, X_parent_joint=Pose((ground, 0.0, 0.0)))
    tree, zeros = replace(robot.tree, joints=(*others, moved)), SourceKeyframe("zero", ())
    found = list(source_findings(tree, robot.control.loops, [zeros], zeros, ()))
    assert [(f.rule, f.severity) for f in found] == [("loop.open_keyframe", s) for s in severities]
    assert [f.data["open"] for f in found] == pytest.approx([ground - 0.15] * len(found))


HELD = loop(b={"link": "base", "xyz": (0.25, 0.0, 0.0)})
"""Crank and coupler alone, pinned to the base: nothing is left to move."""
REFUSED = {
    "over a link that does not exist": (
        step(loop(b={"link": "rockr"})), ("loops", 0, "b", "link"), "no link `rockr`", "`rocker`"),
    "out of reach": (
        step(loop(b={"link": "base", "xyz": (1.0, 0.0, 0.0)})), ("loops", 0),
        "`pin` cannot close: the nearest that its ends `coupler` and `base` come is 0.7002 m",
        "the frames of both ends"),
    "two that contradict each other": (
        step(loop(), loop("bolt", b={"link": "rocker", "xyz": (0.14, 0.0, 0.0)})),
        ("keyframes", "home"), "stays open", "contradict"),
    "held open by a keyframe": (
        step(loop(), home={".*": 0.0}), ("keyframes", "home"), "stays open by", ""),
    "locks a driven joint": (
        step(HELD, home={}), ("loops", 0), "locks joint `crank_joint`",
        "must leave its driven joints a motion"),
    "between links that nothing moves apart": (
        step(loop(a={"link": "base"}, b={"link": "base", "xyz": (0.1, 0.0, 0.0)})),
        ("loops", 0), "so loop `pin` holds nothing", "with moving joints between them"),
    "a second of the same name": (
        step(loop(), loop()), ("loops", 1, "name"), "a second loop is named `pin`",
        "choose another name"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_a_wrong_loop_is_refused_with_its_key(case: str):
    made, key, message, hint = REFUSED[case]
    error = refused(made)
    assert error.key == key
    assert message in error.message and hint in error.hint
