"""A loop is a joint outside of the articulation in USD, which PhysX solves with more iterations."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from pxr import Usd, UsdPhysics
from tiny import four_bar, pendulum, run_step, write_robot_ports

from assetbuild.facts.readers.usd import UsdReader
from assetbuild.robot.model import LoopEnd
from assetbuild.robot.pose import Pose
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.targets.usd import Usd as UsdTarget

ITERATIONS = "physxArticulation:solverVelocityIterationCount"


def opened(folder: Path, robot) -> Usd.Stage:
    run_step(UsdTarget(robot="bot"), write_robot_ports(folder / "in", robot), folder)
    return Usd.Stage.Open(str(folder / "usd/bot.usda"))


def iterations(stage: Usd.Stage) -> set[int]:
    found = (prim.GetAttribute(ITERATIONS).Get() for prim in stage.Traverse())
    return {value for value in found if value is not None}


@pytest.mark.parametrize(
    ("kind", "schema"), [("connect", UsdPhysics.SphericalJoint), ("weld", UsdPhysics.FixedJoint)]
)
def test_a_loop_is_a_joint_outside_of_the_articulation(kind: str, schema: type, tmp_path: Path):
    stage = opened(tmp_path, four_bar(kind))
    joint = schema(stage.GetPrimAtPath("/bot/Loops/coupler_loop"))
    assert joint and joint.GetExcludeFromArticulationAttr().Get() is True
    assert joint.GetBody0Rel().GetTargets() == ["/bot/coupler"]
    assert joint.GetBody1Rel().GetTargets() == ["/bot/rocker"]
    assert tuple(joint.GetLocalPos0Attr().Get()) == pytest.approx((0.2, 0.0, 0.0))
    assert iterations(stage) == {16}


@pytest.mark.parametrize(("kind", "weight"), [("connect", 0.0), ("weld", 1.0)])
def test_newton_reads_how_soft_a_loop_is(kind: str, weight: float, tmp_path: Path):
    (loop,) = four_bar(kind).control.loops
    stage = opened(tmp_path, four_bar(kind))
    prim = stage.GetPrimAtPath("/bot/Loops/coupler_loop")
    assert "MjcEqualityWeldAPI" in prim.GetPrimTypeInfo().GetAppliedAPISchemas()
    assert prim.GetAttribute("mjc:torqueScale").Get() == weight
    assert tuple(prim.GetAttribute("mjc:solref").Get()) == loop.solref
    assert tuple(prim.GetAttribute("mjc:solimp").Get()) == loop.solimp


@pytest.mark.parametrize("swapped", [False, True])
def test_a_loop_to_the_base_leaves_the_base_the_root(swapped: bool, tmp_path: Path):
    """The read-back takes the body without a joint above it for the root, and a loop is none."""
    robot = four_bar()
    (loop,) = robot.control.loops
    ends = (loop.a, LoopEnd("base", Pose((0.25, 0.0, 0.0))))
    a, b = reversed(ends) if swapped else ends
    control = replace(robot.control, loops=(replace(loop, a=a, b=b),))
    tree = replace(robot.tree, X_world_root=Pose((0.0, 0.0, 0.3)))
    robot = replace(robot, tree=tree, links=tree, control=control)
    inputs = write_robot_ports(tmp_path / "in", robot)
    run_step(UsdTarget(robot="bot"), inputs, inputs)
    options = {"usd": UsdOptions().model_dump(mode="json")}
    assert run_step(UsdReader(robot="bot", options=options), inputs, tmp_path / "same") == []


def test_a_tree_needs_one_velocity_iteration(tmp_path: Path):
    assert iterations(opened(tmp_path, pendulum())) == {1}
