"""What the modules for Isaac Lab must say, from the robot, the recipe and Isaac Lab's own rules."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import asdict, replace
from typing import Any

from assetbuild.facts.readers.isaaclab.said import (
    BODY_PROPERTIES,
    FORM,
    IMPLICIT,
    LIMITS,
    PROPERTIES,
    READ,
    SELF_COLLISIONS,
    SPAWN,
    Generation,
    model_of,
)
from assetbuild.facts.reference import Reference, pose_value
from assetbuild.facts.statements import put_words
from assetbuild.facts.syntax import Module
from assetbuild.facts.table import Value, Writer
from assetbuild.facts.trainers import (
    Event,
    delay_s,
    massive_bodies,
    randomize_of,
    ranges_of,
    stall_of,
    start_of,
)
from assetbuild.robot.joint_springs import as_drives
from assetbuild.robot.model import Actuator
from assetbuild.robot.ranges import Randomize, claimed, per_axis
from assetbuild.simulators.isaaclab_script import script
from assetbuild.simulators.usd_names import body_identifiers
from assetbuild.simulators.usd_options import UsdOptions

LOOPS = ("pd", "ideal_pd", "dc_motor")
"""Models with a stiffness."""
MATERIALS = 64
"""Contact materials to draw from; PhysX has room for 64000 in all environments."""
NEWTON = {
    "NEWTON_CFG": "NewtonCfg",
    "NEWTON_CFG.solver_cfg": "MJWarpSolverCfg",
    "NEWTON_CFG.solver_cfg.integrator": "implicitfast",
}
CLEARANCE_M = 0.001
"""Soles that start inside of the floor are thrown off it."""


def expected_module(reference: Reference, robot: str, generation: Generation) -> Writer:
    """All facts and words of one module, in our units and order of quaternions."""
    book = Writer()
    asked = reference.options.get("isaaclab") or {}
    _robot(reference, robot, asked, book)
    if generation == 3:
        book.put("robot", "", {f"{FORM}:{word}": value for word, value in NEWTON.items()})
    _spawn(reference, robot, asked, generation, book)
    for joint, position in start_of(reference).joints:
        book.put("joint", joint, {"start": position, f"{FORM}:start velocity": 0.0})
    classes = _drives(reference, generation, book)
    randomize = randomize_of(reference)
    for event in _events(reference, randomize) if randomize else ():
        event.put(FORM, book)
    text = _text(python_name(robot), classes, generation, draws=randomize is not None)
    config = f"{python_name(robot).upper()}_CFG"
    put_words(Module.parsed(text, "expected"), FORM, book, (*READ, config), part=str(generation))
    return book


def python_name(robot: str) -> str:
    """The robot's name as an identifier."""
    name = re.sub(r"\W", "_", robot)
    return f"_{name}" if name[:1].isdigit() else name


def _robot(
    reference: Reference,
    robot: str,
    asked: dict[str, Any],  # Any: JSON
    book: Writer,
) -> None:
    tree, simulation = reference.tree, reference.control.simulation
    base = start_of(reference).base or tree.X_world_root
    x, y, z, *turn = pose_value(base)
    if tree.base == "floating":
        z += asked.get("clearance", CLEARANCE_M)
    steps: dict[str, Value] = {
        "timestep": simulation.timestep,
        "decimation": simulation.decimation,
        "gravity": tuple(simulation.gravity),
    }
    book.put("simulation", "", steps)
    soft = asked.get("soft_joint_pos_limit_factor", 1.0)
    book.put("robot", "", {"start pose": (x, y, z, *turn), "soft limits": soft})
    words: dict[str, Value] = {
        "USD": f"usd/{robot}.usda",
        "SIMULATION_CFG": "sim_utils.SimulationCfg",
        "SIMULATION_CFG.dt": simulation.timestep,
        "SIMULATION_CFG.render_interval": simulation.decimation,
        "SIMULATION_CFG.gravity": tuple(simulation.gravity),
        "config": "ArticulationCfg",
        "init_state": "ArticulationCfg.InitialStateCfg",
        "length of rot": 1.0,
    }
    book.put("robot", "", {f"{FORM}:{name}": value for name, value in words.items()})


