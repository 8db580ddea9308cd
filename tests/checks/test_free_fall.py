"""What does not fall freely is found, in MuJoCo and in PhysX."""

from __future__ import annotations

from pathlib import Path

import pytest
from checks.engines import needs_physx
from pxr import Sdf, Usd, UsdPhysics
from robot_files import edit, figures, mjcf_inputs, ranked, run_step, usd_inputs
from tiny import TinyRobot, pendulum, tiny_quadruped, with_control

from assetbuild.checks._mujoco import FreeFall
from assetbuild.checks._physx import PhysxFreeFall
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.model import MjcfOnly, Simulation

Check = type[FreeFall | PhysxFreeFall]
CHECKS = [FreeFall, pytest.param(PhysxFreeFall, marks=needs_physx)]


def drop(robot: TinyRobot, folder: Path, check: Check) -> float:
    """How far it falls, m, of which nothing is said."""
    inputs = (mjcf_inputs if check is FreeFall else usd_inputs)(folder, robot)
    assert run_step(check(robot="robot"), inputs, folder) == []
    return float(figures(folder)["drop_m"])


def expected_drop(check: Check) -> float:
    """Not the continuous g t^2 / 2: PhysX's gravity comes in 8 parts per step."""
    extra = 0.005 if check is FreeFall else 0.005 / 8
    return 9.81 / 2 * 0.4 * (0.4 + extra)


@pytest.mark.parametrize("check", CHECKS)
def test_quadruped_falls_as_the_integrator_must(tmp_path: Path, check: Check) -> None:
    """Down, or where gravity points."""
    robot = tiny_quadruped()
    assert drop(robot, tmp_path, check) == pytest.approx(expected_drop(check), rel=1e-4)
    moon = Simulation(gravity=(0.5, 0.0, -1.62))
    drop(with_control(robot, simulation=moon), tmp_path / "moon", check)


@pytest.mark.parametrize("option", ['density="50" viscosity="0.1"', 'integrator="RK4"'])
def test_neither_air_nor_integrator_change_the_fall(tmp_path: Path, option: str) -> None:
    inputs = mjcf_inputs(tmp_path, tiny_quadruped())
    no_integrator = ' integrator="implicitfast"', ""
    edit(inputs / "mjcf/robot.xml", no_integrator, ("<option ", f"<option {option} "))
    assert run_step(FreeFall(robot="robot"), inputs, tmp_path / "out") == []


@pytest.mark.parametrize("check", CHECKS)
def test_weight_that_the_source_compensates_does_not_pull(tmp_path: Path, check: Check) -> None:
    robot = tiny_quadruped()
    only = (MjcfOnly("body", '<body gravcomp="1"/>', "trunk"),)
    fallen = drop(with_control(robot, mjcf_only=only), tmp_path, check)
    (carried,) = (b.inertial.mass_kg for b in robot.tree.bodies if b.name == "trunk" and b.inertial)
    share = 1.0 - carried / total_mass(robot.tree)
    assert fallen == pytest.approx(share * expected_drop(check), rel=1e-3)


def test_a_base_that_the_source_brakes_is_not_expected_to_fall_freely(tmp_path: Path) -> None:
    only = (MjcfOnly("freejoint", '<freejoint damping="300" armature="0"/>'),)
    inputs = mjcf_inputs(tmp_path, with_control(tiny_quadruped(), mjcf_only=only))
    assert 'damping="300"' in (inputs / "mjcf/robot.xml").read_text()
    assert run_step(FreeFall(robot="robot"), inputs, tmp_path / "out") == []
    assert figures(tmp_path / "out")["skipped"].endswith("brakes the floating base: `damping` 300")


def test_springs_without_gravity_may_shake_it_by_what_steps_round(tmp_path: Path) -> None:
    calm = with_control(tiny_quadruped(), simulation=Simulation(gravity=(0.0, 0.0, 0.0)))
    inputs, joint = mjcf_inputs(tmp_path, calm), '<joint name="FR_calf_joint"'
    edit(inputs / "mjcf/robot.xml", (joint, f'{joint} stiffness="0.1" springref="1"'))
    assert run_step(FreeFall(robot="robot"), inputs, tmp_path / "out") == []
    found = figures(tmp_path / "out")
    assert abs(found["drop_m"]) > 1e-9
    assert found["relative_error"] < 0.003


FREE, TRUNK, CALF = '<freejoint name="floating_base_joint"/>', '<body name="trunk"', '"FR_calf"'


@pytest.mark.parametrize(
    ("edits", "severity"),
    [
        (((FREE, ""), ("<keyframe>", "<!--"), ("</keyframe>", "-->")), "error"),
        (((TRUNK, f'{TRUNK} gravcomp="0.5"'),), "error"),
        (((CALF, f'{CALF} gravcomp="0.5"'),), "warning"),
        ((("</mujoco>", ""),), "error"),
    ],
    ids=["welded to the world", "half weightless", "one calf", "does not load"],
)
def test_what_does_not_fall_freely_in_mujoco_is_found(
    tmp_path: Path, edits: tuple[tuple[str, str], ...], severity: str
) -> None:
    inputs = mjcf_inputs(tmp_path, tiny_quadruped())
    edit(inputs / "mjcf/robot.xml", *edits)
    found = run_step(FreeFall(robot="robot"), inputs, tmp_path / "out")
    assert ranked(found) == [("free_fall.drop", severity)]


@needs_physx
@pytest.mark.parametrize(
    ("drag", "weld", "severity"),
    [(0.1, False, "warning"), (1.0, False, "error"), (0, True, "error")],
)
def test_drag_and_a_weld_in_physx_are_found(
    tmp_path: Path, drag: float, weld: bool, severity: str
) -> None:
    def spoil(stage: Usd.Stage) -> None:
        number = Sdf.ValueTypeNames.Float
        for prim in stage.Traverse() if drag else ():
            if prim.HasAPI(UsdPhysics.RigidBodyAPI):
                prim.CreateAttribute("physxRigidBody:linearDamping", number).Set(drag)
        if weld:
            joint = UsdPhysics.FixedJoint.Define(stage, "/robot/Joints/root_joint")
            joint.CreateBody1Rel().SetTargets(["/robot/trunk"])

    inputs = usd_inputs(tmp_path, tiny_quadruped(), spoil)
    found = run_step(PhysxFreeFall(robot="robot"), inputs, tmp_path / "out")
    assert ranked(found) == [("physx.free_fall", severity)]


def test_a_fixed_base_is_not_dropped_and_the_figures_say_so(tmp_path: Path) -> None:
    inputs = mjcf_inputs(tmp_path, pendulum())
    for check in (FreeFall, PhysxFreeFall):
        assert run_step(check(robot="robot"), inputs, tmp_path / "out") == []
        assert figures(tmp_path / "out") == {"skipped": "fixed base"}
