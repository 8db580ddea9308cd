"""A pincher holds what it should in each engine; weakly driven or on a bad cone it does not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from checks.engines import needs_newton, needs_physx
from hands import COUPLED, PINCHER, robot
from robot_files import checked, models
from tiny import TinyRobot, box_inertial

from assetbuild.checks._mujoco import Gripping
from assetbuild.checks._newton import NewtonGripping
from assetbuild.checks._physx import PhysxGripping
from assetbuild.findings import Finding
from assetbuild.robot.model import Actuator, Body, Control, Joint, Keyframe, Limits, Mimic, Tree
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Shape, Shapes
from assetbuild.simulators.gripping import GripWish, StageGripping

PADS = 'priority="1" solref="0.004 1" solimp="0.95 0.99 0.001"'


def tried(
    folder: Path, wish: GripWish | None = None, **changed: str
) -> tuple[list[Finding], dict[str, Any]]:
    """What the check says of a pincher whose MJCF is changed."""
    (folder / "mjcf").mkdir()
    path = robot(PINCHER, ["left"], folder / "mjcf", COUPLED)
    text = path.read_text()
    for old, new in {'size=".01 .005 .03"': f'size=".01 .005 .03" {PADS}', **changed}.items():
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    return checked(Gripping(robot="robot", wish=wish or GripWish()), folder, folder / "out")


def test_a_pincher_holds_cube_cylinder_and_sphere(tmp_path: Path) -> None:
    findings, figures = tried(tmp_path)
    assert findings == []
    rows = figures["mjcf"]["palm"]
    assert [row["shape"][:2] for row in rows] == ["cu", "cu", "cy", "cy", "sp", "sp"]
    for row in rows:
        assert row["held"]
        assert row["width_m"] == 0.04
        # The drive is commanded to 0 and held at 20 mm: 400 N/m times that, for two fingers.
        assert row["forces_n"] == pytest.approx([4.0, 4.0], rel=0.1)


def test_a_pincher_without_strength_loses_them_and_says_what_it_holds(tmp_path: Path) -> None:
    weak = {'forcerange="-40 40"': 'forcerange="-1 1"'}
    (lost,), _ = tried(tmp_path, **weak)
    assert lost.rule == "grip.lost"
    assert "flat pads" in lost.hint
    assert "a cube of 40 mm and 0.5 kg is lost" in lost.message
    assert "it holds a cube of 0.05 kg" in lost.message


@pytest.mark.slow
def test_a_pyramidal_cone_lets_them_slip(tmp_path: Path) -> None:
    soft = {'cone="elliptic" impratio="50"': 'cone="pyramidal" impratio="1"'}
    (lost,), figures = tried(tmp_path, **soft)
    assert "slips by" in lost.message
    assert max(row["slip_m"] for row in figures["mjcf"]["palm"] if row["held"]) > 0.002


TURNING = {'type="slide"': 'type="hinge"'}
BLOCK = {'pos="0 0 -.005"/>': 'pos="0 0 -.005"/><geom type="box" size=".02 .05 .2"/>'}
"""It takes the room between the fingers."""


@pytest.mark.parametrize(
    ("changed", "keyframes", "severity", "said"),
    [
        (TURNING, None, "info", "no drive alone closes"),
        pytest.param(BLOCK, None, "warning", "no object fits", marks=pytest.mark.slow),
        ({}, ("open", "fist"), "warning", "no keyframe `open`"),
    ],
    ids=["no hand", "no room", "no keyframe"],
)
def test_a_robot_that_cannot_be_tried_is_told(
    changed: dict[str, str],
    keyframes: tuple[str, str] | None,
    severity: str,
    said: str,
    tmp_path: Path,
) -> None:
    (found,), _ = tried(tmp_path, GripWish(keyframes=keyframes), **changed)
    assert (found.rule, found.severity) == ("grip.hand", severity)
    assert said in found.message


# --- In PhysX and Newton ---


WISH = GripWish(masses=(0.2,))
ENGINES = [
    pytest.param(PhysxGripping(robot="robot", wish=WISH), "physx.grip", marks=needs_physx),
    pytest.param(
        NewtonGripping(robot="robot", wish=WISH, environment="newton"),
        "newton.grip",
        marks=[pytest.mark.slow, needs_newton],
    ),
]


def pincher_in_stages(effort: float) -> TinyRobot:
    """A palm of 100 mm that floats on no joint; two fingers of 60 mm slide 40 mm each, coupled."""
    pad = (0.02, 0.01, 0.06)
    finger = box_inertial(0.05, pad, (0.0, 0.0, 0.03))
    left = Joint(
        "left", "prismatic", "palm", "left_finger", axis=(0.0, 1.0, 0.0),
        limits=Limits(0.0, 0.04, effort, 1.0),
    )  # fmt: skip
    right = replace(
        left, name="right", child="right_finger", axis=(0.0, -1.0, 0.0), mimic=Mimic("left")
    )
    bodies = (
        Body("palm", box_inertial(0.2, (0.04, 0.1, 0.01))),
        Body("left_finger", finger),
        Body("right_finger", finger),
    )
    tree = Tree("robot", "fixed", bodies, (left, right))
    shapes = Shapes(
        (
            Shape("palm", "palm", "collision", Box((0.04, 0.1, 0.01)), Pose((0.0, 0.0, -0.005))),
            Shape("one", "left_finger", "collision", Box(pad), Pose((0.0, 0.005, 0.03))),
            Shape("two", "right_finger", "collision", Box(pad), Pose((0.0, -0.005, 0.03))),
        )
    )
    drive = Actuator("left", "pd", kp=400.0, kd=20.0, effort=effort, armature=0.1)
    home = Keyframe("home", (("left", 0.03), ("right", 0.03)))
    control = Control((drive, Actuator("right", "passive")), (home,))
    return TinyRobot(tree, tree, shapes, control)


@pytest.mark.parametrize(("check", "rule"), ENGINES)
def test_a_pincher_holds_what_it_should_and_loses_it_without_strength(
    check: StageGripping, rule: str, tmp_path: Path
) -> None:
    strong = models(tmp_path / "strong", pincher_in_stages(40.0))
    findings, figures = checked(check, strong, tmp_path / "held")
    assert findings == []
    assert [row["shape"] for row in figures["usd"]["palm"]] == ["cube", "cylinder", "sphere"]
    # Friction 1 on two sides holds 2 N of weight by 1 N each; half of that is pressed.
    weak = models(tmp_path / "weak", pincher_in_stages(0.5))
    (lost,), figures = checked(check, weak, tmp_path / "lost")
    assert lost.rule == rule
    assert "fails to hold 3" in lost.message
    assert "a cube of 40 mm and 0.2 kg is lost" in lost.message
    assert {row["slip_m"] for row in figures["usd"]["palm"]} == {None}
