"""What a trainer answered is judged; the child itself runs where its environment is named."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tiny import TinyRobot, run_step, tiny_quadruped, with_mimic, write_robot_ports

import assetbuild
from assetbuild.checks.smoke_mjlab import SmokeMjlab, _shown, judged
from assetbuild.checks.smoke_newton import judged as judge_newton
from assetbuild.engine.world import World
from assetbuild.pipeline.recipes import whole_model
from assetbuild.recipe.models import Recipe
from assetbuild.robot.ranges import Randomize
from assetbuild.simulators.children import ask
from assetbuild.simulators.consumers import SmokeBounds
from assetbuild.simulators.environments import MADE, Environment, pip_words
from assetbuild.targets.mjlab import Mjlab

BOUNDS = SmokeBounds.model_validate({})
GOOD: dict[str, Any] = {
    "envs": 8,
    "fell": 0,
    "finite": True,
    "walks": True,
    "gpu": False,
    "iterations": 2,
    "weights_finite": True,
    "weights_moved": 0.01,
    "height_m": 0.28,
    "start_m": 0.3,
    "effort_share": 1.0,
    "inconsistent": 0,
    "drawn": 104,
    "mass_ratio": [0.9, 1.1],
}
BAD = {
    "smoke.finite": {"finite": False},
    "smoke.fell": {"fell": 3},
    "smoke.height": {"height_m": 0.2},
    "smoke.effort": {"effort_share": 1.1},
    "smoke.weights": {"weights_moved": 0.0},
    "smoke.inertia": {"inconsistent": 1},
}


def test_a_good_answer_says_nothing() -> None:
    assert list(judged(GOOD, BOUNDS)) == []
    assert list(judged({**GOOD, "effort_share": 1.09}, BOUNDS, effort_factor=1.1)) == []


def test_the_verdict_quotes_what_mjlab_saw() -> None:
    assert _shown(GOOD)["summary"] == (
        "0 of 8 robots fell under zero actions, the root went from 0.300 m to 0.280 m; "
        "then trained for 2 iterations on a CPU"
    )


@pytest.mark.parametrize("rule", BAD)
def test_each_fault_has_its_rule(rule: str) -> None:
    assert [finding.rule for finding in judged({**GOOD, **BAD[rule]}, BOUNDS)] == [rule]


def recipe(**keys: Any) -> Recipe:
    source = {"path": ".", "urdf": "r.urdf"}
    base = {"schema": "assetbuild/v1", "robot": "r", "source": source}
    return whole_model().model_validate(base | keys)


def test_nobody_is_asked_whom_the_recipe_does_not_name() -> None:
    assert SmokeMjlab.configure(recipe()) is None
    ranges = {"joints": {".*": {"effort": [0.9, 1.2]}}}
    step = SmokeMjlab.configure(recipe(validate={"smoke": ["mjlab"]}, randomize=ranges))
    assert step is not None
    assert step.effort_factor == 1.2


def test_an_environment_is_named_by_its_pins_and_counts_when_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path))
    one, other = Environment("t", ("a==1",)), Environment("t", ("a==2",))
    assert one.folder != other.folder
    assert one.folder.is_relative_to(tmp_path)
    (one.folder / "bin").mkdir(parents=True)
    (one.folder / "bin/python").touch()
    assert one.python(World()) is None, "half made"
    (one.folder / MADE).touch()
    assert one.python(World()) is not None


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("import sys; sys.exit('no such joint')", "no such joint"),
        ("import os; os.kill(os.getpid(), 9)", "crashed with signal 9"),
        ("import time; time.sleep(60)", "took more than 1 s"),
    ],
)
def test_a_consumer_that_fails_says_why(tmp_path: Path, text: str, why: str) -> None:
    import sys

    program = tmp_path / "child.py"
    program.write_text(text)
    seconds = 1.0 if "sleep" in text else 30.0
    answer, failure = ask(Path(sys.executable), program, {}, tmp_path, seconds)
    assert answer is None
    assert why in failure


def newton_reading(robot: TinyRobot | None = None, **changed: Any) -> dict[str, Any]:
    """The tiny quadruped as Newton should hold it."""
    robot = robot or tiny_quadruped()
    joints = {}
    for joint in robot.tree.moving_joints:
        drive = robot.control.by_joint[joint.name]
        keys = ("kp", "kd", "effort", "armature", "friction", "damping")
        joints[joint.name] = {key: getattr(drive, key) for key in keys} | {
            "type": "rotary",
            "axis": list(joint.axis),
            "lower": joint.limits.lower,
            "newton:solreflimit": [0.02, 1.0] if joint.limits.lower is not None else None,
            "upper": joint.limits.upper,
        }
        if joint.mimic:
            joints[joint.name] |= {
                "mimics": joint.mimic.joint,
                "mimic multiplier": joint.mimic.multiplier,
                "mimic offset": joint.mimic.offset,
            }
    bodies = {
        body.name: {
            "mass": body.inertial.mass_kg,
            "centre of mass": list(body.inertial.com_m),
            "inertia": list(body.inertial.inertia_com_kg_m2),
        }
        for body in robot.tree.bodies
        if body.inertial
    }
    contact = robot.control.contact
    shapes = {
        shape.name: {
            "friction": list(contact.friction),
            "condim": float(contact.condim),
            "priority": float(contact.priority),
            "solref": [0.02, 1.0],
            "solimp": [0.9, 0.95, 0.001, 0.5, 2.0],
            "margin": contact.margin,
            "gap": 0.1,  # Newton's own
        }
        for shape in robot.shapes.of("collision")
    }
    found = {"bodies": bodies, "joints": joints, "shapes": shapes}
    return {"finite": True, "dof": 18} | found | changed


def newton_says(reading: dict[str, Any], robot: TinyRobot | None = None) -> list[tuple[str, str]]:
    robot = robot or tiny_quadruped()
    found = judge_newton("usd", reading, robot.tree, robot.control, robot.shapes)
    return [(finding.rule, finding.subject) for finding in found]


def test_newton_reads_the_same_robot() -> None:
    assert newton_says(newton_reading()) == []


def test_newton_s_names_of_an_mjcf_are_known_again() -> None:
    """It writes `_` for `-`, so Cassie's `left-foot` is `left_foot` there."""
    robot = tiny_quadruped()
    bodies = tuple(replace(body, name=body.name.replace("_", "-")) for body in robot.tree.bodies)
    joints = tuple(
        replace(joint, parent=joint.parent.replace("_", "-"), child=joint.child.replace("_", "-"))
        for joint in robot.tree.joints
    )
    tree = replace(robot.tree, bodies=bodies, joints=joints)
    reading = newton_reading()
    for row in reading["joints"].values():
        del row["newton:solreflimit"]  # the USD alone says it
    assert list(judge_newton("mjcf", reading, tree, robot.control, robot.shapes)) == []


