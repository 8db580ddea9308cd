"""The generated modules import, against stubs that know exactly the fields of each generation."""

from __future__ import annotations

import dataclasses
import importlib.util
import math
import re
import sys
import types
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tiny import TinyRobot, pendulum, run_step, tiny_quadruped, write_robot_ports

from assetbuild.recipe.models import Recipe
from assetbuild.robot.model import Body, Joint
from assetbuild.targets.isaaclab import IsaacLab

# Field lists of Isaac Lab 2.3.2 and 3.0.0, as their classes declare them.
COMMON = ("joint_names_expr", "stiffness", "damping", "armature", "friction")
COMMON = (*COMMON, "dynamic_friction", "viscous_friction")
EFFORTS = {
    2: ("effort_limit", "velocity_limit", "effort_limit_sim", "velocity_limit_sim"),
    3: (
        "actuator_effort_limit",
        "actuator_velocity_limit",
        "joint_effort_limit",
        "joint_velocity_limit",
    ),
}
BODY = (
    "disable_gravity",
    "linear_damping",
    "angular_damping",
    "max_linear_velocity",
    "max_angular_velocity",
    "max_depenetration_velocity",
    "max_contact_impulse",
    "enable_gyroscopic_forces",
    "retain_accelerations",
    "solver_position_iteration_count",
    "solver_velocity_iteration_count",
    "sleep_threshold",
    "stabilization_threshold",
)
ROOT = (
    "articulation_enabled",
    "enabled_self_collisions",
    "solver_position_iteration_count",
    "solver_velocity_iteration_count",
    "sleep_threshold",
    "stabilization_threshold",
)
SPAWN = (
    "usd_path",
    "variants",
    "scale",
    "articulation_props",
    "rigid_props",
    "joint_drive_props",
    "activate_contact_sensors",
)


def stub(name: str, *fields: str) -> type:
    """A class that takes these keywords and no others."""
    return dataclasses.make_dataclass(name, [(f, Any, None) for f in fields], kw_only=True)


def stubs(generation: int) -> dict[str, types.ModuleType]:
    """The modules that a generated one imports, by name."""
    actuator = (*COMMON, *EFFORTS[generation])
    sim = {
        "SimulationCfg": stub("SimulationCfg", "dt", "render_interval", "gravity", "device"),
        "UsdFileCfg": stub("UsdFileCfg", *SPAWN),
    }
    found: dict[str, dict[str, object]] = {
        "isaaclab.actuators": {
            "ImplicitActuatorCfg": stub("ImplicitActuatorCfg", *actuator),
            "IdealPDActuatorCfg": stub("IdealPDActuatorCfg", *actuator),
            "DCMotorCfg": stub("DCMotorCfg", *actuator, "saturation_effort"),
        },
        "isaaclab.assets": {
            "ArticulationCfg": stub(
                "ArticulationCfg",
                "spawn",
                "init_state",
                "actuators",
                "soft_joint_pos_limit_factor",
                "articulation_root_prim_path",
            )
        },
    }
    initial = ("pos", "rot", "lin_vel", "ang_vel", "joint_pos", "joint_vel")
    cfg: Any = found["isaaclab.assets"]["ArticulationCfg"]
    cfg.InitialStateCfg = stub("InitialStateCfg", *initial)
    if generation == 2:
        sim["RigidBodyPropertiesCfg"] = stub("RigidBodyPropertiesCfg", *BODY)
        sim["ArticulationRootPropertiesCfg"] = stub("Root", *ROOT, "fix_root_link")
    else:
        found["isaaclab_physx.sim.schemas"] = {
            "PhysxRigidBodyCfg": stub("PhysxRigidBodyCfg", *BODY),
            "PhysxArticulationCfg": stub("PhysxArticulationCfg", *ROOT),
        }
        newton = {"NewtonArticulationCfg": stub("Newton", "self_collision_enabled")}
        found["isaaclab_newton.sim.schemas"] = newton
    found["isaaclab.sim"] = sim
    modules = {}
    for name, content in found.items():
        parts = name.split(".")
        for end in range(1, len(parts) + 1):
            package = ".".join(parts[:end])
            modules.setdefault(package, types.ModuleType(package))
        vars(modules[name]).update(content)
    return modules


