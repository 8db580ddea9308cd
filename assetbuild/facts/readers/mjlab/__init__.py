"""`python/<robot>_mjlab.py`: what mjlab 1.6 puts on the bare MJCF, read by its syntax tree.

mjlab counts in SI, rad, quaternions wxyz, and delays in simulation steps. Passive damping, friction
and armature of driven joints stand here and not in the bare MJCF.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

from assetbuild.facts.reader import Reader
from assetbuild.facts.readers.mjlab.expected import expected_table
from assetbuild.facts.readers.mjlab.said import FORM, MODELS, READ, with_task_facts
from assetbuild.facts.reference import Reference
from assetbuild.facts.statements import put_words
from assetbuild.facts.syntax import Call, Module, flat, is_vector
from assetbuild.facts.table import Table, Value, Writer
from assetbuild.facts.trainers import Names, is_name, read_events, spread, texts, unescaped

DRIVE = {
    "stiffness": "kp",
    "damping": "kd",
    "effort_limit": "effort",
    "velocity_limit": "velocity",
    "saturation_effort": "stall",
    "armature": "armature",
    "frictionloss": "friction",
    "viscous_damping": "damping",
    "gear": "gear",
}
"""mjlab's fields -> the vocabulary's quantities."""
ALWAYS = ("armature", "frictionloss", "viscous_damping")
"""The bare MJCF leaves these to the module."""
UNLIMITED = 1e9
"""N m or N: a motor of mjlab needs a limit, so this one says that there is none."""
IN_BARE = "stands in the bare MJCF"


class MjlabReader(Reader):
    """Reads the module for mjlab back and compares it with the robot."""

    form: ClassVar[str] = FORM
    called: ClassVar[str] = "mjlab's module"
    needs: ClassVar[tuple[str, ...]] = ("mjlab",)
    behind: ClassVar[tuple[str, ...]] = ("python/*_mjlab.py",)
    asks: ClassVar[tuple[str, ...]] = ("randomize", "feet", "imu", "mjlab")
    lacks: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("body", "frame", "loop", "shape", "pair", "sensor", "camera"), IN_BARE),
        "keyframe": "mjlab starts in one pose: quantity `start`",
        "floor": "mjlab's task brings its own",
        "robot base": IN_BARE,
        "robot base pose": "quantity `start pose`: mjlab puts a fixed root there too",
        "robot articulation root": "MuJoCo has none",
        "robot self-collision": IN_BARE,
        "robot up axis": "always z",
        "robot metres per unit": "always SI",
        "robot kilograms per unit": "always SI",
        **dict.fromkeys(
            (
                "joint type", "joint body", "joint parent", "joint anchor", "joint axis",
                "joint lower", "joint upper", "joint stiffness", "joint spring reference",
                "joint mimics", "joint mimic multiplier", "joint mimic offset",
            ),
            IN_BARE,
        ),
        "joint command range": "mjlab takes the range, widened by effort / kp",
        "joint drive parameters": "mjlab has no form of a general drive",
        "joint drive name": "mjlab names drives by their joints",
        "joint drive target": "mjlab aims at the start",
        "simulation integrator": "mjlab's task decides",
        "simulation solver": "mjlab's task decides",
        "simulation iterations": "mjlab's task decides",
        "simulation line search iterations": "mjlab's task decides",
    }  # fmt: skip

    def file(self, root: Path, robot: str) -> Path | None:
        """The one module below `python/`."""
        found = sorted((root / "python").glob("*_mjlab.py"))
        return found[0] if found else root / "python" / f"{robot}_mjlab.py"

    def found(self, path: Path, reference: Reference) -> Table:
        """Patterns are those of the robot's bodies and joints."""
        tree = reference.tree
        names = Names({n: n for n in tree.by_body}, {j.name: j.name for j in tree.moving_joints})
        return _table(path, names).only(self.holds)

    def expected(self, reference: Reference) -> Table:
        """What mjlab must be told of this robot."""
        return expected_table(reference, self.robot)

    def read(self, path: Path) -> Table:
        """The facts of a module, by the names that it writes out; UsageError for no Python."""
        return _table(path, Names())


def _table(path: Path, names: Names) -> Table:
    module, book = Module.of_file(path), Writer()
    timestep, decimation = module.constant("TIMESTEP"), module.constant("DECIMATION")
    gravity = module.constant("GRAVITY")
    book.put(
        "simulation", "",
        {"timestep": timestep, "decimation": decimation, "gravity": gravity},
    )  # fmt: skip
    for name in ("XML", "ROOT_BODY", "IMU_SITE", "FOOT_SITES", "FOOT_GEOMS"):
        value = module.constant(name)
        book.put("robot", "", {f"{FORM}:{name}": _text(value)})
    robot = module.returned("robot_cfg")
    names = names if names.joints else _own_names(module, robot)
    groups: list[tuple[str, ...]] = []
    if isinstance(robot, Call):
        groups = _robot(robot, timestep, names, book, module.name)
    _by_joint(module, names, book)
    events = module.returned("randomize_events")
    if isinstance(events, dict):
        read_events(events, FORM, names, book, groups)
    put_words(module, FORM, book, READ)
    return with_task_facts(book).table()


