"""Isaac Lab: a module for each of its generations that spawns the robot's USD.

The two generations name the same things differently and order quaternions differently; see
docs/reference/isaaclab.md. The physics stands in the USD; what is repeated here is what Isaac Lab
would otherwise decide itself.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import Target
from assetbuild.recipe_types import Model, NonNegative
from assetbuild.robot.actuator_table import without_stall
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.mjcf_only import as_drives
from assetbuild.robot.model import Actuator, Control, Keyframe, Tree
from assetbuild.robot.ranges import Randomize, first_match
from assetbuild.simulators.usd_names import joint_identifiers
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.targets.isaaclab import events
from assetbuild.targets.isaaclab.events import call
from assetbuild.targets.isaaclab.script import script

NO_USD = Rule(
    "isaaclab.no_usd",
    "error",
    "the modules spawn a USD that the bundle does not hold",
    "add `usd` to the targets",
)
GENERAL = Rule(
    "isaaclab.general",
    "warning",
    "Isaac Lab has no form of the model `general`",
    "another model, or an actuator class of your own",
)
SATURATION = Rule(
    "isaaclab.saturation",
    "info",
    "a `dc_motor` has no stall torque; its effort limit is used instead",
    "`stall` in the row or the motor",
)

SPRING = Rule(
    "isaaclab.spring",
    ("error", "info"),
    "a joint has a spring that rests elsewhere than at 0: the module has its stiffness, but Isaac "
    "Lab aims the drives of all joints at 0 until a target is set (info: a spring that rests at 0)",
    "set the joint's position target to the spring's rest at every reset and accept it by `rules: "
    "{isaaclab.spring: {severity: info, because: ...}}`",
)


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


class IsaacLab(Target):
    """`python/<robot>_isaaclab_2.py` and `_3.py`, which look for the USD beside them.

    `_measure.py` is for Isaac Lab's half of the comparison.
    """

    outputs = ("isaaclab/",)
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")
    folder = "python"

    sections: ClassVar[Mapping[str, str]] = {"isaaclab": "options"}
    recipe_fields: ClassVar[Mapping[str, str]] = {"usd": "usd", "randomize": "randomize"}
    derived: ClassVar = {"has_usd": lambda recipe: "usd" in recipe.value("targets")}

    options: IsaacLabOptions = IsaacLabOptions()
    """The recipe's `isaaclab`."""
    usd: UsdOptions = UsdOptions()
    """The recipe's `usd`: the modules repeat it, so that no default of Isaac Lab's slips in."""
    randomize: Randomize | None = None
    """The recipe's ranges, for the modules' event terms."""
    has_usd: bool = True
    """Whether the bundle holds the USD that the modules spawn."""

    def run(self, files: Files) -> Iterator[Finding]:
        """One module for each generation."""
        robot = RobotFiles(files.inputs)
        tree, control = robot.tree, robot.control
        folder = files.outputs / "isaaclab"
        folder.mkdir()
        name = module_name(self.robot)
        texts = {"measure": script(self.robot, name, tree)}
        generations: tuple[Generation, ...] = (2, 3)
        for generation in generations:
            texts[str(generation)] = Module(self, generation, tree, control).text()
        for kind, text in texts.items():
            (folder / f"{name}_isaaclab_{kind}.py").write_text(text, encoding="utf-8")
        yield from self._findings(control)
        if self.randomize is not None:
            yield from events.lost(self.randomize, control, tree)

    def _findings(self, control: Control) -> Iterator[Finding]:
        if not self.has_usd:
            yield NO_USD(
                "recipe targets",
                "the modules spawn `usd/`, which the bundle does not hold",
            )
        lost = [a.joint for a in control.actuators if a.model == "general"]
        if lost:
            yield GENERAL(
                f"actuator {lost[0]}",
                f"Isaac Lab has no form of the model `general`: {len(lost)} joints get no torque",
                hint="give these joints another model, or an actuator class of your own",
                data={"joints": tuple(lost)},
            )
        for joint, spring in as_drives(control).items():
            lost_rest = spring.rest != 0.0
            yield SPRING(
                f"joint {joint}",
                f"its spring ({spring.stiffness:g}) is the stiffness of an implicit actuator"
                + (f", but Isaac Lab aims it at 0, not at {spring.rest:g}" * lost_rest),
                hint="leave the joint out of actions, and set its position target to the spring's "
                "rest at every reset",
                severity="error" if lost_rest else "info",
                data={"stiffness": spring.stiffness, "rest": spring.rest},
            )
        yield from without_stall(SATURATION, control.actuators)


