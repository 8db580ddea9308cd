"""Isaac Lab's modules are executed with stand-ins; a bug of their writer is found."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from tiny import (
    TinyRobot,
    odd_drives,
    pendulum,
    run_step,
    sprung,
    tiny_quadruped,
    turned,
    write_robot_ports,
)
from writer_bugs import plant

from assetbuild.errors import UsageError
from assetbuild.facts.isaaclab_config import read_config
from assetbuild.facts.reader import Proof
from assetbuild.facts.readers.isaaclab import IsaacLabReader
from assetbuild.facts.reference import Assets, Reference
from assetbuild.facts.surface import measure
from assetbuild.facts.table import Key
from assetbuild.robot.model import Actuator
from assetbuild.robot.ranges import Randomize
from assetbuild.targets.isaaclab import IsaacLab, events
from assetbuild.targets.isaaclab.module import Module

RANDOMIZE = Randomize.model_validate(
    {
        "links": {"trunk": {"density": (0.9, 1.2), "com": (0.02, 0.01, 0.0)}, ".*": {}},
        "joints": {
            ".*_calf_joint": {"kp": (0.9, 1.1), "kd": (0.8, 1.1), "delay": (1, 2)},
            ".*": {"friction": (0.5, 2.0), "armature": (0.9, 1.1)},
        },
        "friction": (0.3, 1.2),
    }
)


@dataclass(frozen=True)
class Built:
    """The modules of a robot, and the reader that proves them."""

    folder: Path
    reader: IsaacLabReader
    reference: Reference

    def file(self, kind: str) -> Path:
        return self.folder / f"robot_1_isaaclab_{kind}.py"

    def prove(self) -> Proof:
        return self.reader.prove(self.reference, self.file("2"))


def built(robot: TinyRobot, folder: Path, **fields: Any) -> Built:
    inputs = write_robot_ports(folder / "in", robot)
    target = IsaacLab(robot="robot-1", **fields)
    run_step(target, inputs, folder / "out")
    options = {
        "isaaclab": target.options.model_dump(mode="json"),
        "usd": target.usd.model_dump(mode="json"),
        "randomize": target.randomize and target.randomize.model_dump(mode="json"),
    }
    assets = Assets(tuple((mesh.name, measure([])) for mesh in robot.shapes.meshes))
    reference = Reference(robot.links, robot.tree, robot.shapes, robot.control, assets, options)
    return Built(
        folder / "out/isaaclab", IsaacLabReader(robot="robot-1", options=options), reference
    )


def quadruped() -> TinyRobot:
    """Every kind of drive that Isaac Lab knows, and a start that is turned."""
    robot = turned(tiny_quadruped())
    models = {"FR": "pd", "FL": "ideal_pd", "RR": "dc_motor", "RL": "motor"}
    drives = tuple(
        replace(drive, model=models[drive.joint[:2]], kp=80.0 + i, kd=4.0 + i, stall=70.0)
        for i, drive in enumerate(robot.control.actuators)
    )
    return replace(robot, control=replace(robot.control, actuators=drives))


@pytest.mark.parametrize("drawn", [None, RANDOMIZE])
@pytest.mark.parametrize("robot", [quadruped(), tiny_quadruped(), pendulum(), sprung()])
def test_a_module_that_nobody_edited_is_the_robot(
    robot: TinyRobot, drawn: Randomize | None, tmp_path: Path
):
    proof = built(robot, tmp_path, randomize=drawn).prove()
    assert proof.findings == ()
    assert proof.compared > 60


def test_drives_without_a_limit_or_a_form_in_isaac_lab_are_what_they_are(tmp_path: Path):
    proof = built(odd_drives(tiny_quadruped()), tmp_path).prove()
    assert proof.findings == ()
    drives = {joint: proof.found.of("joint", joint) for joint in proof.found.names("joint")}
    assert drives["FR_thigh_joint"]["stall"] == 70.0
    assert drives["FR_calf_joint"]["model"] == "motor"  # general, of which it has no form


def test_names_that_no_usd_can_have_are_still_the_robots(tmp_path: Path):
    robot = pendulum()
    (joint,) = robot.tree.joints
    tree = replace(robot.tree, joints=(replace(joint, name="swing.joint"),))
    drive = Actuator("swing.joint", "pd", kp=1.0, kd=0.1, effort=5.0, velocity=10.0)
    control = replace(robot.control, actuators=(drive,), keyframes=())
    one = built(replace(robot, tree=tree, control=control), tmp_path)
    proof = one.prove()
    assert proof.findings == ()
    assert proof.found.facts[Key("joint", "swing.joint", "kp")] == 1.0


BUGS = [
    (Module, "_values", "actuator.kp if has_kp", "actuator.kd if has_kp", {"kp"}),
    (Module, "_values", "actuator.kd if has_kd", "math.degrees(actuator.kd) if has_kd", {"kd"}),
    (Module, "_values", '"armature": actuator.armature,', "", {"armature"}),
    (Module, "_values", '"viscous_friction": actuator.damping,', "", {"damping"}),
    (Module, "_values", '"friction": actuator.friction,', '"friction": actuator.damping,',
     {"friction"}),
    (Module, "_values", "efforts, actuator.effort", "efforts, actuator.velocity", {"effort"}),
    (Module, "_values", "velocities, actuator.velocity", "velocities[1:], actuator.velocity",
     {"velocity"}),
    (Module, "_values", "efforts, velocities = LIMITS[self.generation, inside]",
     "efforts, velocities = LIMITS[5 - self.generation, inside]", {"effort", "velocity"}),
    (Module, "_values", "actuator.saturation", "actuator.effort", {"stall"}),
    (Module, "_values", "self._delay(actuator), strict", "(0, 1), strict", {"delay"}),
    (Module, "_actuators", "for a in members", "for a in members[1:]", {"kp", "model"}),
    (Module, "_base", "(x, y, z)!r", "(x, -y, z)!r", {"start_pose"}),
    (Module, "_base", "self.tree.root_pose(start)", "self.tree.X_world_root", {"start_pose"}),
    (Module, "_base", "z += self.options.clearance", "z -= self.options.clearance",
     {"start_pose"}),
    (Module, "_base", "if old else ((*xyz, w)", "if True else ((*xyz, w)", {"start_pose"}),
    (Module, "_positions", "{q!r}", "{-q!r}", {"start"}),
    (Module, "text", "dt=DT", "dt=2 * DT", {"timestep", "delay"}),
    (Module, "text", "render_interval=DECIMATION", "render_interval=1", {"decimation"}),
    (Module, "text", ", gravity=GRAVITY", ", gravity=GRAVITY[::-1]", {"gravity"}),
    (Module, "text", ".usda", ".usd", {"usd_path"}),
    (Module, "_newton", "implicitfast", "euler", {"integrator"}),
    (Module, "_rigid_body", "math.degrees(rigid.max_angular_velocity)",
     "rigid.max_angular_velocity", {"max_angular_velocity"}),
    (Module, "_articulation", '"enabled_self_collisions": solver.self_collisions',
     '"enabled_self_collisions": not solver.self_collisions', {"self_collision"}),
    (Module, "_articulation", "solver.solver_velocity_iterations", "4",
     {"solver_velocity_iteration_count"}),
    (events, "_matter", "matter.density,", "matter.density[::-1],", {"density"}),
    (events, "_matter", "(-most, most)", "(0.0, most)", {"com_x"}),
    (events, "_joints", "=ranges.kd", "=ranges.kp", {"kd"}),
    (events, "_joints", "getattr(ranges, key)\n", "ranges.friction\n",
     {"armature"}),
    (events, "_joints", "for joint in joints", "for joint in joints[1:]",
     {"friction"}),
    (events, "_friction", "dynamic_friction_range=friction", "dynamic_friction_range=(0.1, 0.2)",
     {"dynamic_surface_friction"}),
]  # fmt: skip
"""(where, function, text, what stands there instead, quantities that must be found)."""


@pytest.mark.parametrize(("owner", "name", "old", "new", "rules"), BUGS)
def test_a_bug_of_the_writer_is_found(
    owner: type | ModuleType, name: str, old: str, new: str, rules: set[str], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):  # fmt: skip
    plant(monkeypatch, owner, name, old, new)
    found = built(quadruped(), tmp_path, randomize=RANDOMIZE).prove().findings
    about = {finding.rule.removeprefix("equal.isaaclab.") for finding in found}
    assert all(any(what.endswith(rule) for what in about) for rule in rules), about


@pytest.mark.parametrize("generation", ["2", "3"])
def test_a_number_of_one_module_alone_is_found(generation: str, tmp_path: Path):
    one = built(tiny_quadruped(), tmp_path)
    file = one.file(generation)
    file.write_text(file.read_text().replace("stiffness=100.0", "stiffness=99.0"))
    (found,) = one.prove().findings
    data = found.data or {}
    assert (found.rule, data["expected"], data["found"]) == ("equal.isaaclab.kp", 100.0, 99.0)
    assert len(data["subjects"]) == 12


@pytest.mark.parametrize(
    "other",
    ["None", "[1, 'a']", "'soft'", "10**400", "float('nan')", "print", "{}"],
)
def test_a_value_of_any_form_is_a_finding(other: str, tmp_path: Path):
    one = built(tiny_quadruped(), tmp_path)
    file = one.file("2")
    for field in ("stiffness=", "pos=", "joint_pos=", "dt=", "actuators=", "spawn="):
        text = file.read_text()
        file.write_text(re.sub(rf"\b{field}", f"{field}{other} if True else ", text))
        assert one.prove().findings, field
        file.write_text(text)


def test_a_module_that_is_gone_is_an_error(tmp_path: Path):
    one = built(pendulum(), tmp_path)
    one.file("3").unlink()
    assert [finding.rule for finding in one.prove().findings] == ["equal.unreadable"]


# --- anybody's configuration ------------------------------------------------------------------

JOINTS = [joint.name for joint in tiny_quadruped().tree.moving_joints]
FOREIGN = """
import math
import nowhere_to_be_found as lab
from nowhere_to_be_found import measured
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


