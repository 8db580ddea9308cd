"""Isaac Lab's modules are read without being run, and every change of them is found."""

from __future__ import annotations

import math
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
    sprung,
    tiny_quadruped,
    turned,
    write_robot_ports,
)

from assetbuild.errors import UsageError
from assetbuild.facts.reader import Proof
from assetbuild.facts.readers.isaaclab import IsaacLabReader, read_config
from assetbuild.facts.reference import Assets, Reference
from assetbuild.facts.table import Key
from assetbuild.robot.model import Actuator
from assetbuild.robot.ranges import Randomize
from assetbuild.targets.isaaclab import IsaacLab
from assetbuild.targets.isaaclab.options import IsaacLabOptions

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
KINDS = ("2", "3", "measure")


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

    def edited(self, kind: str, change: Callable[[str], str]) -> dict[str, Any]:
        """What is found in a changed module: data of the findings by rule."""
        path = self.file(kind)
        before = path.read_text()
        after = change(before)
        assert after != before
        path.write_text(after)
        found = {f.rule: dict(f.data or {}) for f in self.prove().findings}
        path.write_text(before)
        return found


def built(robot: TinyRobot, folder: Path, **fields: Any) -> Built:
    inputs = write_robot_ports(folder / "in", robot)
    target = IsaacLab(robot="robot-1", **fields)
    run_step(target, inputs, folder / "out")
    options = {
        "isaaclab": target.options.model_dump(mode="json"),
        "usd": target.usd.model_dump(mode="json"),
        "randomize": target.randomize and target.randomize.model_dump(mode="json"),
    }
    reference = Reference(robot.links, robot.tree, robot.shapes, robot.control, Assets(), options)
    return Built(
        folder / "out/isaaclab", IsaacLabReader(robot="robot-1", options=options), reference
    )