# --- the text of a module ------------------------------------------------------------------------


@dataclass(frozen=True)
class Module:
    """The text of one module."""

    target: IsaacLab
    generation: Generation
    tree: Tree
    control: Control

    def text(self) -> str:
        """Docstring, imports, constants, the configuration."""
        simulation = self.control.simulation
        start = initial_pose(self.tree, self.control)
        actuators = "".join(f"\n        {group}," for group in self._actuators())
        randomized = ""
        if self.target.randomize is not None:
            buckets = self.target.options.friction_buckets
            drawn = events.events_text(self.target.randomize, self.tree, self.control, buckets)
            randomized = f"\n\n{drawn}\n"
        # USD is not resolved: `smoke` shows the module links into the store, where none is beside.
        return f'''"""{self.target.robot} for Isaac Lab {self.generation}.x, by assetbuild.

Edit the recipe instead: the next build writes this file anew. Copy what you
change: `CFG.replace(...)` and `copy.deepcopy` keep the rest up to date.
"""

from pathlib import Path

{self._imports()}

USD = str(Path(__file__).absolute().parents[1] / "usd" / "{self.target.robot}.usda")
DT = {simulation.timestep!r}  # s
DECIMATION = {simulation.decimation}  # simulation steps per control step
GRAVITY = {simulation.gravity!r}  # m/s2

SIMULATION_CFG = sim_utils.SimulationCfg(dt=DT, render_interval=DECIMATION, gravity=GRAVITY)
"""What the robot was checked with; use its values in your environment."""
{self._newton()}
{module_name(self.target.robot).upper()}_CFG = ArticulationCfg(
    spawn=sim_utils.UsdFileCfg(
        usd_path=USD,
        variants={{"Physics": "physics"}},
        activate_contact_sensors={self.target.options.contact_sensors!r},
        rigid_props={self._rigid_body()},
        articulation_props={self._articulation()},
    ),
    init_state=ArticulationCfg.InitialStateCfg({self._base(start)}
        joint_pos={{{self._positions(start)}
        }},
        joint_vel={{".*": 0.0}},
    ),
    soft_joint_pos_limit_factor={self.target.options.soft_joint_pos_limit_factor!r},
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
        if self.target.randomize is not None:
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
        rigid = self.target.usd.rigid_body
        # In degrees per second here, as in the USD.
        turning = {"max_angular_velocity": math.degrees(rigid.max_angular_velocity)}
        name = "sim_utils.RigidBodyPropertiesCfg" if old else "PhysxRigidBodyCfg"
        return call(name, _fields(rigid.model_dump() | turning), 2)

    def _articulation(self) -> str:
        solver = self.target.usd.articulation.solving(self.control.loops)
        values = {
            "enabled_self_collisions": solver.self_collisions,
            "solver_position_iteration_count": solver.solver_position_iterations,
            "solver_velocity_iteration_count": solver.solver_velocity_iterations,
            "sleep_threshold": solver.sleep_threshold,
            "stabilization_threshold": solver.stabilization_threshold,
        }
        if self.generation == 2:
            return call("sim_utils.ArticulationRootPropertiesCfg", _fields(values), 2)
        physx = call("PhysxArticulationCfg", _fields(values), 3)
        newton = f"NewtonArticulationCfg(self_collision_enabled={solver.self_collisions!r})"
        return call("", (physx, newton), 2, "[]")

    def _base(self, start: Keyframe) -> str:
        # A fixed root too: at a reset Isaac Lab puts it here, wherever the asset had it.
        base = self.tree.root_pose(start)
        x, y, z = base.xyz
        if self.tree.base == "floating":
            z += self.target.options.clearance
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
        table = self.target.randomize.joints if self.target.randomize else {}
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
            listed = call("joint_names_expr=", (pattern(names[a.joint]) for a in members), 3, "[]")
            config = call(self._class_of(first), (listed, *_fields(self._values(first))), 2)
            yield f'"{first.motor or first.model}_{index}": {config}'

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
