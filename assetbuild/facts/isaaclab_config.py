"""Isaac Lab's words for drives and starts, and configurations of it that anybody wrote."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

from assetbuild.errors import UsageError
from assetbuild.facts.standins import Record, class_of, recorded, table_of, words_of
from assetbuild.facts.table import Table, Value, Writer
from assetbuild.facts.trainers import matching

Generation = Literal[2, 3]
CONFIG = "ArticulationCfg"
IMPLICIT = "ImplicitActuatorCfg"
DRIVE = {
    "stiffness": "kp",
    "damping": "kd",
    "armature": "armature",
    "friction": "friction",
    "viscous_friction": "damping",
    "saturation_effort": "stall",
}
"""Fields of a drive -> quantities, in both generations."""
LIMITS: dict[tuple[int, bool], tuple[str, tuple[str, ...]]] = {
    (2, True): ("effort_limit_sim", ("velocity_limit_sim",)),
    (2, False): ("effort_limit", ("velocity_limit", "velocity_limit_sim")),
    (3, True): ("joint_effort_limit", ("joint_velocity_limit",)),
    (3, False): ("actuator_effort_limit", ("actuator_velocity_limit", "joint_velocity_limit")),
}
"""(generation, whether the simulator integrates the drive) -> (effort, velocities): the first
velocity is the drive's own, the second the simulator's."""
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
ONLY_3 = ("isaaclab_physx", "isaaclab_newton")
"""Packages that only 3.x has."""


def model_of(kind: str, kp: object, kd: object) -> str:
    """The model of the table: a drive without gains makes the effort that it is told, or none."""
    if kind == "DCMotorCfg":
        return "dc_motor"
    if kind in ("IdealPDActuatorCfg", "DelayedPDActuatorCfg"):
        return "ideal_pd" if kp or kd else "motor"
    if kind == IMPLICIT:
        return "pd" if kp else "velocity" if kd else "passive"
    return kind


def quat_of(start: Record, generation: Generation) -> list[float]:
    """w, x, y, z of an `InitialStateCfg`; unturned where it states none."""
    if "rot" not in start:
        return [1.0, 0.0, 0.0, 0.0]
    turn: list[float] = start["rot"]
    return turn if generation == 2 else [*turn[-1:], *turn[:-1]]


def read_config(path: Path, name: str, joints: Collection[str]) -> Table:
    """Facts of the configuration `name` in a Python file; "" = the only one.

    The file is executed with stand-ins for all that it imports. Only what it states as a number is
    a fact; what is left to the USD (`None`, or not written) is none. joints: names that its
    patterns are meant for, of the robot that it is compared with; empty = the patterns themselves
    are the subjects. UsageError for a file that fails, or without that configuration.
    """
    record, book = recorded(path), Writer()
    config = _chosen(record, path, name)
    for drive in table_of(config.get("actuators")).values():
        for pattern in words_of(table_of(drive).get("joint_names_expr")):
            for joint in _subjects(pattern, joints):
                book.put("joint", joint, dict(_plain_drive(drive, joint)))
    _plain_start(table_of(config.get("init_state")), _generation(record, config), joints, book)
    return book.table()


def _chosen(record: Record, path: Path, name: str) -> Record:
    configs = {key: value for key, value in record.items() if class_of(value) == CONFIG}
    if not configs:
        raise UsageError(f"`{path}` has no `NAME = {CONFIG}(...)`")
    if name not in configs and (name or len(configs) > 1):
        raise UsageError(
            f"`{path}` has {', '.join(f'`{n}`' for n in configs)}",
            hint=f"say which: `{path}:{next(iter(configs))}`",
        )
    found: Record = configs[name or next(iter(configs))]
    return found


def _generation(record: Record, config: Record) -> Generation:
    """Only 3.x has packages for each engine, and limits of joints beside those of actuators."""
    drives = [table_of(drive) for drive in table_of(config.get("actuators")).values()]
    is_3 = any(module.startswith(ONLY_3) for module in record["imports"]) or any(
        {"joint_effort_limit", "joint_velocity_limit"} & drive.keys() for drive in drives
    )
    return 3 if is_3 else 2


def _subjects(pattern: str, joints: Collection[str]) -> list[str]:
    return matching([pattern], {joint: joint for joint in joints}) if joints else [pattern]


def _plain_drive(drive: Record, joint: str) -> Iterator[tuple[str, Value]]:
    """What it states as numbers, and its model."""
    found: dict[str, Value] = {}
    for quantity, fields in FOREIGN.items():
        numbers = (_number(drive.get(field), joint) for field in fields)
        number = next((n for n in numbers if n is not None), None)
        if number is not None:
            found[quantity] = number
    # A gain that does not stand here is some gain.
    yield "model", model_of(class_of(drive), found.get("kp", 1.0), found.get("kd", 1.0))
    yield from found.items()


def _plain_start(
    start: Record, generation: Generation, joints: Collection[str], book: Writer
) -> None:
    """Where the root starts, and the joints: those that it does not name at 0."""
    pos = start.get("pos")
    if isinstance(pos, list) and len(pos) == 3:
        book.put("robot", "", {"start pose": (*pos, *quat_of(start, generation))})
    positions = start.get("joint_pos")
    if isinstance(positions, dict):
        for joint in joints or positions:
            book.put("joint", joint, {"start": _number(positions, joint) or 0.0})


def _number(value: Any, joint: str) -> float | None:  # Any: JSON
    """A number for all joints, or that of the last pattern that matches this one."""
    if isinstance(value, dict):
        own = [v for p, v in value.items() if p == joint or matching([p], {joint: joint})]
        return _number(own[-1], joint) if own and not isinstance(own[-1], dict) else None
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if is_number else None