@pytest.mark.parametrize("generation", ["2", "3"])
def test_our_own_module_is_a_configuration_like_any_other(generation: str, tmp_path: Path):
    one = built(turned(tiny_quadruped()), tmp_path)
    facts = read_config(one.file(generation), "", JOINTS).facts
    expected = one.reader.expected(one.reference).facts
    assert len(facts) == 12 * 8 + 2
    for key, value in facts.items():
        assert value == pytest.approx(expected[key]), key


def test_patterns_constants_and_sums_are_read_and_calls_are_not(tmp_path: Path):
    file = tmp_path / "robot.py"
    file.write_text(FOREIGN)
    facts = read_config(file, "BODY_CFG", JOINTS).facts
    assert facts[Key("joint", "FR_hip_joint", "kp")] == 20.0
    assert facts[Key("joint", "FR_thigh_joint", "kp")] == 100.0
    assert facts[Key("joint", "FR_thigh_joint", "kd")] == pytest.approx(3.14159265)
    assert facts[Key("joint", "FR_thigh_joint", "effort")] == 24.0
    assert facts[Key("joint", "FR_calf_joint", "model")] == "dc_motor"
    assert facts[Key("joint", "FL_thigh_joint", "start")] == -0.8
    assert facts[Key("joint", "FR_hip_joint", "start")] == 0.0
    assert facts[Key("robot", "", "start pose")] == (0.0, 0.0, 0.4, 1.0, 0.0, 0.0, 0.0)
    assert Key("joint", "FR_hip_joint", "armature") not in facts  # the USD says it
    assert Key("joint", "FR_calf_joint", "kp") not in facts


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("x = (", ""),
        ("x = 1", ""),
        ("x = nowhere", ""),
        ("from lab import ArticulationCfg as C\nA = C()\nB = C()", ""),
        ("from lab import ArticulationCfg as C\nA = C()", "B"),
    ],
)
def test_what_is_no_configuration_is_one_clear_error(text: str, name: str, tmp_path: Path):
    file = tmp_path / "robot.py"
    file.write_text(text)
    with pytest.raises(UsageError):
        read_config(file, name, ())
