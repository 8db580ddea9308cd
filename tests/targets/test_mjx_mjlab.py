"""The mjx model has the same joints and poses; the bare one keeps mjlab's contract."""

from __future__ import annotations

import ast
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from tiny import TinyRobot, check_inputs, pendulum, run_step, tiny_quadruped, write_robot_ports

from assetbuild.errors import StepError
from assetbuild.facts.readers.mjlab import MjlabReader
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Actuator, General, Place, Sensor, Tree
from assetbuild.robot.ranges import Randomize
from assetbuild.robot.shapes import Mesh
from assetbuild.targets.isaaclab import IsaacLab
from assetbuild.targets.mjlab import Mjlab
from assetbuild.targets.mjlab.module import MjlabOptions
from assetbuild.targets.mjx import Mjx, MjxOptions


def built(robot: TinyRobot, folder: Path, target: object) -> Path:
    inputs = write_robot_ports(folder / "in", robot)
    run_step(target, inputs, folder / "out")
    return folder / "out"


def test_contacts_with_fewer_dimensions_are_told(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    sole = robot.control.contact.model_copy(update={"condim": 6, "priority": 1})
    control = replace(robot.control, contacts=(("FR_foot_collision", sole),))
    inputs = write_robot_ports(tmp_path / "in", replace(robot, control=control))
    asked = MjxOptions.model_validate({"condim": 3})
    (finding,) = run_step(Mjx(robot="robot", options=asked), inputs, tmp_path / "out")
    assert (finding.rule, finding.data) == ("mjx.condim", {"condim": 3, "was": 6})
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out/mjx/robot_mjx.xml"))
    assert set(model.geom_condim) == {3}
    assert model.geom("FR_foot_collision").priority == 1
    assert run_step(Mjx(robot="robot"), inputs, tmp_path / "as_it_is") == []
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "as_it_is/mjx/robot_mjx.xml"))
    assert model.geom("FR_foot_collision").condim == 6


