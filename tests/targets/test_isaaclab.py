"""The generated modules say only what the classes of each generation of Isaac Lab have."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from robot_files import emit, write_robot_ports
from tiny import TinyRobot, pendulum, sprung, tiny_quadruped, with_control

from assetbuild.errors import UsageError
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.standins import recorded
from assetbuild.facts.table import Key, Table
from assetbuild.pipeline.recipes import whole_model
from assetbuild.report.diff import changes
from assetbuild.report.sides import Form, Side, foreign_side
from assetbuild.robot.model import ActuatorModel
from assetbuild.robot.ranges import Randomize
from assetbuild.simulators.readings import FALL, FALL_S, FORMAT, HEIGHT, fall_m
from assetbuild.targets.isaaclab import IsaacLab

# Keywords of Isaac Lab 2.3.2 and 3.0.0, as their classes and event terms declare them.
BODY = """disable_gravity linear_damping angular_damping max_linear_velocity max_angular_velocity
max_depenetration_velocity max_contact_impulse enable_gyroscopic_forces retain_accelerations
solver_position_iteration_count solver_velocity_iteration_count sleep_threshold
stabilization_threshold"""
ROOT = """articulation_enabled enabled_self_collisions solver_position_iteration_count
solver_velocity_iteration_count sleep_threshold stabilization_threshold"""
DRIVE = """joint_names_expr stiffness damping armature friction dynamic_friction viscous_friction
{0}effort_limit {0}velocity_limit {1}"""
LIMITS = {2: ("", "effort_limit_sim velocity_limit_sim"),
          3: ("actuator_", "joint_effort_limit joint_velocity_limit")}  # fmt: skip
BOTH = {
    "isaaclab.sim.SimulationCfg": "dt render_interval gravity device",
    "isaaclab.sim.UsdFileCfg": "usd_path variants scale articulation_props rigid_props "
    "joint_drive_props activate_contact_sensors",
    "isaaclab.assets.ArticulationCfg": "spawn init_state actuators soft_joint_pos_limit_factor "
    "articulation_root_prim_path",
    "isaaclab.assets.ArticulationCfg.InitialStateCfg": "pos rot lin_vel ang_vel joint_pos "
    "joint_vel",
    "isaaclab.managers.EventTermCfg": "func mode params",
    "isaaclab.managers.SceneEntityCfg": "body_names joint_names",
    "isaaclab.actuators.ImplicitActuatorCfg": DRIVE,
    "isaaclab.actuators.IdealPDActuatorCfg": DRIVE,
    "isaaclab.actuators.DCMotorCfg": f"{DRIVE} saturation_effort",
    "isaaclab.actuators.DelayedPDActuatorCfg": f"{DRIVE} min_delay max_delay",
    "EventCfg": "*",
}
OWN = {
    2: {
        "isaaclab.sim.RigidBodyPropertiesCfg": BODY,
        "isaaclab.sim.ArticulationRootPropertiesCfg": f"{ROOT} fix_root_link",
    },
    3: {
        "isaaclab_physx.sim.schemas.PhysxRigidBodyCfg": BODY,
        "isaaclab_physx.sim.schemas.PhysxArticulationCfg": ROOT,
        "isaaclab_newton.sim.schemas.NewtonArticulationCfg": "self_collision_enabled",
        "isaaclab_newton.physics.MJWarpSolverCfg": "integrator",
        "isaaclab_newton.physics.NewtonCfg": "solver_cfg",
    },
}
EVENTS = {
    "randomize_rigid_body_mass": "asset_cfg mass_distribution_params operation ? distribution "
    "recompute_inertia",
    "randomize_rigid_body_com": "asset_cfg com_range ?",
    "randomize_actuator_gains": "asset_cfg ? stiffness_distribution_params "
    "damping_distribution_params operation distribution",
    "randomize_joint_parameters": "asset_cfg ? friction_distribution_params "
    "armature_distribution_params operation distribution",
    "randomize_rigid_body_material": "asset_cfg static_friction_range dynamic_friction_range "
    "restitution_range num_buckets ? make_consistent",
}
"""Mandatory keywords, a question mark, optional ones."""
RANGES = {
    "links": {"trunk": {"density": [0.8, 1.2], "com": 0.02}, ".*": {}},
    "joints": {
        ".*_calf_joint": {"kp": [0.9, 1.1], "delay": [0, 2], "friction": [0.5, 2]},
        ".*": {"armature": [0.9, 1.1], "damping": [1, 2]},
    },
    "friction": [0.4, 1.2],
}


ISAAC_LAB = IsaacLab(robot="robot")


def module_of(robot: TinyRobot, folder: Path, generation: int, **fields: Any) -> Any:
    """What a module says when it is executed with stand-ins."""
    emit(IsaacLab(robot="robot", **fields), robot, folder)
    return recorded(folder / f"out/isaaclab/robot_isaaclab_{generation}.py")


def calls(value: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """(class or function, its keywords) of all calls inside of what was recorded."""
    if isinstance(value, dict):
        if value.get("@"):
            keywords = {key: each for key, each in value.items() if key not in ("()", "*", "@")}
            yield value["()"], keywords
        for each in value.values():
            yield from calls(each)
    for each in value if isinstance(value, list) else ():
        yield from calls(each)


def with_models(*models: ActuatorModel) -> TinyRobot:
    """The quadruped, whose joints have these kinds of drives in turn."""
    robot = tiny_quadruped()
    rows = tuple(
        replace(row, model=models[number % len(models)], stall=70.0)
        for number, row in enumerate(robot.control.actuators)
    )
    return with_control(robot, actuators=rows)


@pytest.mark.parametrize("generation", [2, 3])
def test_a_module_says_nothing_that_its_generation_lacks(generation: int, tmp_path: Path) -> None:
    robot = with_models("pd", "ideal_pd", "dc_motor", "velocity")
    ranges = Randomize.model_validate(RANGES)
    known = {
        name: set(words.format(*LIMITS[generation]).split())
        for name, words in (BOTH | OWN[generation]).items()
    }
    found = list(calls(module_of(robot, tmp_path, generation, randomize=ranges)))
    assert len(found) > 30
    for name, keywords in found:
        assert name in known, name
        assert keywords.keys() <= known[name], name
        if name.endswith("EventTermCfg"):
            mandatory, _, optional = EVENTS[keywords["func"]["()"].split(".")[-1]].partition("?")
            said = keywords["params"].keys()
            assert set(mandatory.split()) <= said <= {*mandatory.split(), *optional.split()}


@pytest.mark.parametrize("generation", [2, 3])
def test_quaternions_have_the_order_of_their_generation(generation: int, tmp_path: Path) -> None:
    robot, half = tiny_quadruped(), math.sqrt(0.5)
    home = robot.control.keyframes[0]
    assert home.base is not None
    turned = replace(home, base=replace(home.base, quat=(half, 0.0, 0.0, half)))
    robot = with_control(robot, keyframes=(turned,))
    rot = module_of(robot, tmp_path, generation)["ROBOT_CFG"]["init_state"]["rot"]
    assert rot == ([half, 0.0, 0.0, half] if generation == 2 else [0.0, 0.0, half, half])


def test_what_isaac_lab_cannot_randomize_is_told(tmp_path: Path) -> None:
    wide = {
        "links": {".*": {"stretch": 0.1}},
        "payloads": [{"link": "trunk", "mass": [0, 1], "size": [1, 1, 1]}],
        "joints": {".*": {"delay": [0, 2], "encoder_bias": 0.01, "friction": [0.5, 2]}},
    }
    target = IsaacLab(robot="robot", randomize=Randomize.model_validate(wide))
    (finding,) = emit(target, tiny_quadruped(), tmp_path)
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
    found = emit(IsaacLab(robot="robot", has_usd=False), robot, tmp_path / "usd")
    assert [f.rule for f in found] == ["isaaclab.no_usd"]
    general = tuple(replace(a, model="general") for a in robot.control.actuators)
    robot = with_control(robot, actuators=general)
    assert [f.rule for f in emit(ISAAC_LAB, robot, tmp_path / "general")] == ["isaaclab.general"]
    for rest, severity in ((0.5, "error"), (0.0, "info")):
        found = emit(ISAAC_LAB, sprung(rest=rest), tmp_path / severity)
        (spring,) = [f for f in found if f.rule == "isaaclab.spring"]
        assert (spring.severity, spring.data) == (severity, {"stiffness": 6.0, "rest": rest})


def test_recipe_configures_it() -> None:
    base = {"schema": "assetbuild/v1", "robot": "r", "source": {"path": ".", "urdf": "r.urdf"}}
    wish = {"soft_joint_pos_limit_factor": 0.9}
    recipe = whole_model().model_validate(base | {"targets": ["isaaclab"], "isaaclab": wish})
    target = IsaacLab.configure(recipe)
    assert target.options.soft_joint_pos_limit_factor == 0.9
    assert not target.has_usd


def test_the_usd_is_looked_for_beside_a_link_to_the_module(tmp_path: Path) -> None:
    """As a step sees its inputs: links into the store, where nothing lies beside the file."""
    emit(ISAAC_LAB, tiny_quadruped(), tmp_path)
    text = (tmp_path / "out/isaaclab/robot_isaaclab_3.py").read_text()
    (line,) = [line for line in text.splitlines() if line.startswith("USD = ")]
    link = tmp_path / "staged/isaaclab/robot_isaaclab_3.py"
    link.parent.mkdir(parents=True)
    link.symlink_to(tmp_path / "out/isaaclab/robot_isaaclab_3.py")
    said: dict[str, Any] = {"Path": Path, "__file__": str(link)}
    exec(line, said)  # noqa: S102 - our own module
    assert Path(said["USD"]) == tmp_path / "staged/usd/robot.usda"


# --- the measuring script ------------------------------------------------------------------------


DT = tiny_quadruped().control.simulation.timestep


def written(folder: Path, stiffness: float = 1.0) -> Path:
    """Readings in the words of the script. stiffness: factor on what it holds."""
    robot = tiny_quadruped()
    facts = [
        ["joint", drive.joint, "kp", stiffness * drive.kp] for drive in robot.control.actuators
    ]
    facts += [["robot", "robot", FALL, fall_m(9.81, DT)], ["robot", "robot", HEIGHT, 0.28]]
    told = {"format": FORMAT, "simulator": "Isaac Lab 3, newton_mjwarp", "facts": facts}
    path = folder / "robot_isaaclab.json"
    path.write_text(json.dumps(told))
    return path


def ours(height: float, folder: Path) -> Side:
    inputs = write_robot_ports(folder / "inputs", tiny_quadruped())
    facts = dict(robot_table(Reference.of_ports(inputs, {})).facts)
    facts |= {Key("robot", "", FALL): fall_m(9.81, DT), Key("robot", "", HEIGHT): height}
    return Side("ours", {"robot": Form(lambda: Table(facts))})


def test_readings_of_another_gain_and_a_robot_that_sinks_are_told(tmp_path: Path) -> None:
    readings = foreign_side(written(tmp_path))
    assert "Isaac Lab 3" in readings.name
    assert changes(ours(0.289, tmp_path), readings).rows == ()
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
