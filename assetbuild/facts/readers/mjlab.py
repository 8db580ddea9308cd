"""`python/<robot>_mjlab.py`: what it gives to mjlab 1.6, recorded by stand-ins for mjlab's classes.

mjlab counts in SI, rad, quaternions wxyz, and delays in simulation steps. Passive damping, friction
and armature of driven joints stand here and not in the bare MJCF.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

from assetbuild.facts.mjlab_draws import expected_draws, replaced_events
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.standins import (
    ARGUMENTS,
    LINE,
    Record,
    class_of,
    recorded,
    table_of,
    words_of,
)
from assetbuild.facts.table import Key, Table, Value, Writer
from assetbuild.facts.trainers import (
    Names,
    Ranges,
    delay_s,
    left_to_the_asset,
    matching,
    own_names,
    put_by_joint,
    put_drive,
    put_expected_start,
    put_start,
    read_terms,
)
from assetbuild.robot.action import Action

FORM = "mjlab"
CALLS = ("spec", "robot_cfg", "randomize_events", "velocity_flat_cfg")
MODELS = {
    "BuiltinPositionActuatorCfg": "pd",
    "IdealPdActuatorCfg": "ideal_pd",
    "DcMotorActuatorCfg": "dc_motor",
    "BuiltinVelocityActuatorCfg": "velocity",
    "BuiltinMotorActuatorCfg": "motor",
}
"""mjlab's actuators -> models of the table."""
DRIVE = {
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
ALWAYS = frozenset({"model", "effort", "armature", "friction", "damping"})
STATED = {
    "pd": ALWAYS | {"kp", "kd"},
    "ideal_pd": ALWAYS | {"kp", "kd"},
    "dc_motor": ALWAYS | {"kp", "kd", "velocity", "stall"},
    "velocity": ALWAYS | {"kd"},
    "motor": ALWAYS,
}
"""Model -> quantities that the module states of a joint; other drives mjlab does not have."""
SPREADS = {"standing": (0.05, 0.1), "walking": (0.3, 0.6), "running": (0.3, 0.6)}
"""rad that cost nothing much in mjlab's reward `pose`, of other joints and of knees."""
KNEES = "(?i).*(calf|knee).*"
UNLIMITED = 1e9
"""N m or N: a motor of mjlab needs a limit, so this one says that there is none."""


class MjlabReader(Reader):
    """Executes the module for mjlab with stand-ins and compares what it says with the robot."""

    form: ClassVar[str] = FORM
    called: ClassVar[str] = "mjlab's module"
    needs: ClassVar[tuple[str, ...]] = ("mjlab",)
    behind: ClassVar[tuple[str, ...]] = ("python/*_mjlab.py",)
    asks: ClassVar[tuple[str, ...]] = ("randomize", "feet", "mjlab")
    lacks: ClassVar[Mapping[str, str]] = left_to_the_asset("simulation cone", "simulation impratio")

    def file(self, root: Path, robot: str) -> Path | None:
        """The one module below `python/`."""
        found = sorted((root / "python").glob("*_mjlab.py"))
        return found[0] if found else root / "python" / f"{robot}_mjlab.py"

    def read(self, path: Path) -> Table:
        """The facts of a module, by the names that it writes out."""
        record = recorded(path, CALLS)
        start = table_of(table_of(record.get("robot_cfg()")).get("init_state"))
        return _table(record, {}, own_names(start.get("joint_pos")), path.name)

    def found(self, path: Path, reference: Reference) -> Table:
        """Patterns are those of the robot's bodies and joints."""
        tree = reference.tree
        joints = {joint.name: joint.name for joint in tree.moving_joints}
        bodies = {name: name for name in tree.by_body}
        return _table(recorded(path, CALLS), bodies, joints, path.name)

    def expected(self, reference: Reference) -> Table:
        """The joints that mjlab can drive; what it has besides drives."""
        models = {row.joint: row.model for row in reference.control.actuators}

        def is_stated(key: Key) -> bool:
            stated = STATED.get(models.get(key.name, ""), frozenset())
            return self.holds(key) and (key.kind != "joint" or key.quantity in stated)

        return robot_table(reference).only(is_stated) | _besides(reference, self.robot)


# --- what the module says ---------------------------------------------------------------------


def _table(record: Record, bodies: Names, joints: Names, file: str) -> Table:
    """Of the velocity task where there is one, else of the robot alone."""
    book, task = Writer(), record.get("velocity_flat_cfg()")
    robot, terms = record["robot_cfg()"], record.get("randomize_events()")
    simulation = {name: record[name.upper()] for name in ("timestep", "decimation", "gravity")}
    scale = record["ACTION_SCALE"]
    if task is not None:
        simulation = task["sim"]["mujoco"] | {"decimation": task.get("decimation")}
        scale, terms = task["actions"]["joint_pos"].get("scale"), task["events"]
        robot = task["scene"]["entities"]["robot"]
        pose = task["rewards"]["pose"]["params"]
        for gait in SPREADS:
            put_by_joint(pose.get(f"std_{gait}"), joints, f"{FORM}:{gait} spread", book)
        gone = tuple(sorted(name for name, term in terms.items() if term is None))
        book.put("robot", "", {f"{FORM}:without": gone})
    book.put("simulation", "", dict(_simulation(simulation)))
    model = words_of(record[f"{class_of(robot.get('spec_fn'))}()"].get(ARGUMENTS))
    book.put("robot", "", {f"{FORM}:model": model, f"{FORM}:root": record["ROOT_BODY"]})
    groups = _robot(robot, record["TIMESTEP"], joints, book, file)
    put_by_joint(scale, joints, f"{FORM}:action scale", book)
    for term in read_terms(terms, bodies, joints, groups):
        term.put(FORM, book)
    return book.plain_table()


def _simulation(options: Record) -> Iterator[tuple[str, Value]]:
    for name in ("timestep", "decimation", "gravity", "cone", "impratio"):
        value = options.get(name)
        if value is not None:
            yield name, tuple(value) if isinstance(value, list) else value


def _robot(
    robot: Record, timestep_s: float, joints: Names, book: Writer, file: str
) -> list[list[str]]:
    """`EntityCfg`; returns the joints of each group of drives."""
    start, body = robot["init_state"], robot["articulation"]
    put_start(start, start.get("rot", (1.0, 0.0, 0.0, 0.0)), FORM, joints, book)
    book.put("robot", "", {"soft limits": body.get("soft_joint_pos_limit_factor")})
    groups = []
    for drive in body["actuators"]:
        groups.append(matching(words_of(drive.get("target_names_expr")), joints))
        put_drive(groups[-1], _drive(drive, timestep_s), book, f"{file}:{drive[LINE]}")
    return groups


def _drive(drive: Record, timestep_s: float) -> dict[str, Value]:
    """Quantities of each joint of one group."""
    facts: dict[str, Value] = {"model": MODELS.get(class_of(drive), class_of(drive))}
    facts |= {quantity: drive[field] for field, quantity in DRIVE.items() if field in drive}
    if facts["model"] == "motor" and facts.get("effort") == UNLIMITED:
        facts["effort"] = None
    steps = (drive.get("delay_min_lag", 0), drive.get("delay_max_lag", 0))
    return facts | {"delay": delay_s(steps, timestep_s)}


# --- what the robot says ----------------------------------------------------------------------


def _besides(reference: Reference, robot: str) -> Table:
    """The start, delays, actions, what is drawn, and the options of the velocity task."""
    book, asked, ranges = Writer(), reference.options.get("mjlab") or {}, Ranges.of(reference)
    model = (f"/bundle/mjcf/{robot}_bare.xml",)
    book.put("robot", "", {f"{FORM}:model": model, f"{FORM}:root": reference.tree.root})
    put_expected_start(reference, FORM, asked.get("soft_joint_pos_limit_factor", 0.9), 0.0, book)
    action = Action.model_validate(asked.get("action") or {})
    for row in reference.control.actuators:
        if row.model in STATED:
            steps = ranges.joint(row.joint).delay
            delay = delay_s(steps, reference.control.simulation.timestep)
            book.put("joint", row.joint, {"delay": delay})
        if row.model in STATED and row.kp and row.effort:
            slides = reference.tree.by_joint[row.joint].kind == "prismatic"
            most = action.m if slides else action.rad
            scale = min(action.effort_share * row.effort / row.kp, most)
            book.put("joint", row.joint, {f"{FORM}:action scale": scale})
    for term in expected_draws(reference, ranges):
        term.put(FORM, book)
    if _walks(reference):
        book.put("robot", "", {f"{FORM}:without": replaced_events(reference, ranges)})
        solver = {"cone": asked.get("cone", "elliptic"), "impratio": asked.get("impratio", 10.0)}
        book.put("simulation", "", solver)
        _put_spreads(reference, asked.get("pose") or {}, book)
    return book.table()


def _put_spreads(
    reference: Reference,
    pose: Mapping[str, Any],  # Any: JSON
    book: Writer,
) -> None:
    for row in reference.control.actuators:
        if row.model in STATED:
            is_knee = re.fullmatch(pose.get("knees", KNEES), row.joint) is not None
            spreads = {gait: pose.get(gait, usual)[is_knee] for gait, usual in SPREADS.items()}
            facts = {f"{FORM}:{gait} spread": rad for gait, rad in spreads.items()}
            book.put("joint", row.joint, facts)


def _walks(reference: Reference) -> bool:
    """Whether the module has mjlab's velocity task: a floating robot that stands on something."""
    pattern = (reference.options.get("feet") or {}).get("links")
    links = [shape.link for shape in reference.shapes.of("collision")]
    stands = any(re.fullmatch(pattern, link) for link in links) if pattern else False
    driven = any(row.model in STATED for row in reference.control.actuators)
    return reference.tree.base == "floating" and stands and driven
