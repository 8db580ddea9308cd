"""One thing changed in an MJCF, and its reader names subject, quantity and both values."""

from __future__ import annotations

import re

# one text per line reads better than wrapped XML
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from gripper import gripper
from hypothesis import given, settings
from random_robots import examples, robots
from robot_files import check_inputs, run_step
from tiny import TinyRobot, pendulum, tiny_quadruped

from assetbuild.facts.reader import Reader
from assetbuild.facts.readers._mjcf import BareFacts, MjcfFacts, MjxFacts
from assetbuild.facts.readers.scene import SceneFacts
from assetbuild.facts.table import pair_name, pair_of
from assetbuild.findings import Finding
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.model import Limits
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.mjlab import Mjlab
from assetbuild.targets.mjx import Mjx

FORMS: dict[str, tuple[type[Reader], type, str, str]] = {
    "mjcf": (MjcfFacts, Mjcf, "mjcf", "robot.xml"),
    "mjx": (MjxFacts, Mjx, "mjx", "robot_mjx.xml"),
    "bare": (BareFacts, Mjlab, "mjlab", "mjcf/robot_bare.xml"),
    "scene": (SceneFacts, Mjcf, "mjcf", "scene.xml"),
}
"""Reader, target, folder and file of each form."""


def check(
    robot: TinyRobot, folder: Path, spoil: Callable[[str], str] = str, form: str = "mjcf"
) -> list[Finding]:
    reader, target, name, file = FORMS[form]
    inputs = check_inputs(folder, robot, target(robot="robot"), name)
    path = inputs / name / file
    path.write_text(spoil(path.read_text()))
    return run_step(reader(robot="robot"), inputs, folder / "out")


def replaced(pattern: str, new: str) -> Callable[[str], str]:
    def spoil(text: str) -> str:
        changed, count = re.subn(pattern, new, text, count=1)
        assert count == 1, f"{pattern} is not in the file"
        return changed

    return spoil


@settings(max_examples=examples(40), deadline=None)
@given(robots())
def test_every_random_tree_is_equal(robot: TinyRobot) -> None:
    with TemporaryDirectory() as folder:
        assert check(robot, Path(folder)) == []


def test_a_locked_joint_is_held_where_its_limits_meet(tmp_path: Path) -> None:
    robot = pendulum()
    joint = replace(robot.tree.joints[0], limits=Limits(0.0, 0.0, 5.0, 1.0))
    locked = replace(robot, tree=replace(robot.tree, joints=(joint,)))
    assert check(locked, tmp_path / "a") == []
    found = check(locked, tmp_path / "b", replaced('polycoef="0 0', 'polycoef="0.1 0'))
    assert [f.rule for f in found] == ["equal.mjcf.lower", "equal.mjcf.upper"]


def test_bodies_with_spaces_in_their_names_make_pairs_of_two(tmp_path: Path) -> None:
    """One body is called `world`, which MuJoCo keeps for itself: then names are exchanged."""
    robot, names = tiny_quadruped(), {"trunk": "world", "FR_hip": "hip FR", "FR_thigh": "FR"}

    def renamed(part):
        text = encode(part).decode()
        for old, new in names.items():
            text = text.replace(f'"{old}"', f'"{new}"')
        return decode(type(part), text.encode())

    tree, shapes, control = (renamed(part) for part in (robot.tree, robot.shapes, robot.control))
    assert check(replace(robot, tree=tree, shapes=shapes, control=control), tmp_path) == []


def test_a_pair_is_not_taken_for_another_whose_names_are_cut_elsewhere() -> None:
    pairs = [("a b", "c"), ("a", "b c"), ("a", "c"), ('"a', "b"), ("", "a\\ b")]
    assert len({pair_name(*pair) for pair in pairs}) == len(pairs)
    for one, other in pairs:
        names = pair_of(pair_name(one, other)), pair_of(pair_name(other, one))
        assert names == (tuple(sorted((one, other))),) * 2


