"""The text of the module for one generation of Isaac Lab."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from pydantic import Field

from assetbuild.recipe_types import Model, NonNegative
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.mjcf_only import as_drives
from assetbuild.robot.model import Actuator, Control, Keyframe, Tree
from assetbuild.robot.ranges import Randomize, first_match
from assetbuild.simulators.usd_names import joint_identifiers
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.targets.isaaclab import events


class IsaacLabOptions(Model):
    """What only Isaac Lab's configuration has."""

    soft_joint_pos_limit_factor: float = Field(
        1.0, gt=0.0, le=1.0, description="share of a joint's range beyond which rewards punish"
    )
    contact_sensors: bool = Field(True, description="`activate_contact_sensors` of the spawner")
    clearance: NonNegative = Field(
        0.001, description="m; how much higher than in its initial keyframe the robot is spawned"
    )
    friction_buckets: int = Field(
        64,
        ge=1,
        le=64000,
        description="contact materials that `randomize` draws; PhysX has room for 64000",
    )


Generation = Literal[2, 3]

CLASSES: Mapping[str, str] = {
    "pd": "ImplicitActuatorCfg",
    "velocity": "ImplicitActuatorCfg",
    "passive": "ImplicitActuatorCfg",
    "ideal_pd": "IdealPDActuatorCfg",
    "dc_motor": "DCMotorCfg",
    "motor": "IdealPDActuatorCfg",
    "general": "IdealPDActuatorCfg",
}
"""Isaac Lab's actuator for a model of the table; a `motor` is an ideal PD without gains."""
LIMITS: Mapping[tuple[Generation, bool], tuple[tuple[str, ...], tuple[str, ...]]] = {
    (2, True): (("effort_limit_sim",), ("velocity_limit_sim",)),
    (2, False): (("effort_limit",), ("velocity_limit", "velocity_limit_sim")),
    (3, True): (("joint_effort_limit",), ("joint_velocity_limit",)),
    (3, False): (("actuator_effort_limit",), ("actuator_velocity_limit", "joint_velocity_limit")),
}
"""Fields for (effort, velocity) by generation and whether the simulator integrates the drive."""


def module_name(robot: str) -> str:
    """The robot's name as a Python module may be called."""
    name = re.sub(r"\W", "_", robot)
    return f"_{name}" if name[:1].isdigit() else name


