"""Surfaces per shape, masks, starts and the recipe's `usd` keys in the USD."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from pxr import Usd as UsdCore
from pxr import UsdPhysics
from tiny import TinyRobot, check_inputs, run_step, tiny_quadruped, with_mimic

from assetbuild.findings import Finding
from assetbuild.pipeline.recipes import whole_model
from assetbuild.robot.model import Contact
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.targets.usd import Usd


def build(
    robot: TinyRobot, folder: Path, options: dict[str, object] | None = None
) -> tuple[UsdCore.Stage, list[Finding]]:
    target = Usd(robot="robot", options=UsdOptions.model_validate(options or {}))
    inputs = check_inputs(folder, robot, target, "usd")
    found = run_step(target, inputs, folder / "again")
    return UsdCore.Stage.Open(str(inputs / "usd/robot.usda")), found


def with_surfaces(robot: TinyRobot, **surfaces: Contact) -> TinyRobot:
    return replace(robot, control=replace(robot.control, contacts=tuple(surfaces.items())))


def test_each_value_that_physx_cannot_hold_is_told_once(tmp_path: Path) -> None:
    soft = Contact(
        friction=(0.8, 0.02, 0.01),
        condim=6,
        priority=1,
        solref=(0.01, 1.0),
        solimp=(0.9, 0.95, 0.001, 0.5, 2.0),
        margin=0.001,
        gap=0.001,
    )
    robot = with_surfaces(tiny_quadruped(), FR_foot_collision=soft, FL_foot_collision=soft)
    _, found = build(robot, tmp_path)
    told = [f.data["value"] for f in found if f.rule == "usd.contact"]
    assert told == [
        "condim",
        "torsional and rolling friction",
        "priority",
        "solref",
        "solimp",
        "margin",
        "gap",
    ]


def test_joints_start_at_home_and_else_inside_of_their_limits(tmp_path: Path) -> None:
    stage, found = build(tiny_quadruped(), tmp_path / "home")
    knee = stage.GetPrimAtPath("/robot/Joints/FR_calf_joint")
    assert knee.GetAttribute("state:angular:physics:position").Get() == pytest.approx(-91.67, 1e-3)
    assert not [f for f in found if f.rule == "usd.start"]

    homeless = tiny_quadruped()
    homeless = replace(homeless, control=replace(homeless.control, keyframes=()))
    stage, found = build(homeless, tmp_path / "homeless")
    knee = stage.GetPrimAtPath("/robot/Joints/FR_calf_joint")
    at_limit = knee.GetAttribute("state:angular:physics:position").Get()
    assert at_limit == pytest.approx(knee.GetAttribute("physics:upperLimit").Get())
    assert len([f for f in found if f.rule == "usd.start"]) == 4


def test_the_recipe_decides_what_only_physx_knows(tmp_path: Path) -> None:
    options: dict[str, object] = {
        "instanceable": False,
        "drive_type": "acceleration",
        "mimics": False,
        "rigid_body": {"max_depenetration_velocity": 5.0, "angular_damping": 0.05},
        "articulation": {"self_collisions": False, "solver_position_iterations": 32},
    }
    robot = with_mimic(tiny_quadruped(), "FL_hip_joint", "FR_hip_joint", 1.0, 0.0)
    stage, found = build(robot, tmp_path, options)
    trunk = stage.GetPrimAtPath("/robot/trunk")
    assert trunk.GetAttribute("physxRigidBody:maxDepenetrationVelocity").Get() == 5.0
    assert trunk.GetAttribute("physxRigidBody:angularDamping").Get() == pytest.approx(0.05)
    assert trunk.GetAttribute("physxArticulation:solverPositionIterationCount").Get() == 32
    assert trunk.GetAttribute("physxArticulation:enabledSelfCollisions").Get() is False
    joint = stage.GetPrimAtPath("/robot/Joints/FL_hip_joint")
    assert UsdPhysics.DriveAPI(joint, "angular").GetTypeAttr().Get() == "acceleration"
    assert not joint.HasRelationship("newton:mimicJoint")
    assert [f.rule for f in found if f.subject == "joint FL_hip_joint"] == ["usd.mimic"]
    assert not [p for p in stage.Traverse() if p.IsInstance()]
    base = {"schema": "assetbuild/v1", "robot": "r", "source": {"path": ".", "urdf": "r.urdf"}}
    recipe = whole_model().model_validate(base | {"usd": options})
    assert Usd.configure(recipe).options == recipe.usd