def quadruped() -> TinyRobot:
    """Every kind of drive that Isaac Lab knows, and a start that is turned."""
    robot = turned(tiny_quadruped())
    models = {"FR": "pd", "FL": "ideal_pd", "RR": "dc_motor", "RL": "motor"}
    drives = tuple(
        replace(drive, model=models[drive.joint[:2]], kp=80.0 + i, kd=4.0 + i)
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
    assert proof.compared > 100


@pytest.mark.parametrize(("rest", "severity"), [(0.5, "error"), (0.0, "info")])
def test_a_spring_is_a_stiffness_and_its_rest_is_lost(rest: float, severity: str, tmp_path: Path):
    robot = sprung(rest=rest)
    inputs = write_robot_ports(tmp_path / "in", robot)
    found = run_step(IsaacLab(robot="robot"), inputs, tmp_path / "out")
    (spring,) = [f for f in found if f.rule == "isaaclab.spring"]
    assert (spring.severity, spring.data) == (severity, {"stiffness": 6.0, "rest": rest})


def test_what_the_recipe_says_of_isaac_lab_is_expected(tmp_path: Path):
    asked = IsaacLabOptions.model_validate(
        {
            "friction_buckets": 12, "clearance": 0.01, "contact_sensors": False,
            "soft_joint_pos_limit_factor": 0.9,
        }
    )  # fmt: skip
    assert built(quadruped(), tmp_path, options=asked, randomize=RANDOMIZE).prove().findings == ()


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


@pytest.mark.parametrize("generation", ["2", "3"])
def test_gains_in_degrees_are_found(generation: str, tmp_path: Path):
    one = built(tiny_quadruped(), tmp_path)
    found = one.edited(
        generation, lambda text: text.replace("stiffness=100.0", f"stiffness={math.pi / 1.8!r}")
    )
    assert found["equal.isaaclab.kp"]["expected"] == 100.0
    assert found["equal.isaaclab.kp"]["found"] == pytest.approx(1.745329252)
    assert len(found["equal.isaaclab.kp"]["subjects"]) == 12


@pytest.mark.parametrize("generation", ["2", "3"])
def test_an_armature_of_nothing_is_found(generation: str, tmp_path: Path):
    one = built(tiny_quadruped(), tmp_path)
    found = one.edited(generation, lambda text: re.sub("armature=0.01,", "armature=0.0,", text))
    assert found["equal.isaaclab.armature"]["expected"] == 0.01
    assert found["equal.isaaclab.armature"]["found"] == 0.0


@pytest.mark.parametrize("generation", ["2", "3"])
@pytest.mark.parametrize("field", ["armature=0.01,", "viscous_friction=0.1,", "friction=0.2,"])
def test_what_the_module_leaves_to_the_usd_is_found(generation: str, field: str, tmp_path: Path):
    """Isaac Lab takes the USD's number for one that a module does not state."""
    one = built(tiny_quadruped(), tmp_path)
    assert field in one.file(generation).read_text()
    found = one.edited(generation, lambda text: re.sub(rf"\n +{field}", "", text))
    assert {None} == {said["found"] for said in found.values()}


def test_a_start_that_is_not_stated_and_names_in_another_order_are_found(tmp_path: Path):
    one = built(tiny_quadruped(), tmp_path)
    found = one.edited("2", lambda text: text.replace('"FR_hip_joint": 0.0,', "", 1))
    assert found["equal.isaaclab.start"] == {"expected": 0.0, "found": None}
    listed = r'"(FR_hip_joint)",(\s+)"(FR_thigh_joint)",'
    found = one.edited("2", lambda text: re.sub(listed, r'"\3",\2"\1",', text))
    assert set(found) == {"equal.isaaclab.place_in_its_group"}


def test_each_generation_has_its_own_order_of_quaternions(tmp_path: Path):
    one = built(quadruped(), tmp_path)
    rot = re.search(r"rot=(\(.*\)),", one.file("2").read_text())
    assert rot
    found = one.edited("3", lambda text: re.sub(r"rot=\(.*\),", f"rot={rot[1]},", text))
    assert set(found) == {"equal.isaaclab.start_pose"}


def test_a_field_of_the_other_generation_is_unread(tmp_path: Path):
    one = built(tiny_quadruped(), tmp_path)
    found = one.edited("3", lambda t: t.replace("joint_effort_limit=", "effort_limit_sim="))
    assert found["equal.isaaclab.effort"]["found"] is None
    assert found["equal.unread"]["attribute"] == "effort_limit_sim"


def test_a_quaternion_of_another_length_is_found(tmp_path: Path):
    one = built(tiny_quadruped(), tmp_path)
    found = one.edited("3", lambda text: text.replace("0.0, 1.0),  # x", "0.0, 1.01),  # x"))
    assert found["equal.isaaclab.length_of_rot"] == {"expected": 1.0, "found": 1.01}


def test_what_nobody_knows_is_unread(tmp_path: Path):
    one = built(tiny_quadruped(), tmp_path)
    for field in ("activate_contact_sensors=True", "joint_vel={'.*': 0.0}", "armature=0.01"):
        text = field.replace("'", '"')
        found = one.edited("2", lambda t, text=text: t.replace(text, f"{text}, mystery=7.0", 1))
        assert found["equal.unread"]["found"] == "7.0"
    found = one.edited("2", lambda text: f"{text}\nMYSTERY = 7.0\n")
    assert found["equal.isaaclab.statement"]["found"] == 7.0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("changed", [literals, names])
def test_any_single_change_of_a_module_is_found(kind: str, changed: Any, tmp_path: Path):
    """A seeded few of them; `-m slow` makes them all."""
    assert missed(built(quadruped(), tmp_path, randomize=RANDOMIZE), kind, changed, 0.03) == []


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("changed", [literals, names])
def test_every_single_change_of_a_module_is_found(kind: str, changed: Any, tmp_path: Path):
    assert missed(built(quadruped(), tmp_path, randomize=RANDOMIZE), kind, changed, 1.0) == []


def missed(one: Built, kind: str, changed: Any, share: float) -> list[str]:
    path, drawn, seen = one.file(kind), random.Random(0), []
    for what, text in changed(path.read_text(), lambda: drawn.random() < share):
        path.write_text(text)
        if not is_found(one.prove()):
            seen.append(what)
    return seen


def test_a_module_that_is_gone_is_an_error(tmp_path: Path):
    one = built(pendulum(), tmp_path)
    one.file("3").unlink()
    assert [finding.rule for finding in one.prove().findings] == ["equal.unreadable"]


# --- anybody's configuration ------------------------------------------------------------------

JOINTS = [joint.name for joint in tiny_quadruped().tree.moving_joints]
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


@pytest.mark.parametrize("generation", ["2", "3"])
def test_our_own_module_is_a_configuration_like_any_other(generation: str, tmp_path: Path):
    one = built(turned(tiny_quadruped()), tmp_path)
    facts = read_config(one.file(generation), "", JOINTS).facts
    expected = one.reader.expected(one.reference).facts
    assert len(facts) == 12 * 7 + 1
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


def test_without_a_robot_beside_it_the_patterns_are_the_subjects(tmp_path: Path):
    file = tmp_path / "robot.py"
    file.write_text(FOREIGN)
    assert ".*_hip_joint" in read_config(file, "", ()).names("joint")


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
        read_config(file, name, ())


def test_hostile_numbers_and_circles_end(tmp_path: Path):
    file = tmp_path / "robot.py"
    file.write_text(
        "A = B\nB = A\nN = 9**9**9**9\nC = ArticulationCfg(actuators={'x': ImplicitActuatorCfg("
        "joint_names_expr=['('], stiffness=N, damping=1/0), 'y': A})"
    )
    assert read_config(file, "", JOINTS).facts == {}


def test_a_file_that_doubles_its_values_without_end_is_refused(tmp_path: Path):
    file = tmp_path / "robot.py"
    doubled = "".join(f"A{i} = (A{i + 1}, A{i + 1})\n" for i in range(40))
    file.write_text(f"{doubled}A40 = 1\nC = ArticulationCfg(spawn=A0)")
    with pytest.raises(UsageError, match="values"):
        read_config(file, "", ())
