"""mjlab's module is executed with stand-ins; a bug of its writer is found."""

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
    run_step,
    tiny_quadruped,
    turned,
    write_robot_ports,
)
from writer_bugs import plant

from assetbuild.facts.reader import Proof
from assetbuild.facts.readers.mjlab import MjlabReader
from assetbuild.facts.reference import Assets, Reference
from assetbuild.facts.surface import measure
from assetbuild.facts.table import Key
from assetbuild.robot.ranges import Randomize
from assetbuild.targets.mjlab import Mjlab, events, module

RANDOMIZE = Randomize.model_validate(
    {
        "links": {
            "trunk": {"density": (0.9, 1.2), "com": 0.02, "stretch": 0.1, "shear": 0.05},
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
ROWS = (".*_(hip|thigh)_joint", ".*_calf_joint")
WALKER = {"feet": ".*_foot", "imu": "imu", "rows": ROWS}


@dataclass(frozen=True)
class Built:
    """The module of a robot, and the reader that proves it."""

    path: Path
    reader: MjlabReader
    reference: Reference

    def prove(self) -> Proof:
        return self.reader.prove(self.reference, self.path)


def built(robot: TinyRobot, folder: Path, **fields: Any) -> Built:
    inputs = write_robot_ports(folder / "in", robot)
    target = Mjlab(robot="robot-1", **fields)
    run_step(target, inputs, folder / "out")
    options = {
        "mjlab": target.options.model_dump(mode="json"),
        "feet": target.feet and {"links": target.feet},
        "imu": target.imu and {"link": target.imu},
        "randomize": target.randomize and target.randomize.model_dump(mode="json"),
    }
    assets = Assets(tuple((mesh.name, measure([])) for mesh in robot.shapes.meshes))
    reference = Reference(robot.links, robot.tree, robot.shapes, robot.control, assets, options)
    reader = MjlabReader(robot="robot-1", options=options)
    path = reader.file(folder / "out/mjlab", "robot-1")
    assert path is not None
    return Built(path, reader, reference)


def quadruped() -> TinyRobot:
    """Every kind of drive that mjlab knows, and a start that is turned."""
    robot = turned(tiny_quadruped())
    models = {"FR": "pd", "FL": "ideal_pd", "RR": "dc_motor", "RL": "velocity"}
    drives = tuple(
        replace(drive, model=models[drive.joint[:2]], kd=4.0 + i, stall=70.0)
        for i, drive in enumerate(robot.control.actuators)
    )
    return replace(robot, control=replace(robot.control, actuators=drives))


@pytest.mark.parametrize("drawn", [None, RANDOMIZE])
@pytest.mark.parametrize("robot", [quadruped(), tiny_quadruped()])
def test_a_module_that_nobody_edited_is_the_robot(
    robot: TinyRobot, drawn: Randomize | None, tmp_path: Path
):
    proof = built(robot, tmp_path, randomize=drawn, **WALKER).prove()
    assert proof.findings == ()
    assert proof.compared > 100


def test_a_bundles_robot_keeps_the_order_of_patterns_of_which_the_first_wins(tmp_path: Path):
    one = built(quadruped(), tmp_path, randomize=RANDOMIZE, **WALKER)
    (tmp_path / "report").mkdir()
    (tmp_path / "report/robot.json").write_text(one.reference.to_json())
    read = Reference.of_bundle(tmp_path)
    assert one.reader.prove(read, one.path).findings == ()


def test_the_module_alone_says_the_same_as_beside_its_robot(tmp_path: Path):
    one = built(quadruped(), tmp_path, **WALKER)
    alone, beside = one.reader.read(one.path), one.prove().found
    joints = {key: value for key, value in alone.facts.items() if key.kind == "joint"}
    assert joints == {key: value for key, value in beside.facts.items() if key.kind == "joint"}
    assert joints[Key("joint", "FR_calf_joint", "armature")] == 0.02


def test_drives_without_a_limit_a_stall_torque_or_a_form_in_mjlab_are_what_they_are(tmp_path: Path):
    one = built(odd_drives(tiny_quadruped()), tmp_path, **WALKER)
    proof = one.prove()
    assert proof.findings == ()
    drives = {joint: proof.found.of("joint", joint) for joint in proof.found.names("joint")}
    assert drives["FR_hip_joint"]["model"] == "motor"
    assert drives["FR_hip_joint"]["effort"] is None
    assert drives["FR_thigh_joint"]["stall"] == 70.0
    assert "model" not in drives["FR_calf_joint"]  # general: mjlab has no form of it


BUGS = [
    (module, "_actuator", '"stiffness": a.kp, "damping": a.kd',
     '"stiffness": a.kd, "damping": a.kp', {"kp", "kd"}),
    (module, "_actuator", '"velocity":\n            fields |= {"damping": a.kd}',
     '"velocity":\n            fields |= {"stiffness": a.kd}', {"kp", "kd"}),
    (module, "_actuator", "else a.effort", "else a.velocity", {"effort"}),
    (module, "_actuator", '"saturation_effort": a.saturation', '"saturation_effort": a.effort',
     {"stall"}),
    (module, "_actuator", '"velocity_limit": a.velocity', '"velocity_limit": -a.velocity',
     {"velocity"}),
    (module, "_actuator", '"armature": a.armature, ', "", {"armature"}),
    (module, "_actuator", '"frictionloss": a.friction, "viscous_damping": a.damping',
     '"frictionloss": a.damping, "viscous_damping": a.friction', {"friction", "damping"}),
    (module, "_actuator", "group.ranges.delay, strict", "(0, group.ranges.delay[1] - 1), strict",
     {"delay"}),
    (module, "_robot", "{base.xyz!r}", "{base.xyz[::-1]!r}", {"start_pose"}),
    (module, "_robot", "{base.quat!r}", "{(*base.quat[1:], base.quat[0])!r}", {"start_pose"}),
    (module, "_robot", "{base.quat!r}", "{(1.01, *base.quat[1:])!r}",
     {"start_pose", "length_of_rot"}),
    (module, "_robot", "dict(start.joints)", "{j: -q for j, q in start.joints}", {"start"}),
    (module, "_robot", "soft_joint_pos_limit_factor={", "soft_joint_pos_limit_factor=0.5*{",
     {"soft_limits"}),
    (module, "_facts", "simulation.timestep", "2 * simulation.timestep", {"timestep", "delay"}),
    (module, "_facts", "simulation.gravity", "simulation.gravity[::-1]", {"gravity"}),
    (module, "_facts", "_bare.xml", ".xml", {"model"}),
    (module, "_robot", "spec_fn=spec", "x=0", {"unreadable"}),
    (module, "_facts", "_scale(facts, group)", "1.0", {"action_scale"}),
    (module, "_velocity", "cfg.sim.mujoco.timestep = TIMESTEP", "", {"timestep"}),
    (module, "_velocity", "cfg.decimation = DECIMATION", "", {"decimation"}),
    (module, "_velocity", "impratio = ", "impratio = 2 * ", {"impratio"}),
    (module, "_velocity", "cfg.events |= randomize_events()", "cfg.x = 0",
     {"density", "encoder_bias", "effort"}),
    (module, "_velocity", "for name in gone", "for name in gone[1:]", {"without"}),
    (events, "_log_cholesky", "math.log(low) / 2", "math.log(low)", {"density"}),
    (events, "_log_cholesky", "(-value, value)", "(0.0, value)", {"com_x"}),
    (events, "_matter", '"body_names", bodies', '"body_names", bodies[1:]', {"density"}),
    (events, "_payloads", "payload.at", "payload.size", {"box"}),
    (events, "_joints", '"kd_range": ranges.kd', '"kd_range": ranges.kp', {"kd"}),
    (events, "_joints", "getattr(ranges, key)", "ranges.friction", {"armature", "damping"}),
    (events, "_joints", "-ranges.encoder_bias, ", "0.0, ", {"encoder_bias"}),
    (events, "_joints", "{limited!r}", "{[i - 1 for i in limited]!r}", {"effort"}),
    (events, "_friction", '"operation": "abs"', '"operation": "scale"', {"operation"}),
]  # fmt: skip
"""(where, function, text, what stands there instead, quantities that must be found)."""


@pytest.mark.parametrize(("owner", "name", "old", "new", "rules"), BUGS)
def test_a_bug_of_the_writer_is_found(
    owner: ModuleType, name: str, old: str, new: str, rules: set[str], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):  # fmt: skip
    plant(monkeypatch, owner, name, old, new)
    found = built(quadruped(), tmp_path, randomize=RANDOMIZE, **WALKER).prove().findings
    about = {finding.rule.rpartition(".")[2] for finding in found}
    assert all(any(rule in what for what in about) for rule in rules), about


def test_swapped_gains_name_the_joints_and_both_values(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    plant(monkeypatch, module, *BUGS[0][1:4])
    found = {f.rule: f for f in built(tiny_quadruped(), tmp_path, **WALKER).prove().findings}
    data = found["equal.mjlab.kp"].data or {}
    assert (data["expected"], data["found"]) == (100.0, 3.0)
    assert len(data["subjects"]) == 12
    assert re.fullmatch(r"robot_1_mjlab.py:\d+", str(found["equal.mjlab.kp"].where))