HIP, CALF = "joint FR_hip_joint", "joint FR_calf_joint"
PLANTED = [
    ("mass", "body FR_hip", r'mass="0.5"', 'mass="0.500000001"'),
    ("pose", "body FR_hip", r'pos="0.18 -0.05 0"', 'pos="0.18 -0.05000001 0"'),
    ("axis", HIP, r'axis="1 0 0"', 'axis="1 0.00001 0"'),
    ("upper", HIP, r'range="-0.86 0.86"', 'range="-0.86 0.87"'),
    ("effort_range", CALF, r'forcerange="-36 36"', 'forcerange="-35 36"'),
    ("kp", HIP, r'kp="100"', 'kp="90"'),
    ("missing", "frame imu", r'<site name="imu"[^>]*/>', ""),
    ("role", "shape trunk_visual", r'class="visual" mesh', 'class="collision" type="mesh" mesh'),
    ("friction", "shape trunk_collision", r'friction="0.8 ', 'friction="0.7 '),
    ("target", "keyframe home/RL_calf_joint", r' 0 0.8 -1.6"/>', ' 0 0.8 -1.7"/>'),
    ("timestep", "simulation", r'timestep="0.005"', 'timestep="0.004"'),
    ("filtered", "pair RL_thigh trunk", r"</mujoco>",
     '<contact><exclude body1="RL_thigh" body2="trunk"/></contact></mujoco>'),
    # What MJCF alone says, of which the vocabulary does not know.
    ("solmix", "shape trunk_collision", r'<geom name="trunk_collision"', r'\g<0> solmix="3"'),
    ("extra", "loop equality 0", r"</mujoco>",
     '<equality><weld body1="FR_hip" body2="FL_hip"/></equality></mujoco>'),
]  # fmt: skip


IN_A_GRIPPER = [
    ("mjcf", "mean_corner", "shape skin", r'pos="0.01 0.02 0.03"', 'pos="0.04 0.02 0.03"'),
    ("mjcf", "mimic_multiplier", "joint b_joint", r'polycoef="0.25 -1.5', 'polycoef="0.25 1.5'),
    ("mjcf", "between", "equality b_joint_copy", r'(<joint name="b_joint)("[^>]* polycoef[^>]*/>)',
     r"\1\2\1_copy\2"),
    ("scene", "type", "shape floor_copy", r'(<geom name="floor)("[^>]*/>)', r"\1\2\1_copy\2"),
    ("mjx", "iterations", "simulation", r' iterations="20"', ' iterations="40"'),
    ("bare", "mass", "body base", r' mass="1"', ' mass="3"'),
    ("scene", "friction", "floor", r' friction="[^"]*"', ' friction="3 0 0"'),
    ("scene", "centre", "view", r'center="[^"]*"', 'center="0 0 9"'),
    ("scene", "extent", "view", r' extent="[^"]*"', ' extent="9"'),
    ("scene", "lights", "view", r"<light [^>]*/>", ""),
    ("scene", "timestep", "simulation", r"<statistic", '<option timestep="0.1"/><statistic'),
]  # fmt: skip


@pytest.mark.parametrize(
    ("robot", "form", "rule", "subject", "pattern", "new"),
    [(tiny_quadruped(), "mjcf", *row) for row in PLANTED]
    + [(gripper(), *row) for row in IN_A_GRIPPER],
)
def test_a_planted_change_is_found(
    tmp_path: Path, robot: TinyRobot, form: str, rule: str, subject: str, pattern: str, new: str
) -> None:
    found = check(robot, tmp_path, replaced(pattern, new), form)
    named = {(f.rule, s): f for f in found for s in (f.subject, *f.data.get("subjects", ()))}
    assert (f"equal.{form}.{rule}", subject) in named
    assert {f.severity for f in found} == {"error"}
    if (rule, form) == ("mass", "bare"):
        mass = named[f"equal.{form}.{rule}", subject]
        assert (mass.data["expected"], mass.data["found"]) == (1.0, 3.0)
        assert "3 kg in the" in mass.message and ", 1 kg in the robot" in mass.message


@pytest.mark.parametrize("line", [r"(?m)^(f) (\S+) (\S+)", r"(?m)^(v) (\S+) (\S+)"])
@pytest.mark.parametrize("form", ["mjcf", "bare"])
def test_one_line_of_a_mesh_is_found_in_every_form(form: str, line: str, tmp_path: Path) -> None:
    """A face that is turned over; a corner of which two numbers are exchanged."""
    reader, target, name, file = FORMS[form]
    inputs = check_inputs(tmp_path, gripper(), target(robot="robot"), name)
    mesh = next((inputs / name / file).parent.glob("assets/block*.obj"))
    mesh.write_text(re.sub(line, r"\1 \3 \2", mesh.read_text(), count=1))
    found = {f.rule for f in run_step(reader(robot="robot"), inputs, tmp_path / "out")}
    assert found & {f"equal.{form}.volume", f"equal.{form}.mean_corner"}


def test_an_attribute_that_mujoco_does_not_know_is_reported(tmp_path: Path) -> None:
    (found,) = check(pendulum(), tmp_path, replaced(r"<option ", r"\g<0>wings='2' "))
    assert found.rule == "equal.unreadable"
    assert "wings" in found.message
