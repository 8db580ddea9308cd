"""Isaac Lab's words for drives and starts, and configurations of it that anybody wrote."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Literal

from assetbuild.errors import UsageError
from assetbuild.facts.standins import Record, class_of, recorded, table_of, words_of
from assetbuild.facts.table import Table, Value
from assetbuild.facts.trainers import matching, number_of, put_start

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
        for joint in matching(drive_patterns, names) if joints else drive_patterns:
            facts.put("joint", joint, drive_facts(drive, joint, FOREIGN))
    put_start(start, quat_of(start, _generation(record, config)), FORM, names, facts)
    return facts


def _generation(record: Record, config: Record) -> Generation:
    """Only 3.x has packages for each engine, and limits of joints beside those of actuators."""
    fields = {field for drive, _ in drives_of(config) for field in drive}
    is_3 = any(module.startswith(ONLY_3) for module in record["imports"])
    return 3 if is_3 or {"joint_effort_limit", "joint_velocity_limit"} & fields else 2


def drive_facts(drive: Record, joint: str, fields: Mapping[str, str]) -> dict[str, Value]:
    """What it states as numbers, and its model. fields: of a drive -> quantities."""
    quantities: dict[str, Value] = {}
    for field, quantity in fields.items():
        number = number_of(drive.get(field), joint)
        if number is not None:
            quantities.setdefault(quantity, number)
    # A gain that does not stand here is some gain.
    model = model_of(class_of(drive), quantities.get("kp", 1.0), quantities.get("kd", 1.0))
    return quantities | {"model": model}
