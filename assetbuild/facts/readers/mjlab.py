"""`python/<robot>_mjlab.py`: what it gives to mjlab 1.6, recorded by stand-ins for mjlab's classes.

mjlab counts in SI, rad, quaternions wxyz, and delays in simulation steps. Passive damping, friction
and armature of driven joints stand here and not in the bare MJCF.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import ClassVar

from assetbuild.facts import trainers
from assetbuild.facts._standins_child import ARGUMENTS, LINE
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.standins import Record, class_of, recorded, table_of, words_of
from assetbuild.facts.table import Key, Table, Value
from assetbuild.facts.trainers import LOOPS, Names, Term
from assetbuild.grouping import grouped
from assetbuild.robot.model import Actuator
from assetbuild.simulators.mujoco import body_names

FORM = "mjlab"
CALLS = ("spec", "robot_cfg", "randomize_events", "velocity_flat_cfg")
ALWAYS = frozenset({"model", "effort", "armature", "friction", "damping"})
DRIVES: Mapping[str, tuple[str, frozenset[str]]] = {
    "BuiltinPositionActuatorCfg": ("pd", ALWAYS | {"kp", "kd"}),
    "IdealPdActuatorCfg": ("ideal_pd", ALWAYS | {"kp", "kd"}),
    "DcMotorActuatorCfg": ("dc_motor", ALWAYS | {"kp", "kd", "velocity", "stall"}),
    "BuiltinVelocityActuatorCfg": ("velocity", ALWAYS | {"kd"}),
    "BuiltinMotorActuatorCfg": ("motor", ALWAYS),
}
"""mjlab's actuators -> model of the table, and the quantities that they state of a joint."""
STATED = dict(DRIVES.values())
"""Model of the table -> those quantities; mjlab has no other drives."""
FIELDS = {
    "stiffness": "kp",
    "damping": "kd",
    "effort_limit": "effort",
    "velocity_limit": "velocity",
    "saturation_effort": "stall",
    "armature": "armature",
    "frictionloss": "friction",
    "viscous_damping": "damping",
}
"""mjlab's fields -> the vocabulary's quantities."""
MATTER = {"alpha_range": "density", "d_range": "stretch"}
MATTER |= {f"t{n}_range": f"com {axis}" for n, axis in enumerate("xyz", start=1)}
MATTER |= {f"{shear.replace('shear ', 's')}_range": shear for shear in trainers.SHEARS}
SCALED = {"operation": "scale"}
SOLES = {"geom_names": [r".*_collision\d*"], "axes": [0], "shared_random": True, "operation": "abs"}
TERMS: Mapping[str, Term] = {
    "pseudo_inertia": Term(MATTER),
    "carry_payload": Term({"mass_range": "payload mass", "box": "payload box"}),
    "pd_gains": Term({"kp_range": "kp", "kd_range": "kd"}),
    "effort_limits": Term({"effort_limit_range": "effort"}),
    **{f"joint_{word}": Term({"ranges": word}, SCALED) for word in trainers.FACTORS[3:]},
    "encoder_bias": Term({"bias_range": "encoder bias"}),
    "geom_friction": Term({"ranges": "surface friction"}, SOLES),
}
"""mjlab's functions that draw."""
UNLIMITED = 1e9
"""N m or N: a motor of mjlab needs a limit, so this one says that there is none."""


