"""`python/<robot>_isaaclab_2.py` and `_3.py`: what they give to Isaac Lab, recorded by stand-ins.

Isaac Lab counts in SI and rad; delays are in simulation steps, `max_angular_velocity` is in deg/s.
Quaternions are wxyz in 2.x and xyzw in 3.x, and each generation has its own fields for limits; see
docs/reference/isaaclab.md. What the module for 3.x says again are words `isaaclab 3:...`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, Literal

from assetbuild.errors import UsageError
from assetbuild.facts import trainers
from assetbuild.facts._standins_child import LINE
from assetbuild.facts.derived import free_springs
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.standins import Record, class_of, recorded, table_of, words_of
from assetbuild.facts.table import Key, Table, Value
from assetbuild.facts.trainers import LOOPS, Names, Term
from assetbuild.facts.usd_expected import rigid_of, solver_of, touches_itself
from assetbuild.robot.model import Actuator
from assetbuild.simulators.usd_names import body_identifiers, joint_identifiers

Generation = Literal[2, 3]
FORM = "isaaclab"
CONFIG = "ArticulationCfg"
IMPLICIT = "ImplicitActuatorCfg"
LIMITS: dict[tuple[int, bool], tuple[str, tuple[str, ...]]] = {
    (2, True): ("effort_limit_sim", ("velocity_limit_sim",)),
    (2, False): ("effort_limit", ("velocity_limit", "velocity_limit_sim")),
    (3, True): ("joint_effort_limit", ("joint_velocity_limit",)),
    (3, False): ("actuator_effort_limit", ("actuator_velocity_limit", "joint_velocity_limit")),
}
"""(generation, whether the simulator integrates the drive) -> (effort, velocities): the first
velocity is the drive's own, the second the simulator's."""
FOREIGN: Mapping[str, str] = {
    "stiffness": "kp",
    "damping": "kd",
    "armature": "armature",
    **{limits[0]: "effort" for limits in LIMITS.values()},
    **{velocity: "velocity" for _, velocities in LIMITS.values() for velocity in velocities[::-1]},
}
"""Fields of anybody's drive -> quantities, both generations.

