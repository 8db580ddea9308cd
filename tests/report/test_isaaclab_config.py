"""An Isaac Lab configuration is compared without running it."""

from __future__ import annotations

from pathlib import Path

import pytest
from tiny import run_step, tiny_quadruped, write_robot_ports

from assetbuild.errors import UsageError
from assetbuild.report.diff import changes
from assetbuild.report.foreign import foreign_snapshot
from assetbuild.report.isaaclab_config import isaaclab_facts
from assetbuild.report.snapshot import Snapshot, robot_facts
from assetbuild.targets.isaaclab import IsaacLab

ROBOT = tiny_quadruped()
JOINTS = [joint.name for joint in ROBOT.tree.moving_joints]
FOREIGN = """
import math
import nowhere_to_be_found
KP = 10.0
DRIVES = lab.ImplicitActuatorCfg(
    joint_names_expr=[".*_hip_joint", ".*_thigh_joint"],
    effort_limit_sim=24.0,
    stiffness={".*_hip_joint": 2 * KP, ".*_thigh_joint": KP**2},
    damping=math.pi,
    armature=None,
)
BODY_CFG = lab.ArticulationCfg(
    init_state=lab.ArticulationCfg.InitialStateCfg(
        pos=(0.0, 0.0, 0.4), joint_pos={".*L_thigh_joint": -0.8}
    ),
    actuators={
        "legs": DRIVES,
        "knees": lab.DCMotorCfg(joint_names_expr=".*_calf_joint", stiffness=measured()),
    },
)
OTHER_CFG = BODY_CFG.replace(prim_path="/World/other")
"""


@pytest.mark.parametrize("generation", [2, 3])
def test_our_own_module_says_the_same_as_the_robot(generation: int, tmp_path: Path):
    inputs = write_robot_ports(tmp_path / "in", ROBOT)
    run_step(IsaacLab(robot="tiny"), inputs, tmp_path / "out")
    module = tmp_path / f"out/isaaclab/tiny_isaaclab_{generation}.py"
    ours = Snapshot("robot", robot_facts(ROBOT.tree, ROBOT.shapes, ROBOT.control))
    read = foreign_snapshot(module, "", JOINTS)
    assert len({joint for kind, joint, _ in read.facts if kind == "joint"}) == 12
    (start,) = changes(ours, read)  # it spawns the soles 1 mm above the floor
    assert start.quantity == "keyframe home, base, m"


def test_patterns_constants_and_sums_are_read_and_calls_are_not(tmp_path: Path):
    file = tmp_path / "robot.py"
    file.write_text(FOREIGN)
    facts = isaaclab_facts(file, "BODY_CFG", JOINTS)
    assert facts["joint", "FR_hip_joint", "kp"] == 20.0
    assert facts["joint", "FR_thigh_joint", "kp"] == 100.0
    assert facts["joint", "FR_thigh_joint", "kd"] == pytest.approx(3.14159265)
    assert facts["joint", "FR_thigh_joint", "effort"] == 24.0
    assert facts["joint", "FR_calf_joint", "model"] == "dc_motor"
    assert facts["joint", "FL_thigh_joint", "keyframe home"] == -0.8
    assert facts["joint", "FR_hip_joint", "keyframe home"] == 0.0
    assert facts["robot", "robot", "keyframe home, base, m"] == (0.0, 0.0, 0.4)
    assert ("joint", "FR_hip_joint", "armature") not in facts  # the USD says it
    assert ("joint", "FR_calf_joint", "kp") not in facts


def test_without_a_robot_beside_it_the_patterns_are_the_subjects(tmp_path: Path):
    file = tmp_path / "robot.py"
    file.write_text(FOREIGN)
    subjects = {name for kind, name, _ in isaaclab_facts(file, "", ()) if kind == "joint"}
    assert ".*_hip_joint" in subjects


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("x = (", ""),
        ("x = 1", ""),
        ("A = ArticulationCfg()\nB = ArticulationCfg()", ""),
        ("A = ArticulationCfg()", "B"),
        ("x = " + "(" * 500, ""),
    ],
)
def test_what_is_no_configuration_is_one_clear_error(text: str, name: str, tmp_path: Path):
    file = tmp_path / "robot.py"
    file.write_text(text)
    with pytest.raises(UsageError):
        isaaclab_facts(file, name, ())


def test_hostile_numbers_and_circles_end(tmp_path: Path):
    file = tmp_path / "robot.py"
    file.write_text(
        "A = B\nB = A\nN = 9**9**9**9\nC = ArticulationCfg(actuators={'x': ImplicitActuatorCfg("
        "joint_names_expr=['('], stiffness=N, damping=1/0), 'y': A})"
    )
    assert isaaclab_facts(file, "", JOINTS) == {}
