"""A key that gets another value changes each format's facts, or the format says why it cannot."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tiny import TinyRobot, tiny_quadruped, write_robot_ports

from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.table import Key
from assetbuild.plugins import load_plugin, plugin_names
from assetbuild.robot.contact import Contact
from assetbuild.robot.sections import Simulation

READERS = {name: load_plugin(Reader, name) for name in plugin_names(Reader)}
OPTIONS = {"feet": {"links": ".*_foot"}, "imu": {"link": "trunk"}, "xrdf": {"max_spheres": 1}}
OTHER: dict[str, Any] = {
    "contact.condim": 6,
    "contact.solref": (0.01, 0.9),
    "contact.solimp": (0.8, 0.9, 0.002, 0.4, 3.0),
}
ELSEWHERE = {
    "bare joint": "mjlab's configuration drives the joints",
    "mjx shape mask": "its pairs are listed",
    "mjlab joint velocity": "mjlab's PD drives have no limit of speed",
}
"""Format and row -> why its reader, which holds the row of other robots, says nothing here."""
KEYS = [
    *(f"simulation.{key}" for key in Simulation.model_fields),
    *(f"contact.{key}" for key in Contact.model_fields),
    *(f"actuator.{key}" for key in ("kp", "kd", "effort", "velocity", "armature", "friction",
                                    "damping")),
]  # fmt: skip


def with_other(robot: TinyRobot, key: str) -> TinyRobot:
    section, _, name = key.partition(".")
    control = robot.control
    if section == "actuator":
        rows = tuple(replace(r, **{name: other(key, getattr(r, name))}) for r in control.actuators)
        return replace(robot, control=replace(control, actuators=rows))
    model = getattr(control, section)
    changed = model.model_copy(update={name: other(key, getattr(model, name))})
    # Feet have contacts of their own, which do not follow the robot's.
    return replace(robot, control=replace(control, **{section: changed}, contacts=()))


def other(key: str, value: Any) -> Any:
    """A value that is not the one there."""
    if key in OTHER:
        return OTHER[key]
    if isinstance(value, tuple):
        return tuple(0.5 * part + 0.25 for part in value)
    return 2 * value + 1 if isinstance(value, int) else 0.5 * (value or 0.0) + 0.004


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Reference:
    robot = tiny_quadruped()
    robot = replace(robot, control=replace(robot.control, contacts=()))
    return reference_of(tmp_path_factory.mktemp("plain"), robot)


def reference_of(folder: Path, robot: TinyRobot) -> Reference:
    return Reference.of_ports(write_robot_ports(folder, robot), OPTIONS)


def changed(before: dict[Key, object], after: dict[Key, object]) -> Iterator[Key]:
    yield from (key for key in {**before, **after} if before.get(key) != after.get(key))


@pytest.mark.parametrize("key", KEYS)
def test_each_format_holds_it_or_says_why_not(key: str, plain: Reference, tmp_path: Path):
    reference = reference_of(tmp_path, with_other(tiny_quadruped(), key))
    rows = {f"{k.kind} {k.quantity}" for k in changed(robot_table(plain).facts,
                                                      robot_table(reference).facts)}  # fmt: skip
    assert rows, "no fact of the robot depends on it"
    silent = []
    for name, reader in sorted(READERS.items()):
        before, after = (reader(robot="r").expected(one).facts for one in (plain, reference))
        unheld = [row for row in sorted(rows) if not is_said(name, reader, row)]
        if unheld and not any(changed(before, after)):
            silent.append((name, unheld))
    assert silent == []


def is_said(name: str, reader: type[Reader], row: str) -> bool:
    """Whether the format says why it goes without a row of the robot's facts."""
    kind = row.partition(" ")[0]
    return bool({row, kind} & {*reader.lacks} or {f"{name} {row}", f"{name} {kind}"} & {*ELSEWHERE})