No friction: what its number means depends on the generation and the simulator.
"""
ONLY_3 = ("isaaclab_physx", "isaaclab_newton")
"""Packages that only 3.x has."""


def configs_of(record: Record, path: Path) -> Record:
    """The configurations of a module by name; UsageError where it has none."""
    configs = {name: value for name, value in record.items() if class_of(value) == CONFIG}
    if not configs:
        raise UsageError(f"`{path.name}` has no `NAME = {CONFIG}(...)`")
    return configs


def drives_of(config: Record) -> Iterator[tuple[Record, tuple[str, ...]]]:
    """Each group of drives, and the patterns of its joints."""
    for drive in map(table_of, table_of(config.get("actuators")).values()):
        yield drive, words_of(drive.get("joint_names_expr"))


def model_of(kind: str, kp: object, kd: object) -> str:
    """Return the model in the actuator table; a drive without gains is `motor` or `passive`."""
    if kind == "DCMotorCfg":
        return "dc_motor"
    if kind in ("IdealPDActuatorCfg", "DelayedPDActuatorCfg"):
        return "ideal_pd" if kp or kd else "motor"
    if kind == IMPLICIT:
        return "pd" if kp else "velocity" if kd else "passive"
    return kind


def quat_of(start: Record, generation: Generation) -> list[float]:
    """w, x, y, z of an `InitialStateCfg`; unturned where it states none."""
    turn: list[float] = start.get("rot", [])
    if not turn:
        return [1.0, 0.0, 0.0, 0.0]
    return turn if generation == 2 else [*turn[-1:], *turn[:-1]]


def read_config(path: Path, name: str, joints: Collection[str]) -> Table:
    """Facts of the configuration `name` in a Python file; "" = the only one.

    The file is executed with stand-ins for all that it imports. Only what it states as a number is
    a fact; what is left to the USD (`None`, or not written) is none. joints: names that its
    patterns are meant for, of the robot that it is compared with; empty = the patterns themselves
    are the subjects. UsageError for a file that fails, or without that configuration.
    """
    record, facts = recorded(path), Table()
    configs = configs_of(record, path)
    if name not in configs and (name or len(configs) > 1):
        raise UsageError(
            f"`{path}` has {', '.join(f'`{n}`' for n in configs)}",
            hint=f"say which: `{path}:{next(iter(configs))}`",
        )
    config = configs[name or next(iter(configs))]
    patterns = [pattern for _, drive_patterns in drives_of(config) for pattern in drive_patterns]
    start, names = table_of(config.get("init_state")), {name: name for name in joints or patterns}
    for drive, drive_patterns in drives_of(config):
        for joint in trainers.matching(drive_patterns, names) if joints else drive_patterns:
            facts.put("joint", joint, drive_facts(drive, joint, FOREIGN))
    trainers.put_start(start, quat_of(start, _generation(record, config)), FORM, names, facts)
    return facts


def _generation(record: Record, config: Record) -> Generation:
    """Tell 3.x by its packages for each engine, and limits of joints beside those of actuators."""
    fields = {field for drive, _ in drives_of(config) for field in drive}
    is_3 = any(module.startswith(ONLY_3) for module in record["imports"])
    return 3 if is_3 or {"joint_effort_limit", "joint_velocity_limit"} & fields else 2


def drive_facts(drive: Record, joint: str, fields: Mapping[str, str]) -> dict[str, Value]:
    """What it states as numbers, and its model. fields: of a drive -> quantities."""
    quantities: dict[str, Value] = {}
    for field, quantity in fields.items():
        number = trainers.number_of(drive.get(field), joint)
        if number is not None:
            quantities.setdefault(quantity, number)
    # A gain that does not stand here is some gain.
    model = model_of(class_of(drive), quantities.get("kp", 1.0), quantities.get("kd", 1.0))
    return quantities | {"model": model}


GENERATIONS: tuple[Generation, ...] = (2, 3)
FIELDS = {
    "stiffness": "kp",
    "damping": "kd",
    "armature": "armature",
    "friction": "friction",
    "viscous_friction": "damping",
    "saturation_effort": "stall",
    "dynamic_friction": f"{FORM}:dynamic_friction",
}
"""Fields of a drive -> quantities, in both generations."""
SPAWN = ("usd_path", "activate_contact_sensors", "variants")
TOUCHES = ("enabled_self_collisions", "self_collision_enabled")
"""Whether parts of the robot touch one another, in PhysX and in Newton."""
CLEARANCE_M = 0.001
"""Soles that start inside of the floor are thrown off it."""
MATERIALS = 64
"""Contact materials to draw from; PhysX has room for 64000 in all environments."""
SCALED = {"operation": "scale"}
PARAMS = "_distribution_params"
TERMS: Mapping[str, Term] = {
    "randomize_rigid_body_mass": Term(
        {f"mass{PARAMS}": "density"}, SCALED | {"recompute_inertia": True}
    ),
    "randomize_rigid_body_com": Term({f"com_range.{axis}": f"com {axis}" for axis in "xyz"}),
    "randomize_actuator_gains": Term(
        {f"stiffness{PARAMS}": "kp", f"damping{PARAMS}": "kd"}, SCALED
    ),
    "randomize_joint_parameters": Term(
        {f"{word}{PARAMS}": word for word in ("friction", "armature")}, SCALED
    ),
    "randomize_rigid_body_material": Term(
        {
            "static_friction_range": "surface friction",
            "dynamic_friction_range": "dynamic surface friction",
            "restitution_range": "restitution",
            "num_buckets": "materials",
        },
        {"make_consistent": True},
    ),
}
"""Isaac Lab's functions that draw."""
SCALES = ("kp", "kd", "friction", "armature")
"""What its terms scale of every joint."""
NOT_DRAWN = (
    *trainers.OF_MATTER[4:], "payload mass", "payload box", "effort", "damping", "encoder bias",
    "surface friction",
)  # fmt: skip
"""What they cannot draw; friction of surfaces they draw in two words."""