class MjlabReader(Reader):
    """Executes the module for mjlab with stand-ins and compares what it says with the robot."""

    format_id: ClassVar[str] = FORM
    display_name: ClassVar[str] = "mjlab's module"
    needs: ClassVar[tuple[str, ...]] = ("mjlab",)
    file_globs: ClassVar[tuple[str, ...]] = ("python/*_mjlab.py",)
    recipe_sections: ClassVar[tuple[str, ...]] = ("randomize", "feet", "mjlab")
    lacks: ClassVar[Mapping[str, str]] = trainers.left_to_the_asset(
        "simulation cone", "simulation impratio"
    )

    def read(self, path: Path) -> Table:
        """The facts of a module, by the names that it writes out."""
        return _table(path, {}, {})

    def found(self, path: Path, reference: Reference) -> Table:
        """Patterns are those of the robot's bodies and joints."""
        tree = reference.tree
        joints = {joint.name: joint.name for joint in tree.moving_joints}
        bodies = {written: name for name, written in body_names(tree).items()}
        return _table(path, bodies, joints)

    def expected(self, reference: Reference) -> Table:
        """The joints that mjlab can drive; what it has besides drives."""
        models = {row.joint: row.model for row in reference.control.actuators}

        def is_stated(key: Key) -> bool:
            stated = STATED.get(models.get(key.name, ""), frozenset())
            return self.holds(key) and (key.kind != "joint" or key.quantity in stated)

        facts = robot_table(reference).only(is_stated) | _besides(reference, self.robot)
        return facts | trainers.drawn(reference, _draws, without=("restitution",))


# --- what the module says ---------------------------------------------------------------------


def _table(path: Path, bodies: Names, joints: Names) -> Table:
    """Read the velocity task where there is one, else the robot alone."""
    facts, record = Table(), recorded(path, CALLS)
    task = record.get("velocity_flat_cfg()")
    robot, terms = record["robot_cfg()"], record.get("randomize_events()")
    simulation = {name: record[name.upper()] for name in ("timestep", "decimation", "gravity")}
    scale = record["ACTION_SCALE"]
    if task is not None:
        simulation = task["sim"]["mujoco"] | {"decimation": task.get("decimation")}
        scale, terms = task["actions"]["joint_pos"].get("scale"), task["events"]
        robot = task["scene"]["entities"]["robot"]
        gone = tuple(sorted(name for name, term in terms.items() if term is None))
        facts.put("robot", "", {f"{FORM}:without": gone})
        for sensor in task["scene"].get("sensors") or ():
            match = table_of(sensor.get("primary"))
            entries = _soles(words_of(match.get("pattern")))
            facts.put("robot", "", {f"{FORM}:{sensor['name']}": (str(match.get("mode")), *entries)})
    stated = ("timestep", "decimation", "gravity", "cone", "impratio")
    facts.put("simulation", "", {n: simulation[n] for n in stated if simulation.get(n) is not None})
    model = words_of(record[f"{class_of(robot.get('spec_fn'))}()"].get(ARGUMENTS))
    facts.put("robot", "", {f"{FORM}:model": model, f"{FORM}:root": record["ROOT_BODY"]})
    start, body = robot["init_state"], robot["articulation"]
    joints = joints or trainers.own_names(start.get("joint_pos"))
    trainers.put_start(start, start.get("rot", (1.0, 0.0, 0.0, 0.0)), FORM, joints, facts)
    facts.put("robot", "", {"soft limits": body.get("soft_joint_pos_limit_factor")})
    groups = []
    for drive in body["actuators"]:
        groups.append(trainers.matching(words_of(drive.get("target_names_expr")), joints))
        for joint in groups[-1]:
            facts.put("joint", joint, _drive(drive, record["TIMESTEP"]))
            facts.place("joint", joint, f"{path.name}:{drive[LINE]}")
    for there, joint in joints.items():
        if (number := trainers.number_of(scale, there)) is not None:
            facts.put("joint", joint, {f"{FORM}:action scale": number})
    trainers.put_terms(_with_densities(terms), TERMS, bodies, joints, facts, groups)
    return facts.plain()


def _drive(drive: Record, timestep_s: float) -> dict[str, Value]:
    """Quantities of each joint of one group."""
    kind = class_of(drive)
    facts: dict[str, Value] = {"model": DRIVES[kind][0] if kind in DRIVES else kind}
    facts |= {quantity: drive[field] for field, quantity in FIELDS.items() if field in drive}
    if facts["model"] == "motor" and facts.get("effort") == UNLIMITED:
        facts["effort"] = None
    steps = (drive.get("delay_min_lag", 0), drive.get("delay_max_lag", 0))
    return facts | {"delay": trainers.delay_s(steps, timestep_s)}