@dataclass(frozen=True)
class Module:
    """The text of one module."""

    robot: str
    generation: Generation
    tree: Tree
    control: Control
    options: IsaacLabOptions
    usd: UsdOptions
    randomize: Randomize | None = None

    def text(self) -> str:
        """Docstring, imports, constants, the configuration."""
        simulation = self.control.simulation
        start = initial_pose(self.tree, self.control)
        actuators = "".join(f"\n        {group}," for group in self._actuators())
        randomized = ""
        if self.randomize is not None:
            buckets = self.options.friction_buckets
            drawn = events.events_text(self.randomize, self.tree, self.control, buckets)
            randomized = f"\n\n{drawn}\n"
        # USD is not resolved: `smoke` shows the module links into the store, where none is beside.
        return f'''"""{self.robot} for Isaac Lab {self.generation}.x, by assetbuild.

Edit the recipe instead: the next build writes this file anew. Copy what you
change: `CFG.replace(...)` and `copy.deepcopy` keep the rest up to date.
"""

from pathlib import Path

{self._imports()}

USD = str(Path(__file__).absolute().parents[1] / "usd" / "{self.robot}.usda")
DT = {simulation.timestep!r}  # s
DECIMATION = {simulation.decimation}  # simulation steps per control step
GRAVITY = {simulation.gravity!r}  # m/s2

SIMULATION_CFG = sim_utils.SimulationCfg(dt=DT, render_interval=DECIMATION, gravity=GRAVITY)
"""What the robot was checked with; use its values in your environment."""
{self._newton()}
{module_name(self.robot).upper()}_CFG = ArticulationCfg(
    spawn=sim_utils.UsdFileCfg(
        usd_path=USD,
        variants={{"Physics": "physics"}},
        activate_contact_sensors={self.options.contact_sensors!r},
        rigid_props={self._rigid_body()},
        articulation_props={self._articulation()},
    ),
    init_state=ArticulationCfg.InitialStateCfg({self._base(start)}
        joint_pos={{{self._positions(start)}
        }},
        joint_vel={{".*": 0.0}},
    ),
    soft_joint_pos_limit_factor={self.options.soft_joint_pos_limit_factor!r},
    actuators={{{actuators}
    }},
)
{randomized}'''

    def _imports(self) -> str:
        used = {self._class_of(a) for a in self.control.actuators} or {"ImplicitActuatorCfg"}
        lines = [
            "import isaaclab.sim as sim_utils",
            f"from isaaclab.actuators import {', '.join(sorted(used))}",
            "from isaaclab.assets import ArticulationCfg",
        ]
        if self.randomize is not None:
            lines += events.IMPORTS
        if self.generation == 3:
            lines += [
                "from isaaclab_newton.physics import MJWarpSolverCfg, NewtonCfg",
                "from isaaclab_newton.sim.schemas import NewtonArticulationCfg",
                "from isaaclab_physx.sim.schemas import PhysxArticulationCfg, PhysxRigidBodyCfg",
            ]
        return "\n".join(lines)

    def _newton(self) -> str:
        """Isaac Lab's default, `euler`, damps drives explicitly: a built G1 falls over."""
        if self.generation == 2:
            return ""
        return (
            '\nNEWTON_CFG = NewtonCfg(solver_cfg=MJWarpSolverCfg(integrator="implicitfast"))\n'
            '"""For `SIMULATION_CFG.replace(physics=NEWTON_CFG)`: stiff drives want an integrator '
            'that damps\nthem implicitly, as MuJoCo\'s in the MJCF does."""\n'
        )

    def _rigid_body(self) -> str:
        old = self.generation == 2
        rigid = self.usd.rigid_body
        # In degrees per second here, as in the USD.
        turning = {"max_angular_velocity": math.degrees(rigid.max_angular_velocity)}
        name = "sim_utils.RigidBodyPropertiesCfg" if old else "PhysxRigidBodyCfg"
        return _call(name, _fields(rigid.model_dump() | turning), 2)

    def _articulation(self) -> str:
        solver = self.usd.articulation.solving(self.control.loops)
        values = {
            "enabled_self_collisions": solver.self_collisions,
            "solver_position_iteration_count": solver.solver_position_iterations,
            "solver_velocity_iteration_count": solver.solver_velocity_iterations,
            "sleep_threshold": solver.sleep_threshold,
            "stabilization_threshold": solver.stabilization_threshold,
        }
        if self.generation == 2:
            return _call("sim_utils.ArticulationRootPropertiesCfg", _fields(values), 2)
        physx = _call("PhysxArticulationCfg", _fields(values), 3)
        newton = f"NewtonArticulationCfg(self_collision_enabled={solver.self_collisions!r})"
        return _call("", (physx, newton), 2, "[]")

    def _base(self, start: Keyframe) -> str:
        # A fixed root too: at a reset Isaac Lab puts it here, wherever the asset had it.
        base = self.tree.root_pose(start)
        x, y, z = base.xyz
        if self.tree.base == "floating":
            z += self.options.clearance
        w, *xyz = base.quat
        old = self.generation == 2
        turn, order = ((w, *xyz), "w, x, y, z") if old else ((*xyz, w), "x, y, z, w")
        return f"""
        pos={(x, y, z)!r},
        rot={turn!r},  # {order}"""

    def _positions(self, start: Keyframe) -> str:
        names = joint_identifiers(self.tree)
        return "".join(f"\n            {pattern(names[j])}: {q!r}," for j, q in start.joints)

    def _delay(self, actuator: Actuator) -> tuple[int, int]:
        """Simulation steps, least and most, of the drives that Isaac Lab can delay."""
        table = self.randomize.joints if self.randomize else {}
        ranges = first_match(table, actuator.joint)
        return ranges.delay if ranges and actuator.model == "ideal_pd" else (0, 0)

    def _class_of(self, actuator: Actuator) -> str:
        delayed = self._delay(actuator) != (0, 0)
        return "DelayedPDActuatorCfg" if delayed else CLASSES[actuator.model]

    def _actuators(self) -> Iterator[str]:
        """Joints with equal numbers share a group; every joint stands in exactly one."""
        names = joint_identifiers(self.tree)
        groups: dict[tuple[object, ...], list[Actuator]] = {}
        springs = as_drives(self.control)
        for actuator in self.control.actuators:
            if actuator.joint in springs:
                actuator = replace(actuator, kp=springs[actuator.joint].stiffness)
            numbers = replace(actuator, joint="", source="", name="", ctrl=None, general=None)
            groups.setdefault((numbers, self._delay(actuator)), []).append(actuator)
        for index, members in enumerate(groups.values()):
            first = members[0]
            listed = _call("joint_names_expr=", (pattern(names[a.joint]) for a in members), 3, "[]")
            call = _call(self._class_of(first), (listed, *_fields(self._values(first))), 2)
            yield f'"{first.motor or first.model}_{index}": {call}'

    def _values(self, actuator: Actuator) -> dict[str, object]:
        inside = CLASSES[actuator.model] == "ImplicitActuatorCfg"
        efforts, velocities = LIMITS[self.generation, inside]
        has_kp = actuator.model in ("pd", "ideal_pd", "dc_motor", "passive")  # passive: a spring
        has_kd = actuator.model in ("pd", "ideal_pd", "dc_motor", "velocity")
        values: dict[str, object] = {
            "stiffness": actuator.kp if has_kp else 0.0,
            "damping": actuator.kd if has_kd else 0.0,
        }
        if actuator.model == "dc_motor":
            values["saturation_effort"] = actuator.saturation
        if self._delay(actuator) != (0, 0):
            values |= dict(zip(("min_delay", "max_delay"), self._delay(actuator), strict=True))
        if actuator.effort is not None:
            values |= dict.fromkeys(efforts, actuator.effort)
        if actuator.velocity is not None:
            values |= dict.fromkeys(velocities, actuator.velocity)
        return values | {
            "armature": actuator.armature,
            "friction": actuator.friction,
            "dynamic_friction": actuator.friction,
            "viscous_friction": actuator.damping,
        }


def pattern(name: str) -> str:
    """A Python literal of the regular expression that matches exactly this name."""
    return json.dumps(re.escape(name))


def _fields(values: Mapping[str, object]) -> list[str]:
    return [f"{key}={value!r}" for key, value in values.items()]


def _call(name: str, arguments: Iterable[str], depth: int, brackets: str = "()") -> str:
    """`name(` ... `)` on a line that is `depth` times indented, a line for each argument."""
    pad = "    " * depth
    inner = "".join(f"\n{pad}    {argument}," for argument in arguments)
    return f"{name}{brackets[0]}{inner}\n{pad}{brackets[1]}"