def _text(value: object) -> Value:
    return value if isinstance(value, tuple | str) else str(value)


def _own_names(module: Module, robot: object) -> Names:
    """Joints that the module writes out, for patterns of a file without its robot."""
    listed: list[str] = list(texts(module.constant("JOINTS")))
    start = robot.fields.get("init_state") if isinstance(robot, Call) else None
    positions = start.fields.get("joint_pos") if isinstance(start, Call) else None
    if isinstance(positions, dict):
        listed += [unescaped(str(pattern)) for pattern in positions if is_name(str(pattern))]
    return Names({}, {name: name for name in listed})


# --- robot_cfg --------------------------------------------------------------------------------


def _robot(
    robot: Call, timestep: object, names: Names, book: Writer, where: str
) -> list[tuple[str, ...]]:
    """`EntityCfg`; returns the joints of each group of drives."""
    start, body = robot.take("init_state"), robot.take("articulation")
    said: dict[str, Value] = {f"{FORM}:robot_cfg": robot.name}
    said[f"{FORM}:spec_fn"] = _text(robot.take("spec_fn"))
    groups: list[tuple[str, ...]] = []
    if isinstance(start, Call):
        said[f"{FORM}:init_state"] = start.name
        _start(start, names, book, f"{where}:{start.line}")
        _left(start, "init_state", where, book)
    if isinstance(body, Call):
        said[f"{FORM}:articulation"] = body.name
        book.put("robot", "", {"soft limits": body.take("soft_joint_pos_limit_factor")})
        drives = body.take("actuators")
        listed = drives if isinstance(drives, tuple) else ()
        groups = [_drive(drive, timestep, names, book, where) for drive in listed]
        for number, joints in enumerate(groups):
            for joint in joints:
                book.put("joint", joint, {f"{FORM}:group": number})
        _left(body, "articulation", where, book)
    book.put("robot", "", said)
    _left(robot, "robot_cfg", where, book)
    return groups


def _start(start: Call, names: Names, book: Writer, where: str) -> None:
    pos, rot = start.take("pos"), start.take("rot")
    if is_vector(pos) and is_vector(rot):
        length = math.hypot(*rot)  # of another one than 1 engines make what they like
        book.put("robot", "", {"start pose": (*pos, *rot), f"{FORM}:length of rot": length})
    for field, quantity in (("joint_pos", "start"), ("joint_vel", f"{FORM}:start velocity")):
        for joint, value in spread(start.take(field), "joint", names, book, where):
            book.put("joint", joint, {quantity: value})


def _drive(
    drive: object, timestep: object, names: Names, book: Writer, where: str
) -> tuple[str, ...]:
    """One group: its numbers are those of each of its joints."""
    if not isinstance(drive, Call):
        book.skip(where, "actuators", drive)
        return ()
    place = f"{where}:{drive.line}"
    patterns = texts(drive.take("target_names_expr"))
    joints = tuple(dict.fromkeys(name for p in patterns for name in names.of(p, "joint")))
    facts: dict[str, Value] = {"model": MODELS.get(drive.name, drive.name)}
    for field, quantity in DRIVE.items():
        if field in drive.fields or field in ALWAYS:
            facts[quantity] = drive.take(field)
    if facts["model"] == "motor" and facts.get("effort") == UNLIMITED:
        facts["effort"] = None
    lags = [drive.take(f"delay_{end}_lag") for end in ("min", "max")]
    if isinstance(timestep, int | float) and is_vector(tuple(lags)):
        facts["delay"] = tuple(lag * timestep for lag in lags)
    elif lags != [None, None]:
        book.skip(place, "delay", lags)
    _left(drive, f"actuator of {', '.join(patterns)}", where, book)
    for number, joint in enumerate(joints):
        if ("joint", joint) in book.places:
            book.skip(place, f"joint {joint} again", drive.name)
            continue
        book.put("joint", joint, facts | {f"{FORM}:place in its group": number})
        book.place("joint", joint, place)
    return joints


def _left(call: Call, what: str, where: str, book: Writer) -> None:
    """What nobody asked for has no known meaning."""
    for name, value in call.left():
        for path, leaf in flat(value, name):
            book.skip(f"{where}:{call.line} {what}", path, leaf)


# --- constants and the task -------------------------------------------------------------------


def _by_joint(module: Module, names: Names, book: Writer) -> None:
    scale = spread(module.constant("ACTION_SCALE"), "joint", names, book, "ACTION_SCALE")
    for joint, value in scale:
        book.put("joint", joint, {f"{FORM}:action scale": value})
    for name in ("JOINTS", "KNEES"):
        for number, joint in enumerate(texts(module.constant(name))):
            book.put("joint", joint, {f"{FORM}:place in {name}": number})
    spreads = module.constant("POSE_SPREAD")
    for name, value in _items(spreads):
        book.put("robot", "", {f"{FORM}:{name}": value})


def _items(table: object) -> Iterator[tuple[str, Any]]:  # Any: a value of `syntax`
    yield from table.items() if isinstance(table, dict) else ()
