"""Trainers' modules: what they give is recorded; a bug of their writers is found."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from robot_files import run_step, write_robot_ports
from tiny import TinyRobot, odd_drives, pendulum, sprung, tiny_quadruped, turned, with_control
from writer_bugs import plant

from assetbuild.engine.step import Step
from assetbuild.errors import UsageError
from assetbuild.facts.reader import Proof, Reader
from assetbuild.facts.readers.isaaclab import IsaacLabReader, read_config
from assetbuild.facts.readers.mjlab import MjlabReader
from assetbuild.facts.reference import Assets, Reference
from assetbuild.facts.surface import measure
from assetbuild.facts.table import Key
from assetbuild.robot.model import Actuator
from assetbuild.robot.ranges import Randomize
from assetbuild.targets.isaaclab import IsaacLab, Module
from assetbuild.targets.isaaclab import events as lab_events
from assetbuild.targets.mjlab import Mjlab, events, module

RANDOMIZE = Randomize.model_validate(
    {
        "seed": 2**63 - 1,
        "links": {
            "trunk": {
                "density": (0.9, 1.2), "com": (0.02, 0.01, 0), "stretch": 0.1, "shear": 0.05,
            },
            ".*": {},
        },
        "payloads": [{"link": "imu", "mass": (0, 3), "size": (0.2, 0.15, 0.1), "at": (0, 0, 0.1)}],
        "joints": {
            ".*_calf_joint": {
                "kp": (0.9, 1.1), "kd": (0.8, 1.1), "effort": (0.8, 1), "delay": (1, 2),
                "encoder_bias": 0.01,
            },
            ".*": {"friction": (0.5, 2.0), "armature": (0.9, 1.1), "damping": (0.9, 1.1)},
        },
        "friction": (0.3, 1.2),
    }
)  # fmt: skip
WALKER = {"feet": ".*_foot", "imu": "imu", "rows": (".*_(hip|thigh)_joint", ".*_calf_joint")}


@dataclass(frozen=True)
class Built:
    """What a target wrote of a robot, and the reader that proves it."""

    file: Path
    reader: Reader
    reference: Reference

    def prove(self) -> Proof:
        return self.reader.prove(self.reference, self.file)


def built(step: Step, reader: type[Reader], robot: TinyRobot, folder: Path, **told: Any) -> Built:
    """told: sections of the recipe."""
    ports = write_robot_ports(folder / "in", robot)
    run_step(step, ports, folder / "out")
    assets = Assets(tuple((mesh.name, measure([])) for mesh in robot.shapes.meshes))
    ranges = getattr(step, "randomize", None)
    told["randomize"] = ranges and ranges.model_dump(mode="json", by_alias=True)
    reference = Reference(robot.links, robot.tree, robot.shapes, robot.control, assets, told)
    reads = reader(robot="robot-1", options=told)
    file = reads.file(folder / "out" / reader.needs[0], "robot-1")
    assert file is not None
    return Built(file, reads, reference)


def mjlab(robot: TinyRobot, folder: Path, drawn: Randomize | None = RANDOMIZE) -> Built:
    step = Mjlab(robot="robot-1", randomize=drawn, **WALKER)
    told = {"mjlab": step.options.model_dump(mode="json"), "feet": {"links": step.feet}}
    return built(step, MjlabReader, robot, folder, **told)


def isaaclab(robot: TinyRobot, folder: Path, drawn: Randomize | None = RANDOMIZE) -> Built:
    step = IsaacLab(robot="robot-1", randomize=drawn)
    told = {name: getattr(step, field).model_dump(mode="json")
            for name, field in (("isaaclab", "options"), ("usd", "usd"))}  # fmt: skip
    return built(step, IsaacLabReader, robot, folder, **told)


Make = Callable[..., Built]


def quadruped(last: str) -> TinyRobot:
    """Every kind of drive that a trainer knows, and a start that is turned."""
    robot = turned(tiny_quadruped())
    models = {"FR": "pd", "FL": "ideal_pd", "RR": "dc_motor", "RL": last}
    drives = tuple(
        replace(drive, model=models[drive.joint[:2]], kp=80.0 + i, kd=4.0 + i, stall=70.0)
        for i, drive in enumerate(robot.control.actuators)
    )
    return with_control(robot, actuators=drives)


@pytest.mark.parametrize(
    ("make", "robot", "drawn"),
    [
        (mjlab, quadruped("velocity"), RANDOMIZE),
        (mjlab, tiny_quadruped(), None),
        (isaaclab, quadruped("motor"), RANDOMIZE),
        (isaaclab, sprung(), None),
    ],
)
def test_what_nobody_edited_is_the_robot(
    make: Make, robot: TinyRobot, drawn: Randomize | None, tmp_path: Path
):
    """Plain ones are in the contracts of readers, but for a robot with feet and with a spring."""
    proof = make(robot, tmp_path, drawn).prove()
    assert proof.findings == ()
    assert proof.compared > 60


def test_a_bundle_s_robot_and_the_module_alone_say_the_same(tmp_path: Path):
    """The first pattern that matches wins; a missing module is one error."""
    one = mjlab(quadruped("velocity"), tmp_path)
    (tmp_path / "report").mkdir()
    (tmp_path / "report/robot.json").write_text(one.reference.to_json())
    assert one.reader.prove(Reference.of_bundle(tmp_path), one.file).findings == ()
    plain = mjlab(quadruped("velocity"), tmp_path / "plain", None).prove().found
    armature = Key("joint", "FR_calf_joint", "armature")
    assert one.reader.read(one.file).facts[armature] == plain.facts[armature] == 0.02

    one.file.unlink()
    assert [finding.rule for finding in one.prove().findings] == ["equal.unreadable"]


def test_drives_without_a_limit_or_a_form_in_a_trainer_are_what_they_are(tmp_path: Path):
    for make in (mjlab, isaaclab):
        proof = make(odd_drives(tiny_quadruped()), tmp_path / make.__name__, None).prove()
        assert proof.findings == ()
        drives = {joint: proof.found.of("joint", joint) for joint in proof.found.names("joint")}
        assert drives["FR_hip_joint"]["model"] == "motor"
        assert drives["FR_hip_joint"].get("effort") is None
        assert drives["FR_thigh_joint"]["stall"] == 70.0
        # `general`: Isaac Lab makes a motor of it, mjlab has no form.
        model = "motor" if make is isaaclab else None
        assert drives["FR_calf_joint"].get("model") == model


def test_names_that_no_usd_can_have_are_still_the_robots(tmp_path: Path):
    robot = pendulum()
    (joint,) = robot.tree.joints
    tree = replace(robot.tree, joints=(replace(joint, name="swing.joint"),))
    drive = Actuator("swing.joint", "pd", kp=1.0, kd=0.1, effort=5.0, velocity=10.0)
    robot = with_control(replace(robot, tree=tree), actuators=(drive,), keyframes=())
    proof = isaaclab(robot, tmp_path, None).prove()
    assert proof.findings == ()
    assert proof.found.facts[Key("joint", "swing.joint", "kp")] == 1.0


MJLAB_BUGS = [
    (module, "_actuator", '"stiffness": a.kp, "damping": a.kd',
     '"stiffness": a.kd, "damping": a.kp', {"kp", "kd"}),
    (module, "_actuator", '"velocity":\n            fields |= {"damping": a.kd}',
     '"velocity":\n            fields |= {"stiffness": a.kd}', {"kp", "kd"}),
    (module, "_actuator", "group.ranges.delay, strict", "(0, group.ranges.delay[1] - 1), strict",
     {"delay"}),
    (module, "_robot", "{base.quat!r}", "{(*base.quat[1:], base.quat[0])!r}", {"start_pose"}),
    (module, "_robot", "dict(start.joints)", "{j: -q for j, q in start.joints}", {"start"}),
    (module, "_facts", "simulation.timestep", "2 * simulation.timestep", {"timestep", "delay"}),
    (module, "_facts", "_scale(facts, group)", "1.0", {"action_scale"}),
    (module, "_velocity", "cfg.sim.mujoco.timestep = TIMESTEP", "", {"timestep"}),
    (module, "_velocity", "cfg.events |= randomize_events()", "cfg.x = 0",
     {"density", "encoder_bias", "effort"}),
    (module, "_soles", "len(foot.geoms) == 1", "len(foot.geoms) == 2", {"feet_ground_contact"}),
    (module, "_velocity", "for name in gone", "for name in gone[1:]", {"without"}),
    (events, "_log_cholesky", "math.log(low) / 2", "math.log(low)", {"density"}),
    (events, "_payloads", "payload.at", "payload.size", {"box"}),
    (events, "_joints", '"kd_range": ranges.kd', '"kd_range": ranges.kp', {"kd"}),
    (events, "_joints", "-ranges.encoder_bias, ", "0.0, ", {"encoder_bias"}),
]  # fmt: skip
ISAACLAB_BUGS = [
    (Module, "_values", "actuator.kp if has_kp", "actuator.kd if has_kp", {"kp"}),
    (Module, "_values", "actuator.kd if has_kd", "math.degrees(actuator.kd) if has_kd", {"kd"}),
    (Module, "_values", "efforts, actuator.effort", "efforts, actuator.velocity", {"effort"}),
    (Module, "_values", "efforts, velocities = LIMITS[self.generation, inside]",
     "efforts, velocities = LIMITS[5 - self.generation, inside]", {"effort", "velocity"}),
    (Module, "_values", "self._delay(actuator), strict", "(0, 1), strict", {"delay"}),
    (Module, "_base", "self.tree.root_pose(start)", "self.tree.X_world_root", {"start_pose"}),
    (Module, "_positions", "{q!r}", "{-q!r}", {"start"}),
    (Module, "text", ".usda", ".usd", {"usd_path"}),
    (Module, "_rigid_body", "math.degrees(rigid.max_angular_velocity)",
     "rigid.max_angular_velocity", {"max_angular_velocity"}),
    (Module, "_articulation", '"enabled_self_collisions": solver.self_collisions',
     '"enabled_self_collisions": not solver.self_collisions', {"self_collision"}),
    (lab_events, "_matter", "matter.density,", "matter.density[::-1],", {"density"}),
    (lab_events, "_joints", "getattr(ranges, key)\n", "ranges.friction\n",
     {"armature"}),
]  # fmt: skip
"""(where, function, text, what stands there instead, quantities that must be found)."""
CASES = [
    (make, robot, *bug)
    for make, robot, bugs in (
        (mjlab, quadruped("velocity"), MJLAB_BUGS),
        (isaaclab, quadruped("motor"), ISAACLAB_BUGS),
    )
    for bug in bugs
]


@pytest.mark.parametrize(("make", "robot", "owner", "name", "old", "new", "rules"), CASES)
def test_a_bug_of_the_writer_is_found(
    make: Make, robot: TinyRobot, owner: type | ModuleType, name: str, old: str, new: str,
    rules: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
):  # fmt: skip
    plant(monkeypatch, owner, name, old, new)
    found = make(robot, tmp_path).prove().findings
    about = {finding.rule.rpartition(".")[2] for finding in found}
    assert all(any(rule in what for what in about) for rule in rules), about


@pytest.mark.parametrize("generation", ["2", "3"])
def test_a_number_of_one_module_alone_is_found(generation: str, tmp_path: Path):
    one = isaaclab(tiny_quadruped(), tmp_path, None)
    file = one.file.with_name(f"robot_1_isaaclab_{generation}.py")
    file.write_text(file.read_text().replace("stiffness=100.0", "stiffness=99.0"))
    (found,) = one.prove().findings
    assert found.rule == "equal.isaaclab.kp"
    assert (found.data["expected"], found.data["found"]) == (100.0, 99.0)
    assert len(found.data["subjects"]) == 12
    if generation == "2":
        assert re.fullmatch(r"robot_1_isaaclab_2.py:\d+", found.where)


@pytest.mark.parametrize(
    "other", ["None", "[1, 'a']", "'soft'", "10**400", "float('nan')", "print", "{}"]
)
def test_a_value_of_any_form_is_a_finding(other: str, tmp_path: Path):
    one = isaaclab(tiny_quadruped(), tmp_path, None)
    whole = one.file.read_text()
    for field in ("stiffness=", "pos=", "joint_pos=", "dt=", "actuators=", "spawn="):
        one.file.write_text(re.sub(rf"\b{field}", f"{field}{other} if True else ", whole))
        assert one.prove().findings, field


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
    one = isaaclab(turned(tiny_quadruped()), tmp_path, None)
    file = one.file.with_name(f"robot_1_isaaclab_{generation}.py")
    facts = read_config(file, "", JOINTS).facts
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