def test_another_robot_in_newton_is_an_error() -> None:
    assert newton_says({"failure": "no"}) == [("smoke.failed", "robot")]
    assert newton_says(newton_reading(finite=False)) == [("smoke.finite", "robot")]
    assert newton_says(newton_reading(dof=12)) == [("equal.newton.dof", "robot")]
    calf = "joint FR_calf_joint"
    changes = {"kp": 1.0, "effort": None, "lower": 0.5, "armature": 0.0, "axis": [0.0, -1.0, 0.0]}
    for key, value in changes.items():
        reading = newton_reading()
        reading["joints"]["FR_calf_joint"][key] = value
        assert newton_says(reading) == [(f"equal.newton.{key}", calf)], key
    reading = newton_reading()
    reading["bodies"]["trunk"]["mass"] *= 1.001
    reading["bodies"]["FR_calf"]["centre of mass"][0] += 1e-3
    del reading["joints"]["FL_hip_joint"]
    assert newton_says(reading) == [
        ("equal.newton.missing", "joint FL_hip_joint"),
        ("equal.newton.mass", "body trunk"),
        ("equal.newton.centre_of_mass", "body FR_calf"),
    ]


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("friction", [0.5, 0.02, 0.01]),
        ("condim", 6.0),
        ("priority", 1.0),
        ("solref", [0.05, 1.0]),
        ("solimp", [0.8, 0.95, 0.001, 0.5, 2.0]),
        ("margin", 0.001),
    ],
)
def test_another_surface_in_newton_is_an_error(word: str, value: object) -> None:
    reading = newton_reading()
    reading["shapes"]["FR_foot_collision"][word] = value
    assert newton_says(reading) == [(f"equal.newton.{word}", "shape FR_foot_collision")]


