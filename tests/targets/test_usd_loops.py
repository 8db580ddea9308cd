"""A loop is a joint outside of the articulation in USD, which PhysX solves with more iterations."""

from __future__ import annotations

from pathlib import Path

import pytest
from pxr import Usd, UsdPhysics
from tiny import four_bar, pendulum, run_step, write_robot_ports

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


def test_a_tree_needs_one_velocity_iteration(tmp_path: Path):
    assert iterations(opened(tmp_path, pendulum())) == {1}