def _spawn(
    reference: Reference,
    robot: str,
    asked: dict[str, Any],  # Any: JSON
    generation: Generation,
    book: Writer,
) -> None:
    """What Isaac Lab writes over the USD: the same as stands there."""
    usd = UsdOptions.model_validate(reference.options.get("usd") or {})
    solver = usd.articulation.solving(reference.control.loops).model_dump()
    names = SPAWN[generation]
    words: dict[str, Value] = {
        "spawn": "sim_utils.UsdFileCfg",
        "spawn.usd_path": f"usd/{robot}.usda",
        "spawn.variants.Physics": "physics",
        "spawn.activate_contact_sensors": asked.get("contact_sensors", True),
        "spawn.rigid_props": names["rigid"],
    }
    body = usd.rigid_body.model_dump()
    body["max_angular_velocity"] = math.degrees(body["max_angular_velocity"])
    words |= {f"spawn.rigid_props.{name}": body[name] for name in BODY_PROPERTIES}
    at = "spawn.articulation_props" + ("" if generation == 2 else "[0]")
    words[at] = names["articulation"]
    words |= {
        f"{at}.{name}": solver[key] for name, key in PROPERTIES.items() if name != SELF_COLLISIONS
    }
    if generation == 3:
        words["spawn.articulation_props[1]"] = "NewtonArticulationCfg"
        touching = "spawn.articulation_props[1].self_collision_enabled"
        words[touching] = usd.articulation.self_collisions
    book.put("robot", "", {"self-collision": usd.articulation.self_collisions})
    book.put("robot", "", {f"{FORM}:{path}": value for path, value in words.items()})


# --- drives -----------------------------------------------------------------------------------


def _class_of(drive: Actuator, *, delayed: bool) -> str:
    """A `motor` is a PD without gains; Isaac Lab has no other form of `general`."""
    match drive.model:
        case "pd" | "velocity" | "passive":
            return IMPLICIT
        case "dc_motor":
            return "DCMotorCfg"
    return "DelayedPDActuatorCfg" if delayed else "IdealPDActuatorCfg"


def _drives(reference: Reference, generation: Generation, book: Writer) -> set[str]:
    """Numbers of every moving joint; returns the classes that they need."""
    randomize, timestep = randomize_of(reference), reference.control.simulation.timestep
    groups: dict[tuple[object, ...], list[str]] = {}
    classes, springs = set(), as_drives(reference.control)
    for drive in reference.control.actuators:
        if drive.joint in springs:  # an implicit drive that aims at the spring's rest
            drive = replace(drive, kp=springs[drive.joint].stiffness)
        steps = ranges_of(randomize, drive.joint).delay if drive.model == "ideal_pd" else (0, 0)
        numbers = _numbers(drive)
        kind = _class_of(drive, delayed=steps != (0, 0))
        members = groups.setdefault((*numbers, steps), [])
        place = list(groups).index((*numbers, steps))
        members.append(drive.joint)
        kp = drive.kp if drive.model in (*LOOPS, "passive") else 0.0
        kd = drive.kd if drive.model in (*LOOPS, "velocity") else 0.0
        facts: dict[str, Value] = {
            "model": model_of(kind, kp, kd), "kp": kp, "kd": kd, "effort": drive.effort,
            "velocity": drive.velocity, "armature": drive.armature, "friction": drive.friction,
            "damping": drive.damping, "delay": delay_s(steps, timestep),
            f"{FORM}:actuator": kind, f"{FORM}:dynamic_friction": drive.friction,
            f"{FORM}:group": f"{drive.motor or drive.model}_{place}",
            f"{FORM}:place in its group": len(members) - 1,
        }  # fmt: skip
        if drive.model == "dc_motor":
            facts["stall"] = stall_of(drive)
        for again in LIMITS[generation, kind == IMPLICIT][1][1:]:
            facts[f"{FORM}:{again}"] = drive.velocity
        book.put("joint", drive.joint, facts)
        classes.add(kind)
    return classes


def _numbers(drive: Actuator) -> tuple[object, ...]:
    """What joints have in common that share a group."""
    own = {"joint", "source", "name", "ctrl", "general"}
    return tuple(value for name, value in asdict(drive).items() if name not in own)


# --- events -----------------------------------------------------------------------------------