def test_a_hull_with_many_corners_is_capped_and_told(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    shapes = tuple(
        replace(s, geometry=Mesh("trunk_box")) if s.name == "trunk_collision" else s
        for s in robot.shapes.shapes
    )
    inputs = write_robot_ports(
        tmp_path, replace(robot, shapes=replace(robot.shapes, shapes=shapes))
    )
    target = Mjx(robot="robot", options=MjxOptions.model_validate({"max_vertices": 4}))
    findings = run_step(target, inputs, tmp_path / "out")
    assert [f.rule for f in findings] == ["mjx.hull"]
    assert 'maxhullvert="4"' in (tmp_path / "out/mjx/robot_mjx.xml").read_text()


def test_a_pattern_that_leaves_nothing_to_stand_on_is_refused(tmp_path: Path) -> None:
    target = Mjx(robot="robot", options=MjxOptions.model_validate({"touching": "paw"}))
    with pytest.raises(StepError, match="leaves no collision shape"):
        built(tiny_quadruped(), tmp_path, target)


@pytest.mark.parametrize(("touching", "untouchable"), [(".*_foot", [13]), (".*", [])])
def test_links_that_touch_nothing_are_counted(
    touching: str, untouchable: list[int], tmp_path: Path
) -> None:
    """The trunk and three links of each leg."""
    inputs = write_robot_ports(tmp_path / "in", tiny_quadruped())
    target = Mjx(robot="robot", options=MjxOptions.model_validate({"touching": touching}))
    found = run_step(target, inputs, tmp_path / "out")
    assert [f.data["links"] for f in found if f.rule == "mjx.collision_disabled"] == untouchable


MJLAB = Mjlab(robot="robot", feet=".*_foot", imu="imu", rows=(".*_(hip|thigh)_joint", ".*_calf_joint"))  # fmt: skip # noqa: E501


def test_sensors_that_mjlab_makes_itself_are_left_out(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    touch = Sensor("touch", "contact", Place("body", "FR_calf"))
    gyro = Sensor("gyro", "gyro", Place("frame", "imu"))
    control = replace(robot.control, sensors=(touch, gyro))
    inputs = write_robot_ports(tmp_path / "in", replace(robot, control=control))
    found = run_step(MJLAB, inputs, tmp_path / "out")
    assert [f.data["sensors"] for f in found if f.rule == "mjlab.sensors"] == [("touch",)]


def table(text: str, name: str) -> Any:
    """The literal that the module gives this name."""
    (value,) = (
        n.value
        for n in ast.parse(text).body
        if isinstance(n, ast.Assign) and [getattr(t, "id", None) for t in n.targets] == [name]
    )
    return ast.literal_eval(value)


def test_the_recipe_decides_what_only_mjlab_knows(tmp_path: Path) -> None:
    options = {
        "soft_joint_pos_limit_factor": 0.8,
        "num_envs": 64,
        "cone": "pyramidal",
        "impratio": 2.5,
        "njmax": None,
        "nconmax": 90,
        "action": {"effort_share": 0.5, "rad": 0.1},
        "foot_scan": {"radius": 0.02, "samples": 6},
        "pose": {"knees": ".*_thigh_joint", "walking": [0.2, 0.4]},
    }
    asked = MjlabOptions.model_validate(options)
    target = MJLAB.model_copy(update={"options": asked})
    inputs = check_inputs(tmp_path, tiny_quadruped(), target, "mjlab")
    said = {"mjlab": asked.model_dump(), "feet": {"links": MJLAB.feet}, "imu": {"link": MJLAB.imu}}
    assert run_step(MjlabReader(robot="robot", options=said), inputs, tmp_path / "proof") == []
    text = (inputs / "mjlab/python/robot_mjlab.py").read_text()
    for said in (
        "soft_joint_pos_limit_factor=0.8,",
        "num_envs: int = 64)",
        'cfg.sim.mujoco.cone = "pyramidal"',
        "cfg.sim.mujoco.impratio = 2.5",
        "cfg.sim.njmax = None",
        "cfg.sim.nconmax = 90",
        "A share of 0.5 of the error that asks for the whole effort, at most 0.1 rad or",
        "single_ring(radius=0.02, num_samples=6)",
        '"std_walking": (0.2, 0.4),',
    ):
        assert said in text
    assert set(table(text, "ACTION_SCALE").values()) == {0.1}  # 0.5 * 24 / 100 would be 0.12
    assert table(text, "KNEES") == ("FR_thigh_joint", "FL_thigh_joint", "RR_thigh_joint", "RL_thigh_joint")  # fmt: skip # noqa: E501


def randomized(ranges: dict, folder: Path) -> tuple[str, list]:
    target = MJLAB.model_copy(update={"randomize": Randomize.model_validate(ranges)})
    inputs = write_robot_ports(folder / "in", tiny_quadruped())
    findings = run_step(target, inputs, folder / "out")
    return (folder / "out/mjlab/python/robot_mjlab.py").read_text(), findings


def test_what_mjlab_cannot_randomize_is_told(tmp_path: Path) -> None:
    wide = {"links": {".*": {"stretch": 0.1}}, "restitution": [0, 0.5]}
    text, (finding,) = randomized(wide, tmp_path)
    assert finding.rule == "mjlab.randomize"
    stretch, bounce = finding.data["without"]
    assert stretch.startswith("stretch")
    assert bounce.startswith("restitution")
    assert '"d_range": (-0.1, 0.1)' in text


def test_the_module_mounts_a_payload_as_the_matter_that_it_is(tmp_path: Path) -> None:
    payload = {"link": "FR_foot", "mass": [0, 1], "size": [0.2, 0.4, 0.6], "at": [0, 0, 0.1]}
    text, findings = randomized({"payloads": [payload]}, tmp_path)
    assert findings == []
    assert "import torch\n" in text
    (rows,) = re.findall(r'"box": (\(.*?\n +\)),', text, re.DOTALL)
    tree = decode(Tree, (tmp_path / "in/tree.json").read_bytes())
    body, X_body_link = tree.placement("FR_foot")
    assert f'"{body}",' in text
    at = np.array([0, 0, 0.1]) + X_body_link.xyz  # the foot is not turned
    # One kilogram of a box: edge²/12 along each axis, moved.
    expected = np.diag([0.2**2 / 12, 0.4**2 / 12, 0.6**2 / 12, 1.0])
    expected[:3, :3] += np.outer(at, at)
    expected[:3, 3] = expected[3, :3] = at
    assert np.allclose(ast.literal_eval(rows), expected, atol=1e-15)


def test_a_robot_without_feet_has_no_task_and_is_told(tmp_path: Path) -> None:
    inputs = write_robot_ports(tmp_path / "in", tiny_quadruped())
    findings = run_step(Mjlab(robot="robot"), inputs, tmp_path / "out")
    assert [f.rule for f in findings] == ["mjlab.imu", "mjlab.feet"]
    assert "velocity" not in (tmp_path / "out/mjlab/python/robot_mjlab.py").read_text()


@pytest.mark.parametrize(("stall", "said"), [(None, 5.0), (12.0, 12.0)])
def test_a_dc_motor_saturates_at_its_stall_torque(
    stall: float | None, said: float, tmp_path: Path
) -> None:
    robot = pendulum()
    drive = Actuator("swing_joint", "dc_motor", 9.0, effort=5.0, velocity=10.0, stall=stall)
    robot = replace(robot, control=replace(robot.control, actuators=(drive,)))
    inputs = write_robot_ports(tmp_path / "in", robot)
    found = [f.rule for f in run_step(Mjlab(robot="r"), inputs, tmp_path / "o")]
    found += [f.rule for f in run_step(IsaacLab(robot="r"), inputs, tmp_path / "i")]
    unstated = ["mjlab.saturation", "isaaclab.saturation"]
    assert found == ([] if stall else unstated)
    for file in ("o/mjlab/python/r_mjlab.py", "i/isaaclab/r_isaaclab_2.py"):
        text = (tmp_path / file).read_text()
        assert f"saturation_effort={said!r}" in text
        assert "effort_limit=5.0" in text


def test_a_general_actuator_is_told_not_dropped(tmp_path: Path) -> None:
    robot = pendulum()
    drive = Actuator("swing_joint", "general", general=General(gainprm=(1.0,)))
    robot = replace(robot, control=replace(robot.control, actuators=(drive,)))
    findings = run_step(Mjlab(robot="r"), write_robot_ports(tmp_path / "in", robot), tmp_path / "o")
    assert [f.rule for f in findings] == ["mjlab.actuator"]