@pytest.fixture(params=[2, 3])
def generation(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    for name, module in stubs(request.param).items():
        monkeypatch.setitem(sys.modules, name, module)
    yield request.param


def load(robot: TinyRobot, folder: Path, generation: int, name: str = "robot") -> Any:
    inputs = write_robot_ports(folder / "inputs", robot)
    run_step(IsaacLab(robot=name), inputs, folder / "out")
    (path,) = (folder / "out/isaaclab").glob(f"*_isaaclab_{generation}.py")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def matches(cfg: Any, joint: str) -> list[Any]:
    """Groups that claim a joint, as Isaac Lab matches: whole names."""
    return [
        group
        for group in cfg.actuators.values()
        if any(re.fullmatch(pattern, joint) for pattern in group.joint_names_expr)
    ]


def test_each_joint_is_in_one_group_with_its_numbers(tmp_path: Path, generation: int) -> None:
    robot = tiny_quadruped()
    cfg = load(robot, tmp_path, generation).ROBOT_CFG
    effort = "effort_limit_sim" if generation == 2 else "joint_effort_limit"
    velocity = "velocity_limit_sim" if generation == 2 else "joint_velocity_limit"
    for actuator in robot.control.actuators:
        (group,) = matches(cfg, actuator.joint)
        assert (group.stiffness, group.damping) == (actuator.kp, actuator.kd)
        assert getattr(group, effort) == actuator.effort
        assert getattr(group, velocity) == actuator.velocity
        assert (group.armature, group.friction) == (actuator.armature, actuator.friction)
        assert group.viscous_friction == actuator.damping


def test_it_starts_at_home_a_hair_above_the_floor(tmp_path: Path, generation: int) -> None:
    robot = tiny_quadruped()
    cfg = load(robot, tmp_path, generation).ROBOT_CFG
    home = robot.control.keyframes[0]
    assert home.base is not None
    assert cfg.init_state.joint_pos == dict(home.joints)
    assert cfg.init_state.pos == pytest.approx((0.0, 0.0, home.base.xyz[2] + 0.001))


def test_quaternions_have_the_order_of_their_generation(tmp_path: Path, generation: int) -> None:
    robot = tiny_quadruped()
    half = math.sqrt(0.5)
    home = robot.control.keyframes[0]
    assert home.base is not None
    turned = replace(home, base=replace(home.base, quat=(half, 0.0, 0.0, half)))
    robot = replace(robot, control=replace(robot.control, keyframes=(turned,)))
    rot = load(robot, tmp_path, generation).ROBOT_CFG.init_state.rot
    assert rot == ((half, 0.0, 0.0, half) if generation == 2 else (0.0, 0.0, half, half))


def test_torque_motors_limit_the_model_not_the_solver(tmp_path: Path, generation: int) -> None:
    (group,) = matches(load(pendulum(), tmp_path, generation).ROBOT_CFG, "swing_joint")
    assert type(group).__name__ == "IdealPDActuatorCfg"
    field = "effort_limit" if generation == 2 else "actuator_effort_limit"
    assert (getattr(group, field), group.stiffness, group.damping) == (5.0, 0.0, 0.0)


def test_self_collisions_and_time_are_repeated(tmp_path: Path, generation: int) -> None:
    module = load(tiny_quadruped(), tmp_path, generation)
    props = module.ROBOT_CFG.spawn.articulation_props
    if generation == 3:
        props, newton = props
        assert newton.self_collision_enabled is True
    assert props.enabled_self_collisions is True
    simulation = module.SIMULATION_CFG
    assert (simulation.dt, simulation.render_interval) == (0.005, 4)
    assert simulation.gravity == (0.0, 0.0, -9.81)
    assert module.ROBOT_CFG.spawn.variants == {"Physics": "physics"}


def test_names_are_those_of_the_usd(tmp_path: Path, generation: int) -> None:
    robot = pendulum()
    joint = replace(robot.tree.joints[0], name="swing.joint-1")
    tree = replace(robot.tree, joints=(joint,))
    actuators = (replace(robot.control.actuators[0], joint=joint.name),)
    home = replace(robot.control.keyframes[0], joints=((joint.name, 0.5),))
    control = replace(robot.control, actuators=actuators, keyframes=(home,))
    cfg = load(replace(robot, tree=tree, control=control), tmp_path, generation, "2-arm")._2_ARM_CFG
    assert cfg.init_state.joint_pos == {"swing_joint_1": 0.5}
    assert len(matches(cfg, "swing_joint_1")) == 1
    assert cfg.spawn.usd_path.endswith("usd/2-arm.usda")


def test_a_robot_without_joints_has_no_actuators(tmp_path: Path, generation: int) -> None:
    robot = pendulum()
    weld = Joint("weld", "fixed", "base", "arm")
    tree = replace(robot.tree, joints=(weld,), bodies=(Body("base"), robot.tree.bodies[1]))
    control = replace(robot.control, actuators=(), keyframes=())
    cfg = load(replace(robot, tree=tree, control=control), tmp_path, generation).ROBOT_CFG
    assert (cfg.actuators, cfg.init_state.joint_pos) == ({}, {})


def test_losses_are_told(tmp_path: Path) -> None:
    robot = pendulum()
    inputs = write_robot_ports(tmp_path / "inputs", robot)
    found = run_step(IsaacLab(robot="r", has_usd=False), inputs, tmp_path / "out")
    assert [f.rule for f in found] == ["isaaclab.no_usd"]
    dc = tuple(replace(a, model="dc_motor") for a in robot.control.actuators)
    robot = replace(robot, control=replace(robot.control, actuators=dc))
    inputs = write_robot_ports(tmp_path / "dc", robot)
    found = run_step(IsaacLab(robot="r"), inputs, tmp_path / "dc_out")
    assert [f.rule for f in found] == ["isaaclab.saturation"]
    general = tuple(replace(a, model="general") for a in robot.control.actuators)
    robot = replace(robot, control=replace(robot.control, actuators=general))
    inputs = write_robot_ports(tmp_path / "general", robot)
    found = run_step(IsaacLab(robot="r"), inputs, tmp_path / "general_out")
    assert [f.rule for f in found] == ["isaaclab.general"]


def test_recipe_configures_it() -> None:
    base = {"schema": "assetbuild/v1", "robot": "r", "source": {"path": ".", "urdf": "r.urdf"}}
    wish = {"soft_joint_pos_limit_factor": 0.9}
    recipe = Recipe.model_validate(base | {"targets": ["isaaclab"], "isaaclab": wish})
    target = IsaacLab.configure(recipe)
    assert target.options.soft_joint_pos_limit_factor == 0.9
    assert not target.has_usd