def _events(reference: Reference, randomize: Randomize) -> Iterator[Event]:
    bodies = body_identifiers(reference.tree)
    for index, (_, matter, names) in enumerate(claimed(randomize.links, massive_bodies(reference))):
        if matter.density != (1.0, 1.0):
            density: dict[str, Value] = {
                "mass_distribution_params": matter.density, "operation": "scale",
                "recompute_inertia": True,
            }  # fmt: skip
            yield Event(f"density_{index}", "mdp.randomize_rigid_body_mass", "body", names, density)
        most = per_axis(matter.com)
        shift: dict[str, Value] = {
            f"com_range.{axis}": (-m, m) for axis, m in zip("xyz", most, strict=True)
        }
        for name in names if any(most) else ():
            func = "mdp.randomize_rigid_body_com"
            yield Event(f"com_{bodies[name]}", func, "body", (name,), shift)
    yield from _joint_events(reference, randomize)
    yield from _material(reference, randomize)


def _joint_events(reference: Reference, randomize: Randomize) -> Iterator[Event]:
    moving = [joint.name for joint in reference.tree.moving_joints]
    for index, (_, ranges, joints) in enumerate(claimed(randomize.joints, moving)):
        scale: dict[str, Value] = {"operation": "scale"}
        if (ranges.kp, ranges.kd) != ((1.0, 1.0), (1.0, 1.0)):
            gains: dict[str, Value] = {
                "stiffness_distribution_params": ranges.kp,
                "damping_distribution_params": ranges.kd,
            }
            func = "mdp.randomize_actuator_gains"
            yield Event(f"gains_{index}", func, "joint", joints, gains | scale)
        drawn: dict[str, Value] = {
            f"{name}_distribution_params": getattr(ranges, name)
            for name in ("friction", "armature")
            if getattr(ranges, name) != (1.0, 1.0)
        }
        if drawn:
            func = "mdp.randomize_joint_parameters"
            yield Event(f"joints_{index}", func, "joint", joints, drawn | scale)


def _material(reference: Reference, randomize: Randomize) -> Iterator[Event]:
    """What the recipe does not vary stays as the USD's materials have it."""
    if randomize.friction is None and randomize.restitution is None:
        return
    asked = reference.options.get("isaaclab") or {}
    slide = reference.control.contact.friction[0]
    friction = randomize.friction or (slide, slide)
    drawn: dict[str, Value] = {
        "static_friction_range": friction, "dynamic_friction_range": friction,
        "restitution_range": randomize.restitution or (0.0, 0.0),
        "num_buckets": asked.get("friction_buckets", MATERIALS),
        "make_consistent": True,
    }  # fmt: skip
    yield Event("material", "mdp.randomize_rigid_body_material", params=drawn)


# --- statements -------------------------------------------------------------------------------


def _text(module: str, classes: set[str], generation: Generation, *, draws: bool) -> str:
    """Imports and statements; a 0 where values are facts."""
    lines = [
        "from pathlib import Path",
        "import isaaclab.sim as sim_utils",
        "from isaaclab.assets import ArticulationCfg",
        *(f"from isaaclab.actuators import {name}" for name in sorted(classes or {IMPLICIT})),
    ]
    if draws:
        lines += [
            "from isaaclab.envs import mdp",
            "from isaaclab.managers import EventTermCfg, SceneEntityCfg",
            "from isaaclab.utils import configclass",
        ]
    if generation == 3:
        lines += [
            "from isaaclab_newton.physics import MJWarpSolverCfg, NewtonCfg",
            "from isaaclab_newton.sim.schemas import NewtonArticulationCfg",
            "from isaaclab_physx.sim.schemas import PhysxArticulationCfg, PhysxRigidBodyCfg",
        ]
    names = ["USD", "DT", "DECIMATION", "GRAVITY", "SIMULATION_CFG"]
    names += ["NEWTON_CFG"] if generation == 3 else []
    lines += [f"{name} = 0" for name in (*names, f"{module.upper()}_CFG")]
    lines += ["@configclass", "class EventCfg:", "    term = 0"] if draws else []
    return "\n".join(lines)


def expected_script(reference: Reference, robot: str) -> Module:
    """The script that measures in Isaac Lab, statement by statement."""
    text = script(robot, python_name(robot), reference.tree)
    return Module.parsed(text, "expected")
