"""What does not fall freely in PhysX is found."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from pxr import Sdf, Usd, UsdPhysics
from tiny import TinyRobot, check_inputs, pendulum, run_step, tiny_quadruped

from assetbuild.checks.physx_free_fall import PhysxFreeFall
from assetbuild.findings import Finding
from assetbuild.pipeline.recipes import whole_model
from assetbuild.robot.model import Simulation
from assetbuild.simulators.experiments import Fall
from assetbuild.targets.usd import Usd as UsdTarget

pytest.importorskip("ovphysx", reason="needs the extra `physx`")


def check(robot: TinyRobot, folder: Path, drag: float = 0.0, weld: bool = False) -> list[Finding]:
    inputs = check_inputs(folder, robot, UsdTarget(robot="robot"), "usd")
    stage = Usd.Stage.Open(str(inputs / "usd/robot.usda"))
    for prim in stage.Traverse() if drag else ():
        if prim.HasAPI(UsdPhysics.RigidBodyAPI):
            prim.CreateAttribute("physxRigidBody:linearDamping", Sdf.ValueTypeNames.Float).Set(drag)
    if weld:
        joint = UsdPhysics.FixedJoint.Define(stage, "/robot/Joints/root_joint")
        joint.CreateBody1Rel().SetTargets(["/robot/trunk"])
    stage.Save()
    del stage
    return run_step(PhysxFreeFall(robot="robot"), inputs, folder / "out")


def test_quadruped_falls_as_the_solver_must(tmp_path: Path) -> None:
    assert check(tiny_quadruped(), tmp_path) == []
    figures = json.loads((tmp_path / "out/figures.json").read_text())
    # Not the continuous g t^2 / 2: gravity comes in 8 parts per step.
    assert figures["drop_m"] == pytest.approx(9.81 / 2 * 0.4 * (0.4 + 0.005 / 8), rel=1e-4)


def test_gravity_may_point_elsewhere(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    moon = replace(robot.control, simulation=Simulation(gravity=(0.5, 0.0, -1.62)))
    assert check(replace(robot, control=moon), tmp_path) == []


@pytest.mark.parametrize(("drag", "severity"), [(0.1, "warning"), (1.0, "error")])
def test_drag_is_found(tmp_path: Path, drag: float, severity: str) -> None:
    found = check(tiny_quadruped(), tmp_path, drag=drag)
    assert [(f.rule, f.severity) for f in found] == [("physx.free_fall", severity)]


def test_weld_is_found(tmp_path: Path) -> None:
    found = check(tiny_quadruped(), tmp_path, weld=True)
    assert [(f.rule, f.severity) for f in found] == [("physx.free_fall", "error")]


def test_fixed_base_is_not_dropped(tmp_path: Path) -> None:
    assert check(pendulum(), tmp_path) == []


def test_recipe_decides_whether_and_how_long() -> None:
    base = {"schema": "assetbuild/v1", "robot": "r", "source": {"path": ".", "urdf": "r.urdf"}}
    both = {"simulators": ["mujoco", "physx"], "free_fall": {"seconds": 0.2}}
    asked = whole_model().model_validate(base | {"validate": both})
    assert PhysxFreeFall.configure(asked) == PhysxFreeFall(robot="r", drop=Fall(seconds=0.2))
    assert PhysxFreeFall.configure(whole_model().model_validate(base)) is None