def _with_densities(terms: object) -> Record:
    """Event terms with factors of the mass, which grows by exp(2 alpha), in the place of alpha."""
    events = dict(table_of(terms))
    for name, term in events.items():
        params = table_of(table_of(term).get("params"))
        if "alpha_range" in params:
            factors = [math.exp(2.0 * alpha) for alpha in params["alpha_range"]]
            events[name] = term | {"params": params | {"alpha_range": factors}}
    return events


# --- what the robot says ----------------------------------------------------------------------


def _besides(reference: Reference, robot: str) -> Table:
    """The start, delays, actions, and the options of the velocity task."""
    facts, asked = Table(), reference.options.get("mjlab") or {}
    model = (f"/bundle/mjcf/{robot}_bare.xml",)
    root = body_names(reference.tree)[reference.tree.root]
    facts.put("robot", "", {f"{FORM}:model": model, f"{FORM}:root": root})
    trainers.put_expected_start(
        reference, FORM, asked.get("soft_joint_pos_limit_factor", 0.9), 0.0, facts
    )
    action = {"effort_share": 0.25, "min_rad": 0.25, "rad": 0.5, "m": 0.05}
    action |= asked.get("action") or {}
    for row in reference.control.actuators:
        if row.model in STATED:
            steps = (trainers.varied(reference, "joints", row.joint) or {}).get("delay", (0, 0))
            delay = trainers.delay_s(steps, reference.control.simulation.timestep)
            facts.put("joint", row.joint, {"delay": delay})
            if row.kp and row.effort:
                share = action["effort_share"] * row.effort / row.kp
                if reference.tree.by_joint[row.joint].kind == "prismatic":
                    scale = min(share, action["m"])
                else:
                    scale = min(max(share, action["min_rad"]), action["rad"])
                facts.put("joint", row.joint, {f"{FORM}:action scale": scale})
    if _walks(reference):
        facts.put("robot", "", {f"{FORM}:without": tuple(_replaced(reference))})
        facts.put("robot", "", {f"{FORM}:feet_ground_contact": _feet(reference)})
        solver = {"cone": asked.get("cone", "elliptic"), "impratio": asked.get("impratio", 10.0)}
        facts.put("simulation", "", solver)
    return facts


def _walks(reference: Reference) -> bool:
    """Whether the module has mjlab's velocity task: a floating robot that stands on something."""
    pattern = (reference.options.get("feet") or {}).get("links")
    links = [shape.link for shape in reference.shapes.of("collision")]
    stands = any(re.fullmatch(pattern, link) for link in links) if pattern else False
    is_driven = any(row.model in STATED for row in reference.control.actuators)
    return reference.tree.base == "floating" and stands and is_driven


def _feet(reference: Reference) -> tuple[str, ...]:
    """What the sensor of the feet matches: a geom of each, their bodies where one has several."""
    tree, pattern = reference.tree, reference.options["feet"]["links"]
    solid = reference.shapes.of("collision")
    soles = [shape for shape in solid if re.fullmatch(pattern, shape.link)]
    feet = grouped(soles, lambda shape: tree.placement(shape.link)[0])
    if len(feet) == len(soles):
        return ("geom", *_soles(shape.name for shape in soles))
    return ("body", *_soles(body_names(tree)[body] for body in feet))


def _soles(names: Iterable[str]) -> list[str]:
    """Sorted, without what the bare MJCF appends to names of geoms."""
    return sorted(re.sub(r"_collision\d*$", "", name) for name in names)


def _replaced(reference: Reference) -> Iterator[str]:
    """Events of mjlab's velocity task that would draw the same once more."""
    recipe, root = reference.options.get("randomize") or {}, reference.tree.bodies[0]
    if not root.is_massless and trainers.varied(reference, "links", root.name) is not None:
        yield "base_com"
    if any(joint.get("encoder_bias") for joint in recipe.get("joints", {}).values()):
        yield "encoder_bias"
    if recipe.get("friction") is not None:
        yield "foot_friction"


def _draws(row: Actuator | None, word: str) -> bool:
    """mjlab scales gains and effort of drives that hold a position, losses of all joints."""
    is_loop = row is not None and row.model in LOOPS
    if word == "effort":
        return is_loop and row is not None and row.effort is not None
    return is_loop or word not in ("kp", "kd")
