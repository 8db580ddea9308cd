"""One number changed in the XML, and the comparison names it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from tiny import (
    TinyRobot,
    check_inputs,
    examples,
    pendulum,
    robots,
    run_step,
    tiny_quadruped,
    with_mimic,
)

from assetbuild.checks.mjcf_equal import MjcfEqual
from assetbuild.findings import Finding
from assetbuild.robot.model import Body, Limits
from assetbuild.targets.mjcf import Mjcf


def check(robot: TinyRobot, folder: Path, spoil: Callable[[str], str] = str) -> list[Finding]:
    inputs = check_inputs(folder, robot, Mjcf(robot="robot"), "mjcf")
    path = inputs / "mjcf/robot.xml"
    before = path.read_text()
    path.write_text(spoil(before))
    return run_step(MjcfEqual(robot="robot"), inputs, folder / "out")


def test_quadruped_is_equal_and_the_figures_say_how_well(tmp_path: Path) -> None:
    assert check(tiny_quadruped(), tmp_path) == []
    figures = json.loads((tmp_path / "out/figures.json").read_text())
    assert figures["total_mass_kg"] == pytest.approx(12.01)
    assert max(figures["worst_relative_error"].values()) < 1e-14


@settings(max_examples=examples(40), deadline=None)
@given(robots())
def test_every_random_tree_is_equal(robot: TinyRobot) -> None:
    with TemporaryDirectory() as folder:
        assert check(robot, Path(folder)) == []


def test_pendulum_mimic_and_world_are_equal(tmp_path: Path) -> None:
    robot = pendulum()
    world = replace(
        robot.tree,
        bodies=(Body("world"), robot.tree.bodies[1]),
        joints=(replace(robot.tree.joints[0], parent="world"),),
    )
    assert check(robot, tmp_path / "a") == []
    assert check(replace(robot, tree=world), tmp_path / "b") == []
    mimic = with_mimic(tiny_quadruped(), "FL_hip_joint", "FR_hip_joint", -1.0, 0.0)
    assert check(mimic, tmp_path / "c") == []


def test_a_locked_joint_is_held_where_its_limits_meet(tmp_path: Path) -> None:
    robot = pendulum()
    joint = replace(robot.tree.joints[0], limits=Limits(0.0, 0.0, 5.0, 1.0))
    locked = replace(robot, tree=replace(robot.tree, joints=(joint,)))
    assert check(locked, tmp_path / "a") == []

    def elsewhere(text: str) -> str:
        return text.replace('polycoef="0 0', 'polycoef="0.1 0')

    assert [f.rule for f in check(locked, tmp_path / "b", elsewhere)] == ["equal.mjcf.limits"]


@pytest.mark.parametrize(
    ("rule", "subject", "pattern", "new"),
    [
        ("mass", "link FR_hip", r'mass="0.5"', 'mass="0.500000001"'),
        ("com", "link FR_hip", r'pos="0 -0.005 0"', 'pos="0 -0.00500000001 0"'),
        (
            "inertia",
            "link FR_hip",
            r'diaginertia="0.0003 0.0003 0.0003"',
            'diaginertia="0.0003 0.0003 0.00030000001"',
        ),
        ("pose", "link FR_hip", r'pos="0.18 -0.05 0"', 'pos="0.18 -0.050000001 0"'),
        ("axis", "joint FR_hip_joint", r'axis="1 0 0"', 'axis="1 0.00001 0"'),
        ("limits", "joint FR_hip_joint", r'range="-0.86 0.86"', 'range="-0.86 0.87"'),
        ("armature", "actuator FR_calf_joint", r'armature="0.02"', 'armature="0.02001"'),
        ("damping", "actuator FR_hip_joint", r'damping="0.1"', 'damping="0.2"'),
        ("friction", "actuator FR_hip_joint", r'frictionloss="0.2"', 'frictionloss="0.3"'),
        ("effort", "actuator FR_calf_joint", r'forcerange="-36 36"', 'forcerange="-35 36"'),
        ("gains", "actuator FR_hip_joint", r'kp="100"', 'kp="90"'),
        ("gains", "actuator FR_hip_joint", r'kv="3"', 'kv="2"'),
        ("pose", "link FR_foot", r'"FR_foot" pos="0 0 -0.2"', '"FR_foot" pos="0 0 -0.21"'),
        ("frame", "link imu", r'<site name="imu"[^>]*/>', ""),
        ("shape", "shape FR_foot_collision", r'type="sphere" size="0.02"', 'size="0.03"'),
        (
            "shape",
            "shape trunk_visual",
            r'class="visual" mesh',
            'class="collision" type="mesh" mesh',
        ),
        ("contact", "shape trunk_collision", r'friction="0.8 ', 'friction="0.7 '),
        ("keyframe", "recipe keyframes.home", r' 0 0.8 -1.6"/>', ' 0 0.8 -1.7"/>'),
        ("option", "robot", r'timestep="0.005"', 'timestep="0.004"'),
        (
            "count",
            "robot",
            r"</mujoco>",
            '<contact><exclude body1="FL_calf" body2="FR_calf"/></contact></mujoco>',
        ),
        ("actuator", "actuator FR_hip_joint", r'<position name="FR_hip" [^>]*/>', ""),
        ("joint", "joint FR_hip_joint", r'name="FR_hip_joint" class', 'name="other" class'),
        ("anchor", "joint FR_hip_joint", r'<joint name="FR_hip_joint"', '\\g<0> pos="0 0 0.001"'),
        ("load", "robot", r"</mujoco>", ""),
    ],
)
def test_a_changed_number_is_found(
    tmp_path: Path, rule: str, subject: str, pattern: str, new: str
) -> None:
    def spoil(text: str) -> str:
        changed, count = re.subn(pattern, new, text, count=1)
        assert count == 1, f"{pattern} is not in the file"
        if rule in ("actuator", "joint"):  # keep it loadable
            changed = re.sub(r"  <keyframe>.*</keyframe>\n", "", changed, flags=re.DOTALL)
            changed = (
                changed.replace('joint="FR_hip_joint"', 'joint="other"')
                if (rule == "joint")
                else changed
            )
        return changed

    found = check(tiny_quadruped(), tmp_path, spoil)
    assert (f"equal.mjcf.{rule}", subject) in {(f.rule, f.subject) for f in found}
    assert {f.severity for f in found} == {"error"}


def test_a_finding_carries_both_numbers(tmp_path: Path) -> None:
    found = check(pendulum(), tmp_path, lambda text: text.replace('mass="1"', 'mass="1.5"'))
    mass = next(f for f in found if f.rule == "equal.mjcf.mass")
    assert mass.data == {"expected": (1.0,), "found": (1.5,)}
    assert "1.5" in mass.message
    assert "equal.mjcf.total_mass" in {f.rule for f in found}


def test_a_body_under_another_name_is_missed(tmp_path: Path) -> None:
    found = check(pendulum(), tmp_path, lambda text: text.replace('name="arm"', 'name="arms"'))
    assert ("equal.mjcf.body", "link arm") in {(f.rule, f.subject) for f in found}
