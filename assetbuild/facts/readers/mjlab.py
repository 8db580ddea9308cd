"""`python/<robot>_mjlab.py`: what it gives to mjlab 1.6, recorded by stand-ins for mjlab's classes.

mjlab counts in SI, rad, quaternions wxyz, and delays in simulation steps. Passive damping, friction
and armature of driven joints stand here and not in the bare MJCF.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

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
    delay_s,
    expected_delay_s,
    left_to_the_asset,
    matching,
    number_of,
    own_names,
    put_expected_start,
    put_start,
)

FORM = "mjlab"
CALLS = ("spec", "robot_cfg", "velocity_flat_cfg")
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
"""The same by model; other drives mjlab does not have."""
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
STEPS = ("timestep", "decimation", "gravity")
UNLIMITED = 1e9
"""N m or N: a motor of mjlab needs a limit, so this one says that there is none."""


class MjlabReader(Reader):
    """Executes the module for mjlab with stand-ins and compares what it says with the robot."""

    form: ClassVar[str] = FORM
    called: ClassVar[str] = "mjlab's module"
    needs: ClassVar[tuple[str, ...]] = ("mjlab",)
    behind: ClassVar[tuple[str, ...]] = ("python/*_mjlab.py",)
    asks: ClassVar[tuple[str, ...]] = ("randomize", "feet", "mjlab")
    lacks: ClassVar[Mapping[str, str]] = left_to_the_asset()

    def file(self, root: Path, robot: str) -> Path | None:
        """The one module below `python/`."""
        found = sorted((root / "python").glob("*_mjlab.py"))
        return found[0] if found else root / "python" / f"{robot}_mjlab.py"

    def read(self, path: Path) -> Table:
        """The facts of a module, by the names that it writes out."""
        record = recorded(path, CALLS)
        start = table_of(table_of(record.get("robot_cfg()")).get("init_state"))
        return _table(record, own_names(start.get("joint_pos")), path.name)

    def found(self, path: Path, reference: Reference) -> Table:
        """Patterns are those of the robot's joints."""
        joints = {joint.name: joint.name for joint in reference.tree.moving_joints}
        return _table(recorded(path, CALLS), joints, path.name)

    def expected(self, reference: Reference) -> Table:
        """The joints that mjlab can drive; what it has besides drives."""
        models = {row.joint: row.model for row in reference.control.actuators}

        def is_stated(key: Key) -> bool:
            stated = STATED.get(models.get(key.name, ""), frozenset())
            return self.holds(key) and (key.kind != "joint" or key.quantity in stated)

        return robot_table(reference).only(is_stated) | _besides(reference, self.robot)


# --- what the module says ---------------------------------------------------------------------


def _table(record: Record, joints: Names, file: str) -> Table:
    """The robot of the velocity task where there is one, else the robot alone."""
    book, task = Writer(), record.get("velocity_flat_cfg()")
    robot, scale = record["robot_cfg()"], record["ACTION_SCALE"]
    simulation = {name: record[name.upper()] for name in STEPS}
    if task is not None:
        simulation = task["sim"]["mujoco"] | {"decimation": task.get("decimation")}
        scale = task["actions"]["joint_pos"].get("scale")
        robot = task["scene"]["entities"]["robot"]
    book.put("simulation", "", {n: simulation[n] for n in STEPS if simulation.get(n) is not None})
    model = words_of(record[f"{class_of(robot.get('spec_fn'))}()"].get(ARGUMENTS))
    book.put("robot", "", {f"{FORM}:model": model, f"{FORM}:root": record["ROOT_BODY"]})
    start, body = robot["init_state"], robot["articulation"]
    put_start(start, start.get("rot", (1.0, 0.0, 0.0, 0.0)), FORM, joints, book)
    book.put("robot", "", {"soft limits": body.get("soft_joint_pos_limit_factor")})
    for drive in body["actuators"]:
        for joint in matching(words_of(drive.get("target_names_expr")), joints):
            book.put("joint", joint, _drive(drive, record["TIMESTEP"]))
            book.place("joint", joint, f"{file}:{drive[LINE]}")
    for there, own in joints.items():
        if (number := number_of(scale, there)) is not None:
            book.put("joint", own, {f"{FORM}:action scale": number})
    return book.plain_table()


def _drive(drive: Record, timestep_s: float) -> dict[str, Value]:
    """Quantities of each joint of one group."""
    kind = class_of(drive)
    facts: dict[str, Value] = {"model": DRIVES[kind][0] if kind in DRIVES else kind}
    facts |= {quantity: drive[field] for field, quantity in FIELDS.items() if field in drive}
    if facts["model"] == "motor" and facts.get("effort") == UNLIMITED:
        facts["effort"] = None
    steps = (drive.get("delay_min_lag", 0), drive.get("delay_max_lag", 0))
    return facts | {"delay": delay_s(steps, timestep_s)}


# --- what the robot says ----------------------------------------------------------------------


def _besides(reference: Reference, robot: str) -> Table:
    """The start, delays and actions."""
    book, asked = Writer(), reference.options.get("mjlab") or {}
    model = (f"/bundle/mjcf/{robot}_bare.xml",)
    book.put("robot", "", {f"{FORM}:model": model, f"{FORM}:root": reference.tree.root})
    put_expected_start(reference, FORM, asked.get("soft_joint_pos_limit_factor", 0.9), 0.0, book)
    action = {"effort_share": 0.25, "rad": 0.5, "m": 0.05} | (asked.get("action") or {})
    for row in reference.control.actuators:
        if row.model in STATED:
            book.put("joint", row.joint, {"delay": expected_delay_s(reference, row.joint)})
            if row.kp and row.effort:
                slides = reference.tree.by_joint[row.joint].kind == "prismatic"
                most = action["m" if slides else "rad"]
                scale = min(action["effort_share"] * row.effort / row.kp, most)
                book.put("joint", row.joint, {f"{FORM}:action scale": scale})
    return book.table()
