"""Isaac Lab: a module for each of its generations that spawns the robot's USD.

The two generations name the same things differently and order quaternions differently; see
docs/reference/isaaclab.md. The physics stands in the USD; what is repeated here is what Isaac Lab
would otherwise decide itself.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import RecipeView, Target
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Actuator, Control, Keyframe, Tree
from assetbuild.robot.ranges import Randomize, first_match
from assetbuild.simulators.usd_names import joint_identifiers
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.targets.isaaclab import events
from assetbuild.targets.isaaclab.measure import script
from assetbuild.targets.isaaclab.options import IsaacLabOptions

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
    "set it in a copy of the module",
)


class IsaacLab(Target):
    """`python/<robot>_isaaclab_2.py` and `_3.py`, which look for the USD beside them.

    `_measure.py` is for Isaac Lab's half of the comparison.
    """

    version = "6"
    outputs = ("isaaclab/",)
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")
    folder = "python"

    sections: ClassVar[Mapping[str, str]] = {"isaaclab": "options"}
    told: ClassVar[Mapping[str, str]] = {"usd": "usd", "randomize": "randomize"}

    options: IsaacLabOptions = IsaacLabOptions()
    """The recipe's `isaaclab`."""
    usd: UsdOptions = UsdOptions()
    """The recipe's `usd`: the modules repeat it, so that no default of Isaac Lab's slips in."""
    randomize: Randomize | None = None
    """The recipe's ranges, for the modules' event terms."""
    has_usd: bool = True
    """Whether the bundle holds the USD that the modules spawn."""

    @classmethod
    def values(cls, recipe: RecipeView) -> dict[str, Any] | None:  # Any: values of its fields
        """Knows whether the USD is built too."""
        found = super().values(recipe)
        return None if found is None else found | {"has_usd": "usd" in recipe.value("targets")}

    def run(self, files: Files) -> Iterator[Finding]:
        """One module for each generation."""
        robot = RobotFiles(files.inputs)
        tree, control = robot.tree, robot.control
        folder = files.outputs / "isaaclab"
        folder.mkdir()
        generations: tuple[Generation, ...] = (2, 3)
        for generation in generations:
            module = Module(
                self.robot, generation, tree, control, self.options, self.usd, self.randomize
            )
            path = folder / f"{module_name(self.robot)}_isaaclab_{generation}.py"
            path.write_text(module.text(), encoding="utf-8")
        name = module_name(self.robot)
        path = folder / f"{name}_isaaclab_measure.py"
        path.write_text(script(self.robot, name, tree), encoding="utf-8")
        yield from self._findings(control)
        if self.randomize is not None:
            yield from events.lost(self.randomize, control, tree)

    def _findings(self, control: Control) -> Iterator[Finding]:
        if not self.has_usd:
            yield NO_USD(
                "recipe targets",
                "the modules spawn `usd/`, which the bundle does not hold",
                hint="add `usd` to the targets",
            )
        lost = [a.joint for a in control.actuators if a.model == "general"]
        if lost:
            yield GENERAL(
                f"actuator {lost[0]}",
                f"Isaac Lab has no form of the model `general`: {len(lost)} joints get no torque",
                hint="give these joints another model, or an actuator class of your own",
                data={"joints": tuple(lost)},
            )
        stall = [a.joint for a in control.actuators if a.model == "dc_motor"]
        if stall:
            yield SATURATION(
                f"actuator {stall[0]}",
                f"the table has no stall torque: `saturation_effort` of {len(stall)} joints is "
                "their effort limit",
                hint="a motor's stall torque is often higher: set it in the module's copy",
                data={"joints": tuple(stall)},
            )


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
        name = module_name(self.robot)
        simulation = self.control.simulation
        return "\n".join(
            (
                f'"""{self.robot} for Isaac Lab {self.generation}.x, by assetbuild.',
                "",
                "Edit the recipe instead: the next build writes this file anew. Copy what you",
                "change: `CFG.replace(...)` and `copy.deepcopy` keep the rest up to date.",
                '"""',
                "",
                "from pathlib import Path",
                "",
                *self._imports(),
                "",
                # Not resolved: `smoke` shows it links into the store, where no USD is beside it.
                f'USD = str(Path(__file__).absolute().parents[1] / "usd" / "{self.robot}.usda")',
                f"DT = {simulation.timestep!r}  # s",
                f"DECIMATION = {simulation.decimation}  # simulation steps per control step",
                f"GRAVITY = {simulation.gravity!r}  # m/s2",
                "",
                "SIMULATION_CFG = sim_utils.SimulationCfg("
                "dt=DT, render_interval=DECIMATION, gravity=GRAVITY)",
                '"""What the robot was checked with; use its values in your environment."""',
                "",
                f"{name.upper()}_CFG = ArticulationCfg(",
                *_indented(self._spawn()),
                *_indented(self._initial_state()),
                f"    soft_joint_pos_limit_factor={self.options.soft_joint_pos_limit_factor!r},",
                "    actuators={",
                *_indented(self._actuators(), 2),
                "    },",
                ")",
                "",
                *self._events(),
            )
        )

    def _imports(self) -> list[str]:
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
                "from isaaclab_newton.sim.schemas import NewtonArticulationCfg",
                "from isaaclab_physx.sim.schemas import PhysxArticulationCfg, PhysxRigidBodyCfg",
            ]
        return lines

    def _spawn(self) -> list[str]:
        old = self.generation == 2
        body = "sim_utils.RigidBodyPropertiesCfg" if old else "PhysxRigidBodyCfg"
        root = "sim_utils.ArticulationRootPropertiesCfg" if old else "PhysxArticulationCfg"
        rigid, solver = self.usd.rigid_body, self.usd.articulation
        body_values = {
            "linear_damping": rigid.linear_damping,
            "angular_damping": rigid.angular_damping,
            "max_linear_velocity": rigid.max_linear_velocity,
            # In degrees per second here, as in the USD.
            "max_angular_velocity": to_degrees(rigid.max_angular_velocity),
            "max_depenetration_velocity": rigid.max_depenetration_velocity,
        }
        root_values = {
            "enabled_self_collisions": solver.self_collisions,
            "solver_position_iteration_count": solver.solver_position_iterations,
            "solver_velocity_iteration_count": solver.solver_velocity_iterations,
            "sleep_threshold": solver.sleep_threshold,
            "stabilization_threshold": solver.stabilization_threshold,
        }
        articulation = _call(root, root_values)
        if not old:
            newton = f"NewtonArticulationCfg(self_collision_enabled={solver.self_collisions!r})"
            articulation = ["[", *_indented([*articulation[:-1], "),", f"{newton},"]), "]"]
        return [
            "spawn=sim_utils.UsdFileCfg(",
            "    usd_path=USD,",
            '    variants={"Physics": "physics"},',
            f"    activate_contact_sensors={self.options.contact_sensors!r},",
            *_indented(_argument("rigid_props", _call(body, body_values))),
            *_indented(_argument("articulation_props", articulation)),
            "),",
        ]

    def _initial_state(self) -> list[str]:
        home = next((key for key in self.control.keyframes if key.name == "home"), None)
        home = home or next(iter(self.control.keyframes), Keyframe("", ()))
        # A fixed root too: at a reset Isaac Lab puts it here, wherever the asset had it.
        base = self.tree.root_pose(home)
        x, y, z = base.xyz
        if self.tree.base == "floating":
            z += self.options.clearance
        w, *xyz = base.quat
        turn = (w, *xyz) if self.generation == 2 else (*xyz, w)
        order = "w, x, y, z" if self.generation == 2 else "x, y, z, w"
        names = joint_identifiers(self.tree)
        return [
            "init_state=ArticulationCfg.InitialStateCfg(",
            f"    pos={(x, y, z)!r},",
            f"    rot={turn!r},  # {order}",
            "    joint_pos={",
            *(f"        {pattern(names[joint])}: {value!r}," for joint, value in home.joints),
            "    },",
            '    joint_vel={".*": 0.0},',
            "),",
        ]

    def _events(self) -> list[str]:
        if self.randomize is None:
            return []
        return ["", *events.events_text(self.randomize, self.tree, self.control), ""]

    def _delay(self, actuator: Actuator) -> tuple[int, int]:
        """Simulation steps, least and most, of the drives that Isaac Lab can delay."""
        table = self.randomize.joints if self.randomize else {}
        ranges = first_match(table, actuator.joint)
        return ranges.delay if ranges and actuator.model == "ideal_pd" else (0, 0)

    def _class_of(self, actuator: Actuator) -> str:
        delayed = self._delay(actuator) != (0, 0)
        return "DelayedPDActuatorCfg" if delayed else CLASSES[actuator.model]

    def _actuators(self) -> list[str]:
        """Joints with equal numbers share a group; every joint stands in exactly one."""
        names = joint_identifiers(self.tree)
        groups: dict[tuple[object, ...], list[Actuator]] = {}
        for actuator in self.control.actuators:
            key = (*_numbers(actuator), self._delay(actuator))
            groups.setdefault(key, []).append(actuator)
        lines = []
        for index, members in enumerate(groups.values()):
            first = members[0]
            title = first.motor or first.model
            call = _call(self._class_of(first), self._values(first))
            joints = [f"        {pattern(names[a.joint])}," for a in members]
            listed = ["    joint_names_expr=[", *joints, "    ],"]
            call = [call[0], *listed, *call[1:]]
            lines += _argument(f'"{title}_{index}"', call, ": ")
        return lines

    def _values(self, actuator: Actuator) -> dict[str, object]:
        inside = CLASSES[actuator.model] == "ImplicitActuatorCfg"
        efforts, velocities = LIMITS[self.generation, inside]
        has_kp = actuator.model in ("pd", "ideal_pd", "dc_motor")
        has_kd = has_kp or actuator.model == "velocity"
        values: dict[str, object] = {
            "stiffness": actuator.kp if has_kp else 0.0,
            "damping": actuator.kd if has_kd else 0.0,
        }
        if actuator.model == "dc_motor":
            values["saturation_effort"] = actuator.effort
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


def to_degrees(value: float) -> float:
    """rad/s to deg/s."""
    return value * 57.29577951308232


def pattern(name: str) -> str:
    """A Python literal of the regular expression that matches exactly this name."""
    return json.dumps(re.escape(name))


def _numbers(actuator: Actuator) -> tuple[object, ...]:
    return (
        actuator.motor,
        actuator.model,
        actuator.kp,
        actuator.kd,
        actuator.damping,
        actuator.friction,
        actuator.armature,
        actuator.effort,
        actuator.velocity,
    )


def _call(name: str, values: Mapping[str, object]) -> list[str]:
    """`name(` ... `)`, a line for each argument."""
    body = [f"    {key}={value!r}," for key, value in values.items()]
    return [f"{name}(", *body, ")"]


def _argument(name: str, lines: Sequence[str], sign: str = "=") -> list[str]:
    return [f"{name}{sign}{lines[0]}", *lines[1:-1], f"{lines[-1]},"]


def _indented(lines: Sequence[str], levels: int = 1) -> list[str]:
    return ["    " * levels + line for line in lines]
