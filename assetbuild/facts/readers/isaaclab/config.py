"""What an Isaac Lab configuration says: our modules in full, anybody's as far as it is plain."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from assetbuild.errors import UsageError
from assetbuild.facts.readers.isaaclab.said import (
    FORM,
    IMPLICIT,
    KNOWN,
    LIMITS,
    READ,
    SELF_COLLISIONS,
    Generation,
    model_of,
)
from assetbuild.facts.statements import put_words
from assetbuild.facts.syntax import Call, Module, flat, is_vector
from assetbuild.facts.table import Table, Value, Writer
from assetbuild.facts.trainers import Names, is_name, read_events, spread, texts, unescaped

CONFIG = "ArticulationCfg"
DRIVE = {
    "stiffness": "kp",
    "damping": "kd",
    "armature": "armature",
    "friction": "friction",
    "viscous_friction": "damping",
    "saturation_effort": "stall",
}
"""Fields of a drive -> quantities, in both generations."""
LEFT_TO_THE_USD = ("stiffness", "damping", "armature", "friction", "viscous_friction")
"""What is not written here Isaac Lab leaves as it stands in the USD."""
FOREIGN: Mapping[str, tuple[str, ...]] = {
    "kp": ("stiffness",),
    "kd": ("damping",),
    "armature": ("armature",),
    "effort": ("effort_limit_sim", "joint_effort_limit", "effort_limit", "actuator_effort_limit"),
    "velocity": (
        "velocity_limit_sim", "joint_velocity_limit", "velocity_limit", "actuator_velocity_limit",
    ),
}  # fmt: skip
"""Quantities of anybody's configuration -> fields that state them, both generations.

No friction: what its number means depends on the generation and the simulator.
"""


def read_module(module: Module, generation: Generation, names: Names) -> Writer:
    """All facts and words of one of our modules."""
    book = Writer()
    configs = _configs(module)
    name = next(iter(configs), "")
    config = configs.get(name)
    timestep = module.constant("DT")
    options = {
        "timestep": timestep,
        "decimation": module.constant("DECIMATION"),
        "gravity": module.constant("GRAVITY"),
    }
    book.put("simulation", "", options)
    paths = {"USD": str(module.constant("USD"))}
    for said in ("SIMULATION_CFG", "NEWTON_CFG")[: generation - 1]:
        paths |= dict(flat(module.constant(said), said))  # type: ignore[arg-type] # values of a table
    book.put("robot", "", {f"{FORM}:{path}": value for path, value in paths.items()})
    if config is not None:
        drives = config.take("actuators")
        groups = list(drives.items()) if isinstance(drives, dict) else []
        names = names if names.joints else _own_names(groups)
        _spawn(config.take("spawn"), book, module.name)
        _start(config.take("init_state"), generation, names, book, module.name)
        soft = config.take("soft_joint_pos_limit_factor")
        book.put("robot", "", {"soft limits": soft, f"{FORM}:config": config.name})
        for group, drive in groups:
            _drive(str(group), drive, generation, timestep, names, book, module.name)
        _left(config, name, module.name, book)
    events = module.attributes("EventCfg")
    if events is not None:
        read_events(events, FORM, names, book)
    put_words(module, FORM, book, (*READ, name), part=str(generation))
    return book


def _configs(module: Module) -> dict[str, Call]:
    values = {
        name: module.value(node)
        for name, node in module.known.items()
        if isinstance(node, ast.Call) and ast.unparse(node.func).rsplit(".", 1)[-1] == CONFIG
    }
    return {name: value for name, value in values.items() if isinstance(value, Call)}


def _own_names(groups: list[tuple[str, object]]) -> Names:
    patterns = [p for _, drive in groups if isinstance(drive, Call)
                for p in texts(drive.fields.get("joint_names_expr"))]  # fmt: skip
    plain = [unescaped(pattern) for pattern in patterns if is_name(pattern)]
    return Names({}, {name: name for name in plain})


def _spawn(spawn: object, book: Writer, where: str) -> None:
    for path, value in flat(spawn, "spawn"):
        last = path.rpartition(".")[2].partition("[")[0]
        if last == SELF_COLLISIONS:
            book.put("robot", "", {"self-collision": value})
        elif last in KNOWN or path == "spawn":
            book.put("robot", "", {f"{FORM}:{path}": value})
        else:
            book.skip(where, path, value)


def _start(start: object, generation: Generation, names: Names, book: Writer, where: str) -> None:
    if not isinstance(start, Call):
        book.skip(where, "init_state", start)
        return
    book.put("robot", "", {f"{FORM}:init_state": start.name})
    pose = _pose(start.take("pos"), start.take("rot"), generation)
    length = math.hypot(*pose[3:]) if pose else None  # of another one than 1 PhysX refuses it
    book.put("robot", "", {"start pose": pose, f"{FORM}:length of rot": length})
    for field, quantity in (("joint_pos", "start"), ("joint_vel", f"{FORM}:start velocity")):
        for joint, value in spread(start.take(field), "joint", names, book, where):
            book.put("joint", joint, {quantity: value})
    _left(start, "init_state", where, book)


def _pose(pos: object, rot: object, generation: Generation) -> tuple[float, ...] | None:
    """(x, y, z, w, x, y, z); Isaac Lab's own start is the origin, unturned."""
    place = pos if is_vector(pos) else (0.0, 0.0, 0.0)
    identity = (1.0, 0.0, 0.0, 0.0)
    turn = rot if is_vector(rot) else identity
    if not (isinstance(place, tuple) and isinstance(turn, tuple)):
        return None
    if generation == 3 and turn is not identity:
        turn = (*turn[-1:], *turn[:-1])
    return (*place, *turn)


