"""A pincher holds in PhysX and Newton what it should; with a weak drive it drops it."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import pytest
from tiny import TinyRobot, box_inertial, models, run_step

from assetbuild.checks._newton import NewtonGripping
from assetbuild.checks._physx import PhysxGripping
from assetbuild.engine.world import World
from assetbuild.findings import Finding
from assetbuild.robot.model import Actuator, Body, Control, Joint, Keyframe, Limits, Mimic, Tree
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Shape, Shapes
from assetbuild.simulators.gripping import GripWish
from assetbuild.simulators.newton import HOME
from assetbuild.simulators.stage_grip import StageGripping

WISH = GripWish(masses=(0.2,))
ENGINES = [
    pytest.param(
        PhysxGripping(robot="robot", wish=WISH),
        "physx.grip",
        marks=pytest.mark.skipif(find_spec("ovphysx") is None, reason="needs the extra `physx`"),
    ),
    pytest.param(
        NewtonGripping(robot="robot", wish=WISH, environment="newton"),
        "newton.grip",
        marks=[
            pytest.mark.slow,
            pytest.mark.skipif(
                HOME.python(World()) is None,
                reason="needs `assetbuild smoke RECIPE --consumer newton` once",
            ),
        ],
    ),
]


def pincher(effort: float) -> TinyRobot:
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
    def evaluate(effort: float, folder: Path) -> tuple[list[Finding], list[dict[str, object]]]:
        findings = run_step(check, models(folder, pincher(effort)), folder / "out")
        figures = json.loads((folder / "out/figures.json").read_text())
        return findings, figures["usd"]["palm"]

    findings, rows = evaluate(40.0, tmp_path / "strong")
    assert findings == []
    assert [row["shape"] for row in rows] == ["cube", "cylinder", "sphere"]
    # Friction 1 on two sides holds 2 N of weight by 1 N each; half of that is pressed.
    (lost,), rows = evaluate(0.5, tmp_path / "weak")
    assert lost.rule == rule
    assert "fails to hold 3" in lost.message
    assert "a cube of 40 mm and 0.2 kg is lost" in lost.message
    assert {row["slip_m"] for row in rows} == {None}
