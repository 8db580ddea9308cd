"""`python/<robot>_isaaclab_2.py` and `_3.py`: what they give to Isaac Lab, recorded by stand-ins.

Isaac Lab counts in SI and rad; delays are in simulation steps, `max_angular_velocity` is in deg/s.
Quaternions are wxyz in 2.x and xyzw in 3.x, and each generation has its own fields for limits; see
docs/reference/isaaclab.md. What the module for 3.x says again are words `isaaclab 3:...`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from assetbuild.errors import UsageError
from assetbuild.facts.derived import free_springs, per_axis
from assetbuild.facts.isaaclab_config import (
    CONFIG,
    DRIVE,
    IMPLICIT,
    LIMITS,
    Generation,
    model_of,
    quat_of,
)
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.standins import LINE, Record, class_of, recorded, table_of, words_of
from assetbuild.facts.table import Key, Table, Value, Writer
from assetbuild.facts.trainers import (
    UNCHANGED,
    Names,
    delay_s,
    factors,
    left_to_the_asset,
    massive_bodies,
    matching,
    own_names,
    put_drawn,
    put_expected_start,
    put_start,
    put_terms,
    varied,
)
from assetbuild.facts.usd_options import rigid_of, solver_of, touches_itself
from assetbuild.robot.model import Actuator
from assetbuild.simulators.usd_names import body_identifiers, joint_identifiers

FORM = "isaaclab"
GENERATIONS: tuple[Generation, ...] = (2, 3)
LOOPS = ("pd", "ideal_pd", "dc_motor")
TOUCHES = ("enabled_self_collisions", "self_collision_enabled")
"""Whether parts of the robot touch one another, in PhysX and in Newton."""
CLEARANCE_M = 0.001
"""Soles that start inside of the floor are thrown off it."""
MATERIALS = 64
"""Contact materials to draw from; PhysX has room for 64000 in all environments."""


class IsaacLabReader(Reader):
    """Executes the modules for Isaac Lab with stand-ins and compares them with the robot."""

    form: ClassVar[str] = FORM
    called: ClassVar[str] = "Isaac Lab's modules"
    needs: ClassVar[tuple[str, ...]] = ("isaaclab",)
    folder: ClassVar[str] = "python"
    behind: ClassVar[tuple[str, ...]] = ("python/*_isaaclab_?.py",)
    asks: ClassVar[tuple[str, ...]] = ("isaaclab", "usd", "randomize")
    lacks: ClassVar[Mapping[str, str]] = left_to_the_asset("robot self-collision")

    def file(self, root: Path, robot: str) -> Path | None:
        """The module for 2.x; the other lies beside it."""
        found = sorted(root.glob("*_isaaclab_2.py"))
        return found[0] if found else root / f"{robot}_isaaclab_2.py"

    def read(self, path: Path) -> Table:
        """The facts of both modules, by the names that they write out."""
        return _tables(path, {}, {})

    def found(self, path: Path, reference: Reference) -> Table:
        """Patterns are those of the robot's bodies and joints as the USD names them."""
        tree = reference.tree
        there = joint_identifiers(tree)
        joints = {there[joint.name]: joint.name for joint in tree.moving_joints}
        bodies = {usd: own for own, usd in body_identifiers(tree).items()}
        return _tables(path, bodies, joints)

    def expected(self, reference: Reference) -> Table:
        """The robot's drives as Isaac Lab has them, what it has besides, both times."""
        driven = {row.joint for row in reference.control.actuators}

        def is_stated(key: Key) -> bool:
            return self.holds(key) and (key.kind != "joint" or key.name in driven)

        drives = robot_table(reference).only(is_stated)
        return _both({n: drives | _besides(reference, self.robot, n) for n in GENERATIONS})


def _both(tables: Mapping[Generation, Table]) -> Table:
    """Facts of both modules; the later generation's are words, because they stand there again."""
    later = {
        key._replace(quantity=f"{FORM} 3:{key.quantity.rpartition(':')[2]}"): value
        for key, value in tables[3].facts.items()
    }
    return tables[2] | Table(later)


# --- what the modules say ---------------------------------------------------------------------


def _tables(path: Path, bodies: Names, joints: Names) -> Table:
    files = {n: path.with_name(path.name.replace("_isaaclab_2", f"_isaaclab_{n}"))
             for n in GENERATIONS}  # fmt: skip
    return _both({n: _table(file, n, bodies, joints) for n, file in files.items()})


def _table(path: Path, generation: Generation, bodies: Names, joints: Names) -> Table:
    record, book = recorded(path), Writer()
    configs = [value for value in record.values() if class_of(value) == CONFIG]
    if not configs:
        raise UsageError(f"`{path.name}` has no `NAME = {CONFIG}(...)`")
    config = configs[0]
    start = table_of(config.get("init_state"))
    joints = joints or own_names(start.get("joint_pos"))
    simulation = table_of(record["SIMULATION_CFG"])
    timestep = simulation["dt"]
    steps = {"timestep": timestep, "decimation": simulation["render_interval"]}
    book.put("simulation", "", {**steps, "gravity": tuple(simulation["gravity"])})
    newton = table_of(table_of(record.get("NEWTON_CFG")).get("solver_cfg"))
    book.put("robot", "", {f"{FORM}:integrator": newton.get("integrator")})
    put_start(start, quat_of(start, generation), FORM, joints, book)
    book.put("robot", "", {"soft limits": config.get("soft_joint_pos_limit_factor")})
    book.put("robot", "", dict(_spawn(table_of(config.get("spawn")))))
    for group in table_of(config.get("actuators")).values():
        for joint in matching(words_of(group.get("joint_names_expr")), joints):
            book.put("joint", joint, _drive(group, generation, timestep))
            book.place("joint", joint, f"{path.name}:{group.get(LINE)}")
    put_terms(record.get("EventCfg"), FORM, bodies, joints, book)
    return book.plain_table()


