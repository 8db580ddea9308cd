"""The generated modules import, against stubs that know exactly the fields of each generation."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import math
import re
import sys
import types
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tiny import TinyRobot, pendulum, run_step, sprung, tiny_quadruped, write_robot_ports

from assetbuild.errors import UsageError
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.table import Key, Table
from assetbuild.pipeline.recipes import whole_model
from assetbuild.report.diff import changes
from assetbuild.report.sides import Form, Side, foreign_side
from assetbuild.robot.ranges import Randomize
from assetbuild.simulators.readings import FALL, FALL_S, FORMAT, HEIGHT, fall_m
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


# Keywords of the event terms of 2.3.2 and 3.0.0, which agree: (mandatory, optional).
EVENTS = {
    "randomize_rigid_body_mass": (
        {"asset_cfg", "mass_distribution_params", "operation"},
        {"distribution", "recompute_inertia"},
    ),
    "randomize_rigid_body_com": ({"asset_cfg", "com_range"}, set()),
    "randomize_actuator_gains": (
        {"asset_cfg"},
        {
            "stiffness_distribution_params",
            "damping_distribution_params",
            "operation",
            "distribution",
        },
    ),
    "randomize_joint_parameters": (
        {"asset_cfg"},
        {
            "friction_distribution_params",
            "armature_distribution_params",
            "operation",
            "distribution",
        },
    ),
    "randomize_rigid_body_material": (
        {
            "asset_cfg",
            "static_friction_range",
            "dynamic_friction_range",
            "restitution_range",
            "num_buckets",
        },
        {"make_consistent"},
    ),
}


def event_term(func: str, mode: str, params: dict[str, Any]) -> types.SimpleNamespace:
    mandatory, optional = EVENTS[func]
    assert mandatory <= set(params) <= mandatory | optional, func
    return types.SimpleNamespace(func=func, mode=mode, params=params)


def scene_entity(name: str, **chosen: list[str]) -> types.SimpleNamespace:
    assert set(chosen) <= {"body_names", "joint_names"}
    return types.SimpleNamespace(name=name, **chosen)


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
            "DelayedPDActuatorCfg": stub("DelayedPD", *actuator, "min_delay", "max_delay"),
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
    found["isaaclab.envs"] = {"mdp": types.SimpleNamespace(**{n: n for n in EVENTS})}
    found["isaaclab.managers"] = {
        "EventTermCfg": event_term,
        "SceneEntityCfg": scene_entity,
    }
    found["isaaclab.utils"] = {"configclass": lambda made: made}
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
        found["isaaclab_newton.physics"] = {
            "MJWarpSolverCfg": stub("MJWarpSolverCfg", "integrator"),
            "NewtonCfg": stub("NewtonCfg", "solver_cfg"),
        }
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


def load(
    robot: TinyRobot, folder: Path, generation: int, name: str = "robot", **fields: Any
) -> Any:
    inputs = write_robot_ports(folder / "inputs", robot)
    run_step(IsaacLab(robot=name, **fields), inputs, folder / "out")
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


def test_quaternions_have_the_order_of_their_generation(tmp_path: Path, generation: int) -> None:
    robot = tiny_quadruped()
    half = math.sqrt(0.5)
    home = robot.control.keyframes[0]
    assert home.base is not None
    turned = replace(home, base=replace(home.base, quat=(half, 0.0, 0.0, half)))
    robot = replace(robot, control=replace(robot.control, keyframes=(turned,)))
    rot = load(robot, tmp_path, generation).ROBOT_CFG.init_state.rot
    assert rot == ((half, 0.0, 0.0, half) if generation == 2 else (0.0, 0.0, half, half))


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


RANGES = {
    "links": {"trunk": {"density": [0.8, 1.2], "com": 0.02}, ".*": {}},
    "joints": {
        ".*_calf_joint": {"kp": [0.9, 1.1], "delay": [0, 2], "friction": [0.5, 2]},
        ".*": {"armature": [0.9, 1.1], "damping": [1, 2]},
    },
    "friction": [0.4, 1.2],
}


def test_the_events_say_the_recipe(tmp_path: Path, generation: int) -> None:
    ranges = Randomize.model_validate(RANGES)
    module = load(tiny_quadruped(), tmp_path, generation, randomize=ranges)
    terms = {k: v for k, v in vars(module.EventCfg).items() if not k.startswith("__")}
    assert {term.mode for term in terms.values()} == {"startup"}, "`com` of 2.x accumulates"
    density = terms["density_0"].params
    assert density["mass_distribution_params"] == (0.8, 1.2)
    assert density["recompute_inertia"] is True, "else the inertia stays behind"
    shifted = [t.params["asset_cfg"].body_names for t in terms.values() if "_com" in t.func]
    bodies = [body.name for body in tiny_quadruped().tree.bodies]
    assert shifted == [[body] for body in bodies], "one term moves all its bodies alike"
    assert terms["gains_0"].params["stiffness_distribution_params"] == (0.9, 1.1)
    assert terms["joints_0"].params["friction_distribution_params"] == (0.5, 2)
    assert len(terms["joints_1"].params["asset_cfg"].joint_names) == 8, "first match wins"
    assert terms["material"].params["static_friction_range"] == (0.4, 1.2)


def test_what_isaac_lab_cannot_randomize_is_told(tmp_path: Path) -> None:
    wide = {
        "links": {".*": {"stretch": 0.1}},
        "payloads": [{"link": "trunk", "mass": [0, 1], "size": [1, 1, 1]}],
        "joints": {".*": {"delay": [0, 2], "encoder_bias": 0.01, "friction": [0.5, 2]}},
    }
    inputs = write_robot_ports(tmp_path / "inputs", tiny_quadruped())
    target = IsaacLab(robot="r", randomize=Randomize.model_validate(wide))
    (finding,) = run_step(target, inputs, tmp_path / "out")
    assert finding.rule == "isaaclab.randomize"
    assert set(finding.data["without"]) == {
        "payloads",
        "stretch and shear",
        "delay of drives that are not `ideal_pd`",
        "encoder_bias",
        "damping apart from friction",
    }


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
    recipe = whole_model().model_validate(base | {"targets": ["isaaclab"], "isaaclab": wish})
    target = IsaacLab.configure(recipe)
    assert target.options.soft_joint_pos_limit_factor == 0.9
    assert not target.has_usd


def test_the_usd_is_looked_for_beside_a_link_to_the_module(tmp_path: Path, generation: int) -> None:
    """As a step sees its inputs: links into the store, where nothing lies beside the file."""
    load(tiny_quadruped(), tmp_path, generation)
    (path,) = (tmp_path / "out/isaaclab").glob(f"*_isaaclab_{generation}.py")
    link = tmp_path / "staged/isaaclab" / path.name
    link.parent.mkdir(parents=True)
    link.symlink_to(path)
    spec = importlib.util.spec_from_file_location(path.stem, link)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert Path(module.USD) == tmp_path / "staged/usd/robot.usda"


@pytest.mark.parametrize(("rest", "severity"), [(0.5, "error"), (0.0, "info")])
def test_a_spring_is_a_stiffness_and_its_rest_is_lost(rest: float, severity: str, tmp_path: Path):
    inputs = write_robot_ports(tmp_path / "in", sprung(rest=rest))
    found = run_step(IsaacLab(robot="robot"), inputs, tmp_path / "out")
    (spring,) = [f for f in found if f.rule == "isaaclab.spring"]
    assert (spring.severity, spring.data) == (severity, {"stiffness": 6.0, "rest": rest})


# --- the measuring script ------------------------------------------------------------------------


ROBOT = tiny_quadruped()
DRIVES = {drive.joint: drive for drive in ROBOT.control.actuators}
DT = ROBOT.control.simulation.timestep


def written(folder: Path, stiffness: float = 1.0) -> Path:
    """Readings in the words of the script. stiffness: factor on what it holds."""
    masses = {b.name: b.inertial.mass_kg if b.inertial else 0.0 for b in ROBOT.tree.bodies}
    facts: list[list[Any]] = [["body", name, "mass, kg", mass] for name, mass in masses.items()]
    for joint in ROBOT.tree.moving_joints:
        own, drive = ["joint", joint.name], DRIVES[joint.name]
        facts += [[*own, "lower", joint.limits.lower], [*own, "upper", joint.limits.upper]]
        facts += [[*own, "kp", stiffness * drive.kp], [*own, "kd", drive.kd]]
        facts += [[*own, "armature", drive.armature], [*own, "effort", drive.effort]]
    facts.append(["robot", "robot", FALL, fall_m(9.81, DT)])
    facts.append(["robot", "robot", HEIGHT, 0.28])
    told = {"format": FORMAT, "simulator": "Isaac Lab 3, newton_mjwarp", "facts": facts}
    path = folder / "robot_isaaclab.json"
    path.write_text(json.dumps(told))
    return path


def ours(height: float, folder: Path) -> Side:
    inputs = write_robot_ports(folder / "inputs", ROBOT)
    facts = dict(robot_table(Reference.of_ports(inputs, {})).facts)
    facts[Key("robot", "", FALL)] = fall_m(9.81, DT)
    facts[Key("robot", "", HEIGHT)] = height
    return Side("ours", {"robot": Form(lambda: Table(facts))})


def test_readings_of_the_same_robot_differ_in_nothing(tmp_path: Path) -> None:
    readings = foreign_side(written(tmp_path))
    assert "Isaac Lab 3" in readings.name
    assert changes(ours(0.289, tmp_path), readings).rows == ()


def test_a_gain_in_degrees_and_a_robot_that_sinks_are_told(tmp_path: Path) -> None:
    readings = foreign_side(written(tmp_path, stiffness=57.29577951308232))
    rows = changes(ours(0.30, tmp_path), readings).rows
    found = {(c.rank, c.quantity): c.note for c in rows}
    assert "degrees" in found["CRITICAL", "kp"]
    assert ("MEDIUM", HEIGHT) in found


def test_the_fall_is_that_of_steps_not_of_the_parabola():
    steps, speed, fallen = round(FALL_S / 0.005), 0.0, 0.0
    for _ in range(steps):
        speed += 9.81 * 0.005
        fallen += speed * 0.005
    assert fall_m(9.81, 0.005) == pytest.approx(fallen, rel=1e-12)


@pytest.mark.parametrize("text", ["{}", "[1]", "no json", json.dumps({"format": "other"})])
def test_other_files_are_no_readings(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(UsageError, match="holds no readings"):
        foreign_side(tmp_path / "a.json")
