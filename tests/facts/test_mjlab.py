"""mjlab's module is read without being run, and every change of it is found."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from mutants import is_found, literals, names
from tiny import (
    TinyRobot,
    odd_drives,
    pendulum,
    run_step,
    tiny_quadruped,
    turned,
    write_robot_ports,
)

from assetbuild.facts.reader import Proof
from assetbuild.facts.readers.mjlab import MjlabReader
from assetbuild.facts.reference import Assets, Reference
from assetbuild.facts.surface import measure
from assetbuild.facts.table import Key
from assetbuild.robot.ranges import Randomize
from assetbuild.robot.shapes import Sphere
from assetbuild.targets.mjlab import Mjlab
from assetbuild.targets.mjlab.options import MjlabOptions

RANDOMIZE = Randomize.model_validate(
    {
        "links": {
            "trunk": {"density": (0.9, 1.2), "com": 0.02, "stretch": 0.1, "shear": 0.05},
            ".*": {},
        },
        "payloads": [{"link": "imu", "mass": (0, 3), "size": (0.2, 0.15, 0.1), "at": (0, 0, 0.1)}],
        "joints": {
            ".*_calf_joint": {
                "kp": (0.9, 1.1), "effort": (0.8, 1), "delay": (1, 2), "encoder_bias": 0.01,
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

    def edited(self, change: Callable[[str], str]) -> dict[str, Any]:
        """What is found in the changed module: data of the findings by rule."""
        before = self.path.read_text()
        after = change(before)
        assert after != before
        self.path.write_text(after)
        found = {f.rule: dict(f.data or {}) for f in self.prove().findings}
        self.path.write_text(before)
        return found


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
    reference = Reference(robot.links, robot.tree, robot.shapes, robot.control, Assets(), options)
    reader = MjlabReader(robot="robot-1", options=options)
    path = reader.file(folder / "out/mjlab", "robot-1")
    assert path is not None
    return Built(path, reader, reference)


def quadruped() -> TinyRobot:
    """Every kind of drive that mjlab knows, and a start that is turned."""
    robot = turned(tiny_quadruped())
    models = {"FR": "pd", "FL": "ideal_pd", "RR": "dc_motor", "RL": "velocity"}
    drives = tuple(
        replace(drive, model=models[drive.joint[:2]], kd=4.0 + i)
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
    surfaces = tuple((mesh.name, measure([])) for mesh in one.reference.shapes.meshes)
    whole = replace(one.reference, assets=Assets(surfaces))
    (tmp_path / "report").mkdir()
    (tmp_path / "report/robot.json").write_text(whole.to_json())
    read = Reference.of_bundle(tmp_path)
    assert one.reader.prove(read, one.path).findings == ()


def test_a_robot_that_does_not_walk_has_a_module_too(tmp_path: Path):
    assert built(pendulum(), tmp_path).prove().findings == ()


def test_a_foot_of_several_shapes_is_its_body(tmp_path: Path):
    robot = tiny_quadruped()
    heel = replace(robot.shapes.shapes[-1], name="RL_heel_collision", geometry=Sphere(0.01))
    shapes = replace(robot.shapes, shapes=(*robot.shapes.shapes, heel))
    assert built(replace(robot, shapes=shapes), tmp_path, **WALKER).prove().findings == ()


def test_the_module_alone_says_the_same_as_beside_its_robot(tmp_path: Path):
    one = built(quadruped(), tmp_path, **WALKER)
    alone, beside = one.reader.read(one.path), one.prove().found
    joints = {key: value for key, value in alone.facts.items() if key.kind == "joint"}
    assert joints == {key: value for key, value in beside.facts.items() if key.kind == "joint"}
    assert joints[Key("joint", "FR_calf_joint", "armature")] == 0.02


def test_what_the_recipe_says_of_mjlab_is_expected(tmp_path: Path):
    asked = MjlabOptions.model_validate(
        {
            "num_envs": 64, "cone": "pyramidal", "impratio": 2.5, "njmax": None, "nconmax": 35,
            "soft_joint_pos_limit_factor": 0.8, "action": {"effort_share": 0.3, "rad": 0.1},
            "foot_scan": {"radius": 0.1, "samples": 8},
            "pose": {"knees": ".*_hip_joint", "walking": (0.2, 0.9)},
        }
    )  # fmt: skip
    proof = built(quadruped(), tmp_path, options=asked, **WALKER).prove()
    assert proof.findings == ()
    assert proof.found.facts[Key("simulation", "", "impratio")] == 2.5


def test_drives_without_a_limit_a_stall_torque_or_a_form_in_mjlab_are_what_they_are(tmp_path: Path):
    one = built(odd_drives(tiny_quadruped()), tmp_path, **WALKER)
    proof = one.prove()
    assert proof.findings == ()
    drives = {joint: proof.found.of("joint", joint) for joint in proof.found.names("joint")}
    assert drives["FR_hip_joint"]["model"] == "motor"
    assert drives["FR_hip_joint"]["effort"] is None
    assert drives["FR_thigh_joint"]["stall"] == 70.0
    assert "model" not in drives["FR_calf_joint"]  # general: mjlab has no form of it


def test_soles_with_names_of_their_own_are_found_by_those_of_the_bare_mjcf(tmp_path: Path):
    robot = tiny_quadruped()
    shapes = tuple(
        replace(shape, name=shape.name.replace("foot_collision", "sole"))
        for shape in robot.shapes.shapes
    )
    robot = replace(robot, shapes=replace(robot.shapes, shapes=shapes))
    proof = built(robot, tmp_path, **(WALKER | {"feet": ".*_(calf|foot)"})).prove()
    assert proof.findings == ()
    assert "FR_sole_collision" in str(proof.found.facts[Key("robot", "", "mjlab:FOOT_GEOMS")])


def test_swapped_gains_are_found(tmp_path: Path):
    one = built(tiny_quadruped(), tmp_path, **WALKER)
    swapped = {"stiffness=100.0": "stiffness=3.0", "damping=3.0": "damping=100.0"}
    found = one.edited(lambda text: re.sub("|".join(swapped), lambda hit: swapped[hit[0]], text))
    assert found["equal.mjlab.kp"] | {"subjects": ()} == {
        "expected": 100.0, "found": 3.0, "subjects": (),
    }  # fmt: skip
    assert found["equal.mjlab.kd"]["found"] == 100.0
    assert len(found["equal.mjlab.kd"]["subjects"]) == 12


@pytest.mark.parametrize("field", ["armature=0.01,", "frictionloss=0.2,", "viscous_damping=0.1,"])
def test_what_the_module_does_not_state_is_found(field: str, tmp_path: Path):
    one = built(tiny_quadruped(), tmp_path, **WALKER)
    assert field in one.path.read_text()
    found = one.edited(lambda text: re.sub(rf"\n +{field}", "", text))
    assert {None} == {said["found"] for said in found.values()}


def test_drives_in_another_order_are_found(tmp_path: Path):
    one = built(tiny_quadruped(), tmp_path, **WALKER)
    drive = r"( +Builtin\w+\((?:.|\n)*?\n {16}\),\n)"
    found = one.edited(lambda text: re.sub(drive + drive, r"\2\1", text, count=1))
    assert set(found) == {"equal.mjlab.group"}


def test_joints_in_another_order_are_found(tmp_path: Path):
    one = built(tiny_quadruped(), tmp_path, **WALKER)
    listed = r'(JOINTS = \(\s+)("\w+",)(\s+)("\w+",)'
    found = one.edited(lambda text: re.sub(listed, r"\1\4\3\2", text))
    assert found["equal.mjlab.place_in_joints"]["expected"] in (0, 1)


def test_a_negated_start_is_found(tmp_path: Path):
    one = built(tiny_quadruped(), tmp_path, **WALKER)
    found = one.edited(lambda text: text.replace(": 0.8,", ": -0.8,"))
    assert found["equal.mjlab.start"]["expected"] == 0.8
    assert found["equal.mjlab.start"]["found"] == -0.8


def test_a_quaternion_of_another_length_is_found(tmp_path: Path):
    one = built(tiny_quadruped(), tmp_path, **WALKER)
    found = one.edited(lambda text: text.replace("rot=(1.0,", "rot=(1.01,"))
    assert found["equal.mjlab.length_of_rot"] == {"expected": 1.0, "found": 1.01}


def test_what_nobody_knows_is_unread(tmp_path: Path):
    one = built(tiny_quadruped(), tmp_path, **WALKER)
    for field in ("armature=0.01", 'joint_vel={".*": 0.0}', "spec_fn=spec"):
        found = one.edited(
            lambda text, field=field: text.replace(field, f"{field}, mystery=7.0", 1)
        )
        assert found["equal.unread"]["found"] == "7.0"
    found = one.edited(
        lambda text: text.replace("    return cfg", "    cfg.x = 7.0\n    return cfg")
    )
    assert found["equal.mjlab.statement"]["found"] == 7.0


def test_a_joint_that_two_drives_claim_is_unread(tmp_path: Path):
    one = built(tiny_quadruped(), tmp_path, **WALKER)
    found = one.edited(lambda text: text.replace('".*_calf_joint",', '".*_(calf|hip)_joint",', 1))
    assert found["equal.unread"]["attribute"].endswith("_hip_joint again")


@pytest.mark.parametrize("changed", [literals, names])
def test_any_single_change_of_the_module_is_found(changed: Any, tmp_path: Path):
    """A seeded few of them; `-m slow` makes them all."""
    one = built(quadruped(), tmp_path, randomize=RANDOMIZE, **WALKER)
    assert missed(one, changed, 0.03) == []


@pytest.mark.slow
@pytest.mark.parametrize("changed", [literals, names])
def test_every_single_change_of_the_module_is_found(changed: Any, tmp_path: Path):
    one = built(quadruped(), tmp_path, randomize=RANDOMIZE, **WALKER)
    assert missed(one, changed, 1.0) == []


def missed(one: Built, changed: Any, share: float) -> list[str]:
    drawn, seen = random.Random(0), []
    for what, text in changed(one.path.read_text(), lambda: drawn.random() < share):
        one.path.write_text(text)
        if not is_found(one.prove()):
            seen.append(what)
    return seen