def _spawn(spawn: Record) -> Iterator[tuple[str, Value]]:
    """The asset, its variant, and how PhysX and Newton solve it."""
    for name in ("usd_path", "activate_contact_sensors", "variants"):
        value = spawn.get(name)
        yield f"{FORM}:{name}", str(value) if isinstance(value, dict) else value
    stated = spawn.get("articulation_props")
    for properties in (
        spawn.get("rigid_props"),
        *(stated if isinstance(stated, list) else [stated]),
    ):
        for name, value in table_of(properties).items():
            if isinstance(value, bool | int | float) and name != LINE:
                yield "self-collision" if name == TOUCHES[0] else f"{FORM}:{name}", value


def _drive(group: Record, generation: Generation, timestep_s: float) -> dict[str, Value]:
    """Quantities of each joint of one group; what it does not state the USD decides."""
    facts: dict[str, Value] = {quantity: group.get(field) for field, quantity in DRIVE.items()}
    facts["model"] = model_of(class_of(group), facts["kp"], facts["kd"])
    effort, velocities = LIMITS[generation, class_of(group) == IMPLICIT]
    facts |= {"effort": group.get(effort), "velocity": group.get(velocities[0])}
    for field in (*velocities[1:], "dynamic_friction"):
        facts[f"{FORM}:{field}"] = group.get(field)
    steps = (group.get("min_delay", 0), group.get("max_delay", 0))
    return facts | {"delay": delay_s(steps, timestep_s)}


# --- what the robot says ----------------------------------------------------------------------


def _besides(reference: Reference, robot: str, generation: Generation) -> Table:
    """The start, the asset and its solver, drives in Isaac Lab's forms, and what is drawn."""
    book, asked = Writer(), reference.options.get("isaaclab") or {}
    clearance = asked.get("clearance", CLEARANCE_M) if reference.tree.base == "floating" else 0.0
    soft = asked.get("soft_joint_pos_limit_factor", 1.0)
    put_expected_start(reference, FORM, soft, clearance, book)
    words = dict(_solving(reference, generation))
    words |= {"usd_path": f"/bundle/usd/{robot}.usda", "variants": "{'Physics': 'physics'}"}
    words["activate_contact_sensors"] = asked.get("contact_sensors", True)
    book.put("robot", "", {f"{FORM}:{name}": value for name, value in words.items()})
    book.put("robot", "", {"self-collision": touches_itself(reference)})
    timestep, springs = reference.control.simulation.timestep, free_springs(reference.control)
    for row in reference.control.actuators:
        if row.joint in springs:  # an implicit drive that aims at the spring's rest
            row = replace(row, kp=springs[row.joint][0])
        ranges = varied(reference, "joints", row.joint) or {}
        steps = ranges.get("delay", (0, 0)) if row.model == "ideal_pd" else (0, 0)
        delay: dict[str, Value] = {"delay": delay_s(steps, timestep)}
        book.put("joint", row.joint, delay | _isaac_drive(row, generation))
    if reference.options.get("randomize"):
        _put_drawn(reference, asked.get("friction_buckets", MATERIALS), book)
    return book.table()


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


def _put_drawn(reference: Reference, buckets: int, book: Writer) -> None:
    """What is drawn at the start; friction and restitution that do not vary stay the USD's."""
    scale = {"operation": "scale"}
    for body in massive_bodies(reference):
        matter = varied(reference, "links", body) or {}
        if tuple(matter.get("density", UNCHANGED)) != UNCHANGED:
            density: dict[str, object] = {"mass_distribution_params": matter["density"]}
            density["recompute_inertia"] = True
            put_drawn(FORM, "randomize_rigid_body_mass", "body", body, book, **scale, **density)
        most = per_axis(matter.get("com", 0.0))
        if any(most):
            shift = {axis: (-value, value) for axis, value in zip("xyz", most, strict=True)}
            put_drawn(FORM, "randomize_rigid_body_com", "body", body, book, com_range=shift)
    for joint in (each.name for each in reference.tree.moving_joints):
        ranges = varied(reference, "joints", joint) or {}
        if factors(ranges, "kp", "kd"):
            put_drawn(FORM, "randomize_actuator_gains", "joint", joint, book, **scale,
                      stiffness_distribution_params=ranges["kp"],
                      damping_distribution_params=ranges["kd"])  # fmt: skip
        said = factors(ranges, "friction", "armature")
        params = {f"{key}_distribution_params": pair for key, pair in said.items()}
        if params:
            put_drawn(FORM, "randomize_joint_parameters", "joint", joint, book, **scale, **params)
    recipe, slide = reference.options["randomize"], reference.control.contact.friction[0]
    friction, bounce = recipe.get("friction"), recipe.get("restitution")
    if friction is not None or bounce is not None:
        put_drawn(
            FORM, "randomize_rigid_body_material", "robot", "", book,
            static_friction_range=friction or (slide, slide),
            dynamic_friction_range=friction or (slide, slide),
            restitution_range=bounce or (0.0, 0.0), make_consistent=True, num_buckets=buckets,
        )  # fmt: skip