class IsaacLabReader(Reader):
    """Executes the modules for Isaac Lab with stand-ins and compares them with the robot."""

    format_id: ClassVar[str] = FORM
    display_name: ClassVar[str] = "Isaac Lab's modules"
    needs: ClassVar[tuple[str, ...]] = ("isaaclab",)
    folder: ClassVar[str] = "python"
    # The module for 3.x lies beside that for 2.x.
    file_globs: ClassVar[tuple[str, ...]] = ("python/*_isaaclab_2.py", "python/*_isaaclab_3.py")
    recipe_sections: ClassVar[tuple[str, ...]] = ("isaaclab", "usd", "randomize")
    lacks: ClassVar[Mapping[str, str]] = trainers.left_to_the_asset("robot self-collision")

    def read(self, path: Path) -> Table:
        """The facts of both modules, by the names that they write out."""
        return _both({n: _table(path, n, {}, {}) for n in GENERATIONS})

    def found(self, path: Path, reference: Reference) -> Table:
        """Patterns are those of the robot's bodies and joints as the USD names them."""
        tree = reference.tree
        there = joint_identifiers(tree)
        joints = {there[joint.name]: joint.name for joint in tree.moving_joints}
        bodies = {usd: body for body, usd in body_identifiers(tree).items()}
        return _both({n: _table(path, n, bodies, joints) for n in GENERATIONS})

    def expected(self, reference: Reference) -> Table:
        """The robot's drives as Isaac Lab has them, what it has besides, both times."""
        driven = {row.joint for row in reference.control.actuators}

        def is_stated(key: Key) -> bool:
            return self.holds(key) and (key.kind != "joint" or key.name in driven)

        draws = trainers.drawn(reference, lambda _, word: word in SCALES, NOT_DRAWN)
        facts = robot_table(reference).only(is_stated) | draws
        return _both({n: facts | _besides(reference, self.robot, n) for n in GENERATIONS})


def _both(tables: Mapping[Generation, Table]) -> Table:
    """Facts of both modules; the later generation's are words, because they stand there again."""
    later = {
        key._replace(quantity=f"{FORM} 3:{key.quantity.removeprefix(f'{FORM}:')}"): value
        for key, value in tables[3].facts.items()
    }
    return tables[2] | Table(later)


# --- what the modules say ---------------------------------------------------------------------


def _table(path: Path, generation: Generation, bodies: Names, joints: Names) -> Table:
    path = path.with_name(path.name.replace("_isaaclab_2", f"_isaaclab_{generation}"))
    record, facts = recorded(path), Table()
    config = next(iter(configs_of(record, path).values()))
    start = table_of(config.get("init_state"))
    joints = joints or trainers.own_names(start.get("joint_pos"))
    simulation = table_of(record["SIMULATION_CFG"])
    timestep = simulation["dt"]
    steps = {"timestep": timestep, "decimation": simulation["render_interval"]}
    facts.put("simulation", "", {**steps, "gravity": tuple(simulation["gravity"])})
    newton = table_of(table_of(record.get("NEWTON_CFG")).get("solver_cfg"))
    facts.put("robot", "", {f"{FORM}:integrator": newton.get("integrator")})
    trainers.put_start(start, quat_of(start, generation), FORM, joints, facts)
    facts.put("robot", "", {"soft limits": config.get("soft_joint_pos_limit_factor")})
    facts.put("robot", "", dict(_spawn(table_of(config.get("spawn")))))
    for group, patterns in drives_of(config):
        for joint in trainers.matching(patterns, joints):
            facts.put("joint", joint, _drive(group, joint, generation, timestep))
            facts.place("joint", joint, f"{path.name}:{group.get(LINE)}")
    trainers.put_terms(record.get("EventCfg"), TERMS, bodies, joints, facts)
    return facts.plain()


def _spawn(spawn: Record) -> Iterator[tuple[str, Value]]:
    """The asset, its variant, and how PhysX and Newton solve it."""
    for name in SPAWN:
        value = spawn.get(name)
        yield f"{FORM}:{name}", str(value) if isinstance(value, dict) else value
    stated = spawn.get("articulation_props")
    several = stated if isinstance(stated, list) else [stated]
    for properties in (spawn.get("rigid_props"), *several):
        for name, value in table_of(properties).items():
            if isinstance(value, bool | int | float) and name != LINE:
                yield "self-collision" if name == TOUCHES[0] else f"{FORM}:{name}", value


