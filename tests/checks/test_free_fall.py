"""What does not fall freely is found, in MuJoCo and in PhysX."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from checks.engines import needs_physx
from pxr import Sdf, Usd, UsdPhysics
from robot_files import check_inputs, run_step
from tiny import TinyRobot, pendulum, tiny_quadruped

from assetbuild.checks._mujoco import FreeFall
from assetbuild.checks._physx import PhysxFreeFall
from assetbuild.findings import Finding
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.model import MjcfOnly, Simulation
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.usd import Usd as UsdTarget

CHECKS = [FreeFall, pytest.param(PhysxFreeFall, marks=needs_physx)]


def built(robot: TinyRobot, folder: Path, check: type[FreeFall | PhysxFreeFall]) -> Path:
    if check is FreeFall:
        return check_inputs(folder, robot, Mjcf(robot="robot"), "mjcf")
    return check_inputs(folder, robot, UsdTarget(robot="robot"), "usd")


def rules(found: list[Finding]) -> list[tuple[str, str]]:
    return [(finding.rule, finding.severity) for finding in found]


@pytest.mark.parametrize("check", CHECKS)
def test_quadruped_falls_as_the_integrator_must(
    tmp_path: Path, check: type[FreeFall | PhysxFreeFall]
) -> None:
    """Not the continuous g t^2 / 2: PhysX's gravity comes in 8 parts per step; down or not."""
    robot = tiny_quadruped()
    assert run_step(check(robot="robot"), built(robot, tmp_path, check), tmp_path) == []
    figures = json.loads((tmp_path / "figures.json").read_text())
    extra = 0.005 if check is FreeFall else 0.005 / 8
    assert figures["drop_m"] == pytest.approx(9.81 / 2 * 0.4 * (0.4 + extra), rel=1e-4)
    moon = replace(robot.control, simulation=Simulation(gravity=(0.5, 0.0, -1.62)))
    inputs = built(replace(robot, control=moon), tmp_path / "moon", check)
    assert run_step(check(robot="robot"), inputs, tmp_path / "out") == []


@pytest.mark.parametrize("option", ['density="50" viscosity="0.1"', 'integrator="RK4"'])
def test_neither_air_nor_integrator_change_the_fall(tmp_path: Path, option: str) -> None:
    inputs = built(tiny_quadruped(), tmp_path, FreeFall)
    file = inputs / "mjcf/robot.xml"
    text = file.read_text().replace(' integrator="implicitfast"', "")
    file.write_text(text.replace("<option ", f"<option {option} ", 1))
    assert option in file.read_text()
    assert run_step(FreeFall(robot="robot"), inputs, tmp_path / "out") == []


@pytest.mark.parametrize("check", CHECKS)
def test_weight_that_the_source_compensates_does_not_pull(
    tmp_path: Path, check: type[FreeFall | PhysxFreeFall]
) -> None:
    robot = tiny_quadruped()
    only = (MjcfOnly("body", '<body gravcomp="1"/>', "trunk"),)
    inputs = built(replace(robot, control=replace(robot.control, mjcf_only=only)), tmp_path, check)
    assert run_step(check(robot="robot"), inputs, tmp_path) == []
    figures = json.loads((tmp_path / "figures.json").read_text())
    (carried,) = (b.inertial.mass_kg for b in robot.tree.bodies if b.name == "trunk" and b.inertial)
    share = 1.0 - carried / total_mass(robot.tree)
    extra = 0.005 if check is FreeFall else 0.005 / 8
    assert figures["drop_m"] == pytest.approx(share * 9.81 / 2 * 0.4 * (0.4 + extra), rel=1e-3)


def test_springs_without_gravity_may_shake_it_by_what_steps_round(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    calm = replace(robot.control, simulation=Simulation(gravity=(0.0, 0.0, 0.0)))
    inputs = built(replace(robot, control=calm), tmp_path, FreeFall)
    file, joint = inputs / "mjcf/robot.xml", '<joint name="FR_calf_joint"'
    file.write_text(file.read_text().replace(joint, f'{joint} stiffness="0.1" springref="1"'))
    assert run_step(FreeFall(robot="robot"), inputs, tmp_path / "out") == []
    figures = json.loads((tmp_path / "out/figures.json").read_text())
    assert abs(figures["drop_m"]) > 1e-9
    assert figures["relative_error"] < 0.003


WELDED = {
    '<freejoint name="floating_base_joint"/>': "",
    "<keyframe>": "<!--",
    "</keyframe>": "-->",
}
MUJOCO = {
    "welded to the world": (WELDED, "error"),
    "half weightless": ({'<body name="trunk"': '<body name="trunk" gravcomp="0.5"'}, "error"),
    "one calf": ({'<body name="FR_calf"': '<body name="FR_calf" gravcomp="0.5"'}, "warning"),
    "does not load": ({"</mujoco>": ""}, "error"),
}


@pytest.mark.parametrize("what", MUJOCO)
def test_what_does_not_fall_freely_in_mujoco_is_found(tmp_path: Path, what: str) -> None:
    spoil, severity = MUJOCO[what]
    inputs = built(tiny_quadruped(), tmp_path, FreeFall)
    path = inputs / "mjcf/robot.xml"
    for old, new in spoil.items():
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))
    found = run_step(FreeFall(robot="robot"), inputs, tmp_path / "out")
    assert rules(found) == [("free_fall.drop", severity)]


@needs_physx
@pytest.mark.parametrize(
    ("drag", "weld", "severity"),
    [(0.1, False, "warning"), (1.0, False, "error"), (0, True, "error")],
)
def test_drag_and_a_weld_in_physx_are_found(
    tmp_path: Path, drag: float, weld: bool, severity: str
) -> None:
    inputs = built(tiny_quadruped(), tmp_path, PhysxFreeFall)
    stage = Usd.Stage.Open(str(inputs / "usd/robot.usda"))
    for prim in stage.Traverse() if drag else ():
        if prim.HasAPI(UsdPhysics.RigidBodyAPI):
            prim.CreateAttribute("physxRigidBody:linearDamping", Sdf.ValueTypeNames.Float).Set(drag)
    if weld:
        joint = UsdPhysics.FixedJoint.Define(stage, "/robot/Joints/root_joint")
        joint.CreateBody1Rel().SetTargets(["/robot/trunk"])
    stage.Save()
    del stage
    found = run_step(PhysxFreeFall(robot="robot"), inputs, tmp_path / "out")
    assert rules(found) == [("physx.free_fall", severity)]


def test_a_fixed_base_is_not_dropped_and_the_figures_say_so(tmp_path: Path) -> None:
    inputs = built(pendulum(), tmp_path, FreeFall)
    for check in (FreeFall, PhysxFreeFall):
        assert run_step(check(robot="robot"), inputs, tmp_path / "out") == []
        figures = json.loads((tmp_path / "out/figures.json").read_text())
        assert figures == {"skipped": "fixed base"}