def _drive(
    group: str,
    drive: object,
    generation: Generation,
    timestep: object,
    names: Names,
    book: Writer,
    where: str,
) -> None:
    """One group: its numbers are those of each of its joints."""
    if not isinstance(drive, Call):
        book.skip(where, f"actuators.{group}", drive)
        return
    place = f"{where}:{drive.line}"
    patterns = texts(drive.take("joint_names_expr"))
    joints = dict.fromkeys(name for p in patterns for name in names.of(p, "joint"))
    facts: dict[str, Value] = {
        quantity: drive.take(field)
        for field, quantity in DRIVE.items()
        if field in drive.fields or field in LEFT_TO_THE_USD
    }
    facts["model"] = model_of(drive.last, facts.get("kp"), facts.get("kd"))
    facts |= {f"{FORM}:actuator": drive.name, f"{FORM}:group": group}
    effort, velocities = LIMITS[generation, drive.last == IMPLICIT]
    facts["effort"], facts["velocity"] = drive.take(effort), drive.take(velocities[0])
    for field in (*velocities[1:], "dynamic_friction"):
        facts[f"{FORM}:{field}"] = drive.take(field)
    steps = (drive.take("min_delay"), drive.take("max_delay"))
    if is_vector(steps) and isinstance(timestep, int | float):
        facts["delay"] = tuple(step * timestep for step in steps)
    elif steps == (None, None):
        facts["delay"] = (0.0, 0.0)
    else:
        book.skip(place, "delay", steps)
    _left(drive, f"actuators.{group}", where, book)
    for number, joint in enumerate(joints):
        if ("joint", joint) in book.places:
            book.skip(place, f"joint {joint} again", group)
            continue
        book.put("joint", joint, facts | {f"{FORM}:place in its group": number})
        book.place("joint", joint, place)


def _left(call: Call, what: str, where: str, book: Writer) -> None:
    """What nobody asked for has no known meaning."""
    for name, value in call.left():
        for path, leaf in flat(value, name):
            book.skip(f"{where}:{call.line} {what}", path, leaf)


# --- anybody's configuration ------------------------------------------------------------------


def read_config(path: Path, name: str, joints: Collection[str]) -> Table:
    """Facts of the configuration `name` in a Python file; "" = the only one.

    Only what stands there in plain is a fact; what is left to the USD (`None`, or not written) is
    none. joints: names that its patterns are meant for, of the robot that it is compared with;
    empty = the patterns themselves are the subjects. UsageError for a file that is no Python, or
    without that configuration.
    """
    module = Module.of_file(path)
    configs = _configs(module)
    if not configs:
        raise UsageError(
            f"`{path}` has no `NAME = ArticulationCfg(...)`",
            hint="give the file that writes it out; `CFG.replace(...)` is not followed",
        )
    if name not in configs and (name or len(configs) > 1):
        raise UsageError(
            f"`{path}` has {', '.join(f'`{n}`' for n in configs)}",
            hint=f"say which: `{path}:{next(iter(configs))}`",
        )
    config, book = configs[name or next(iter(configs))], Writer()
    groups = config.take("actuators")
    for drive in groups.values() if isinstance(groups, dict) else ():
        if isinstance(drive, Call):
            for pattern in texts(drive.fields.get("joint_names_expr")):
                for joint in _matching(pattern, joints):
                    book.put("joint", joint, dict(_plain_drive(drive, joint)))
    start = config.take("init_state")
    if isinstance(start, Call):
        _plain_start(start, _generation(module), joints, book)
    return book.table()


def _generation(module: Module) -> Generation:
    """Only 3.x has packages for each engine, and limits of joints beside those of actuators."""
    for node in ast.walk(module.tree):
        match node:
            case ast.ImportFrom(module=str(package)):
                if package.startswith(("isaaclab_physx", "isaaclab_newton")):
                    return 3
            case ast.keyword(arg="joint_effort_limit" | "joint_velocity_limit"):
                return 3
    return 2


def _plain_drive(drive: Call, joint: str) -> Iterator[tuple[str, Value]]:
    found: dict[str, Value] = {}
    for quantity, fields in FOREIGN.items():
        numbers = (_number_for(joint, drive.fields.get(field)) for field in fields)
        number = next((n for n in numbers if n is not None), None)
        if number is not None:
            found[quantity] = number
    # A gain that does not stand here is some gain.
    yield "model", model_of(drive.last, found.get("kp", 1.0), found.get("kd", 1.0))
    yield from found.items()


def _plain_start(
    start: Call, generation: Generation, joints: Collection[str], book: Writer
) -> None:
    pos, rot = start.take("pos"), start.take("rot")
    if is_vector(pos) and len(pos) == 3 and (rot is None or (is_vector(rot) and len(rot) == 4)):
        book.put("robot", "", {"start pose": _pose(pos, rot, generation)})
    positions = start.take("joint_pos")
    if isinstance(positions, dict):
        for joint in joints or map(str, positions):  # Isaac Lab starts the others at 0
            book.put("joint", joint, {"start": _number_for(joint, positions) or 0.0})


def _number_for(joint: str, value: Any) -> float | None:  # Any: a value of `syntax`
    """A number for all joints, or that of the last pattern that matches this one."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    found = None
    for pattern, number in value.items() if isinstance(value, dict) else ():
        is_number = isinstance(number, int | float) and not isinstance(number, bool)
        if is_number and (pattern == joint or _matching(str(pattern), (joint,))):
            found = float(number)
    return found


def _matching(pattern: str, joints: Collection[str]) -> list[str]:
    if not joints:
        return [pattern]
    try:
        return [joint for joint in joints if re.fullmatch(pattern, joint)]
    except re.error:
        return []