def _drive(
    group: Record, joint: str, generation: Generation, timestep_s: float
) -> dict[str, Value]:
    """Quantities of one joint; what its group does not state the USD decides."""
    effort, (velocity, *others) = LIMITS[generation, class_of(group) == IMPLICIT]
    fields = FIELDS | {effort: "effort", velocity: "velocity"} | {o: f"{FORM}:{o}" for o in others}
    steps = (group.get("min_delay", 0), group.get("max_delay", 0))
    return drive_facts(group, joint, fields) | {"delay": trainers.delay_s(steps, timestep_s)}


# --- what the robot says ----------------------------------------------------------------------


def _besides(reference: Reference, robot: str, generation: Generation) -> Table:
    """The start, the asset and its solver, drives in Isaac Lab's forms, and its materials."""
    facts, asked = Table(), reference.options.get("isaaclab") or {}
    clearance = asked.get("clearance", CLEARANCE_M) if reference.tree.base == "floating" else 0.0
    soft = asked.get("soft_joint_pos_limit_factor", 1.0)
    trainers.put_expected_start(reference, FORM, soft, clearance, facts)
    words = dict(_solving(reference, generation))
    asset = (f"/bundle/usd/{robot}.usda", asked.get("contact_sensors", True))
    words |= dict(zip(SPAWN, (*asset, "{'Physics': 'physics'}"), strict=True))
    facts.put("robot", "", {f"{FORM}:{name}": value for name, value in words.items()})
    facts.put("robot", "", {"self-collision": touches_itself(reference)})
    timestep, springs = reference.control.simulation.timestep, free_springs(reference.control)
    for row in reference.control.actuators:
        if row.joint in springs:  # an implicit drive that aims at the spring's rest
            row = replace(row, kp=springs[row.joint][0])
        ranges = trainers.varied(reference, "joints", row.joint) or {}
        steps = ranges.get("delay", (0, 0)) if row.model == "ideal_pd" else (0, 0)
        delay: dict[str, Value] = {"delay": trainers.delay_s(steps, timestep)}
        facts.put("joint", row.joint, delay | _isaac_drive(row, generation))
    recipe, slide = reference.options.get("randomize") or {}, reference.control.contact.friction[0]
    if recipe.get("friction") is not None or recipe.get("restitution") is not None:
        friction = tuple(recipe.get("friction") or (slide, slide))
        words = {"surface friction": friction, "dynamic surface friction": friction}
        words["materials"] = (asked.get("friction_buckets", MATERIALS),)
        facts.put("robot", "", {f"drawn:{word}": value for word, value in words.items()})
    return facts


def _solving(reference: Reference, generation: Generation) -> Iterator[tuple[str, Value]]:
    """How PhysX and Newton solve the robot: the same as stands in the USD."""
    rigid = rigid_of(reference)
    rigid["max_angular_velocity"] = math.degrees(rigid["max_angular_velocity"])
    yield from rigid.items()
    for name, value in solver_of(reference).items():
        yield name.replace("iterations", "iteration_count"), value
    if generation == 3:
        yield TOUCHES[1], touches_itself(reference)
        yield "integrator", "implicitfast"


def _isaac_drive(row: Actuator, generation: Generation) -> dict[str, Value]:
    """A `motor` is an ideal PD without gains, of `general` there is no other form; a spring is the
    stiffness of a passive drive."""
    is_implicit = row.model in ("pd", "velocity", "passive")
    kp = row.kp if row.model in (*LOOPS, "passive") else 0.0
    kd = row.kd if row.model in (*LOOPS, "velocity") else 0.0
    model = row.model
    if is_implicit:
        model = "pd" if kp else "velocity" if kd else "passive"
    elif model == "general" or not (kp or kd or model == "dc_motor"):
        model = "motor"
    facts: dict[str, Value] = {"model": model, "kp": kp, "kd": kd}
    facts[f"{FORM}:dynamic_friction"] = row.friction
    again = LIMITS[generation, is_implicit][1][1:]
    return facts | {f"{FORM}:{field}": row.velocity for field in again}