def test_a_shape_that_newton_lacks_is_an_error() -> None:
    reading = newton_reading()
    del reading["shapes"]["FR_foot_collision"]
    assert ("equal.newton.condim", "shape FR_foot_collision") in newton_says(reading)


def test_what_newton_refuses_names_the_key_that_helps() -> None:
    robot = tiny_quadruped()
    refused = {"failure": "ValueError: invalid literal for int() with base 10: 'pgs'"}
    (found,) = judge_newton("mjcf", refused, robot.tree, robot.control, robot.shapes)
    assert "`mjcf: {solver: Newton}`" in found.hint
    refused = {"failure": "ValueError: Error: inertia must satisfy A + B >= C"}
    (found,) = judge_newton("mjcf", refused, robot.tree, robot.control, robot.shapes)
    assert "single precision" in found.hint


def test_what_newton_adds_to_a_light_body_names_the_edits_that_help() -> None:
    robot, reading = tiny_quadruped(), newton_reading()
    reading["bodies"]["FR_calf"]["inertia"][0] += 1e-6
    found = list(judge_newton("usd", reading, robot.tree, robot.control, robot.shapes))
    assert [finding.rule for finding in found] == ["equal.newton.inertia"]
    assert "`moments: 2e-10`" in found[0].hint


def test_a_mimic_that_newton_couples_otherwise_is_an_error() -> None:
    robot = with_mimic(tiny_quadruped(), "FR_calf_joint", "FR_thigh_joint", -2.0, 0.1)
    assert newton_says(newton_reading(robot), robot) == []
    reading = newton_reading(robot)
    reading["joints"]["FR_calf_joint"]["mimic multiplier"] = 2.0
    wrong = [("equal.newton.mimic_multiplier", "joint FR_calf_joint")]
    assert newton_says(reading, robot) == wrong


def test_mjlab_takes_the_tiny_robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Minutes: torch, warp and mjlab are imported, kernels are compiled once."""
    python = os.environ.get("ASSETBUILD_MJLAB_PYTHON")
    if not python:
        pytest.skip("no mjlab here: set ASSETBUILD_MJLAB_PYTHON to the Python of its environment")
    monkeypatch.setattr(Environment, "python", property(lambda self: Path(python)))
    ranges = {
        "links": {".*": {"density": [0.8, 1.2], "com": 0.01}},
        "joints": {".*": {"kp": [0.9, 1.1], "friction": [0.5, 2], "delay": [0, 2]}},
        "friction": [0.4, 1.2],
    }
    target = Mjlab(
        robot="tiny", feet=".*_foot", imu="imu", randomize=Randomize.model_validate(ranges)
    )
    inputs = write_robot_ports(tmp_path / "in", tiny_quadruped())
    run_step(target, inputs, inputs)
    check = SmokeMjlab(robot="tiny", environment="test", envs=4, stand_steps=10, rollout=4)
    assert [f for f in run_step(check, inputs, tmp_path / "out") if f.severity == "error"] == []


def test_what_pip_downloads_is_said_from_a_megabyte_on():
    line = "  Downloading https://files.example/torch-2.9.0-cp311-linux.whl (858.1 MB)"
    assert pip_words(line) == "downloading torch, 858.1 MB"
    assert pip_words("Downloading six-1.17.0-py2.py3-none-any.whl (11 kB)") == ""
    assert (
        pip_words("Installing collected packages: six, torch") == "installing what was downloaded"
    )


def test_every_program_that_a_check_asks_is_there():
    package = Path(assetbuild.__file__).parent
    texts = [path.read_text() for path in (package / "checks").glob("*.py")]
    asked = {name for text in texts for name in re.findall(r'\.answer\("([^"]+)"', text)}
    assert {"mjlab/_child.py", "newton/_child.py", "isaaclab/_child.py"} <= asked
    assert [name for name in asked if not (package / "simulators" / name).is_file()] == []
