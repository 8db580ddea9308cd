"""The scene of the USD: floor, light, gravity, the rate, and where the robot starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from pxr import Gf, Usd, UsdGeom, UsdPhysics
from robot_files import check_inputs, run_step, spoil_stage
from tiny import TinyRobot, tiny_quadruped

from assetbuild.facts.readers._usd import UsdSceneReader
from assetbuild.findings import Finding
from assetbuild.robot.model import Contact, Simulation
from assetbuild.targets.usd import Usd as UsdTarget

Spoil = Callable[[Usd.Stage], object]


def check(robot: TinyRobot, folder: Path, spoil: Spoil | None = None) -> list[Finding]:
    inputs = check_inputs(folder, robot, UsdTarget(robot="robot"), "usd")
    if spoil is not None:
        spoil_stage(inputs / "usd/scene.usda", spoil)
    return run_step(UsdSceneReader(robot="robot"), inputs, folder / "out")


def test_the_scene_of_a_robot_on_the_moon_is_equal(tmp_path: Path) -> None:
    moon = tiny_quadruped()
    simulation = Simulation(gravity=(0.0, 0.3, -1.6), timestep=0.003)
    feet = (("FR_foot_collision", Contact(friction=(0.5, 0.01, 0.02))),)
    moon = replace(moon, control=replace(moon.control, simulation=simulation, contacts=feet))
    assert check(moon, tmp_path) == []


@pytest.mark.parametrize("name", ["physics", "floor", "PhysicsMaterials"])
def test_a_robot_may_be_called_like_a_part_of_the_scene(name: str, tmp_path: Path) -> None:
    inputs = check_inputs(tmp_path, tiny_quadruped(), UsdTarget(robot=name), "usd")
    assert run_step(UsdSceneReader(robot=name), inputs, tmp_path / "out") == []


def set_to(path: str, value: object) -> Spoil:
    def spoil(stage: Usd.Stage) -> None:
        assert stage.GetAttributeAtPath(path).Set(value)

    return spoil


@pytest.mark.parametrize(
    ("rule", "subject", "spoil"),
    [
        ("gravity", "simulation", set_to("/World/physics.physics:gravityMagnitude", 9.0)),
        ("gravity", "simulation",
         set_to("/World/physics.physics:gravityDirection", Gf.Vec3f(0, 0, 1))),
        ("timestep", "simulation", set_to("/World/physics.physxScene:timeStepsPerSecond", 100)),
        ("friction", "floor", set_to(
            "/World/PhysicsMaterials/floor.physics:staticFriction", 0.1)),
        ("height", "floor", lambda s: UsdGeom.Xformable(
            s.GetPrimAtPath("/World/floor")).AddTranslateOp().Set((0.0, 0.0, 0.1))),
        ("collides", "floor", lambda s: s.GetPrimAtPath("/World/floor").RemoveAPI(
            UsdPhysics.CollisionAPI)),
        ("friction", "floor", lambda s: s.GetRelationshipAtPath(
            "/World/floor.material:binding:physics").SetTargets([])),
        ("initial_pose", "start FR_calf",
         set_to("/World/robot/FR_calf.xformOp:translate", Gf.Vec3d(0, 0, 1))),
        ("intensity", "light", set_to("/World/light.inputs:intensity", 1.0)),
        ("size", "floor", set_to("/World/floor.width", 1.0)),
        ("restitution", "floor", set_to(
            "/World/PhysicsMaterials/floor.physics:restitution", 0.5)),
        ("frictioncombinemode", "floor", set_to(
            "/World/PhysicsMaterials/floor.physxMaterial:frictionCombineMode", "min")),
    ],
)  # fmt: skip
def test_what_changed_is_named(rule: str, subject: str, spoil: Spoil, tmp_path: Path) -> None:
    findings = check(tiny_quadruped(), tmp_path, spoil)
    named = [f for f in findings if f.rule == f"equal.usd_scene.{rule}"]
    assert subject in {f.subject for f in named}
    assert all({"expected", "found"} <= set(f.data) for f in named)
