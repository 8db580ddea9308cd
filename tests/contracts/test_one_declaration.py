"""A key of `simulation` or `contact` is declared once, and nobody on its way can forget it.

From the recipe to the control data, into the MJCF, into the check that compares the two, and back
from an MJCF as a source: a new key fails here until each of them knows it. Every other format holds
the key, and the numbers of drives, or says why it cannot.
"""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest
from mjcfs import read
from robot_files import check_inputs, run_step, write_robot_ports
from tiny import TinyRobot, tiny_quadruped, with_control

from assetbuild.control.control import ControlStep
from assetbuild.control.source_control import StatedControl, join
from assetbuild.facts.reader import Reader
from assetbuild.facts.readers._mjcf import MjcfFacts
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.recipe_types import Model
from assetbuild.robot.contact import Contact, Contacts
from assetbuild.robot.files import RobotFiles, SourceControl
from assetbuild.robot.model import Actuator
from assetbuild.robot.sections import Simulation
from assetbuild.robot.sides import Side
from assetbuild.targets.mjcf import Mjcf

from .conftest import OPTIONS, READERS

NOT_IN_MJCF = {"simulation.decimation": "MuJoCo has no control step: the trainers' modules hold it"}
OTHER: dict[str, Any] = {
    "contact.condim": 6,
    "contact.solref": (0.01, 0.9),
    "contact.solimp": (0.8, 0.9, 0.002, 0.4, 3.0),
    "contact.priority": 3,
    "contact.contype": 5,
    "contact.conaffinity": 3,
}
"""Values that a rule of thumb would not find."""


def keys(model: type[Model], section: str) -> list[str]:
    return [f"{section}.{key}" for key in model.model_fields]


KEYS = [*keys(Simulation, "simulation"), *keys(Contact, "contact")]
IN_MJCF = [key for key in KEYS if key not in NOT_IN_MJCF]


def other(key: str, value: Any) -> Any:
    """A value that is not the default."""
    if key in OTHER:
        return OTHER[key]
    if isinstance(value, tuple):
        return tuple(0.5 * part + 0.25 for part in value)
    return type(value)(2 * value + 0.001) if isinstance(value, float) else 2 * value + 1


def with_other(robot: TinyRobot, *keys: str) -> TinyRobot:
    for key in keys:
        section, _, name = key.partition(".")
        if section == "actuator":
            drives = robot.control.actuators
            rows = tuple(replace(r, **{name: other(key, getattr(r, name) or 1.0)}) for r in drives)
            robot = with_control(robot, actuators=rows)
            continue
        model = getattr(robot.control, section)
        changed = model.model_copy(update={name: other(key, getattr(model, name))})
        robot = with_control(robot, **{section: changed})
    return robot


def test_the_recipe_s_values_arrive_in_the_control_data(tmp_path: Path):
    said: dict[str, dict[str, Any]] = {"simulation": {}, "contact": {}}
    models = {"simulation": Simulation(), "contact": Contacts()}
    for section, _, name in (key.partition(".") for key in KEYS):
        said[section][name] = other(f"{section}.{name}", getattr(models[section], name))
    step = ControlStep.model_validate({**said, "rows": ()})
    inputs = write_robot_ports(tmp_path / "in", tiny_quadruped())
    run_step(step, inputs, tmp_path / "out")
    control = RobotFiles(tmp_path / "out").control
    for section, values in said.items():
        for name, value in values.items():
            assert getattr(getattr(control, section), name) == value, name


def test_the_target_writes_all_and_the_reader_of_mjcf_reads_them(tmp_path: Path):
    robot = with_other(tiny_quadruped(), *IN_MJCF)
    inputs = check_inputs(tmp_path / "written", robot, Mjcf(robot="robot"), "mjcf")
    assert run_step(MjcfFacts(robot="robot"), inputs, tmp_path / "equal") == []
    text = (inputs / "mjcf/robot.xml").read_text()
    meshes = {
        f"assets__{path.stem}_obj": path.read_bytes() for path in inputs.rglob("mjcf/*/*.obj")
    }
    back = read(text, tmp_path / "back", **meshes).control
    for section, _, name in (key.partition(".") for key in IN_MJCF):
        written = getattr(getattr(robot.control, section), name)
        assert getattr(getattr(back, section), name) == pytest.approx(written), name


@pytest.mark.parametrize("key", IN_MJCF)
def test_the_recipe_wins_over_an_mjcf_where_it_states_the_key(key: str):
    robot, section = tiny_quadruped(), key.partition(".")[0]
    source = SourceControl(with_other(robot, key).control)
    own = robot.control
    for stated, winner in (((), source.control), ((key,), own)):
        sides = StatedControl((Side(from_mjcf=True, stated=stated),))
        joined, _ = join(own, source, robot.tree, robot.shapes, sides)
        name = key.partition(".")[2]
        assert getattr(getattr(joined, section), name) == getattr(getattr(winner, section), name)


NUMBERS = [field.name for field in fields(Actuator) if field.type in ("float", "float | None")]
UNSAID = {
    "stall": "of a DC motor alone",
    "gear": "of a motor with a gear in MuJoCo alone",
}
"""Numbers that say nothing of a plain PD drive."""
ELSEWHERE = {
    "bare joint": "mjlab's configuration drives the joints",
    "mjx shape contype": "its pairs are listed",
    "mjlab joint velocity": "mjlab's PD drives have no limit of speed",
}
"""Format and row -> why its reader, which holds the row of other robots, says nothing here."""


@pytest.fixture(scope="module")
def plain_facts(tmp_path_factory: pytest.TempPathFactory) -> Reference:
    return reference_of(tmp_path_factory.mktemp("facts"), tiny_quadruped())


@pytest.mark.parametrize("key", [*KEYS, *(f"actuator.{n}" for n in NUMBERS if n not in UNSAID)])
def test_each_format_holds_it_or_says_why_not(key: str, plain_facts: Reference, tmp_path: Path):
    reference = reference_of(tmp_path, with_other(tiny_quadruped(), key))
    before, after = (robot_table(one).facts for one in (plain_facts, reference))
    rows = {f"{k.kind} {k.quantity}" for k in {**before, **after} if before.get(k) != after.get(k)}
    assert rows, "no fact of the robot depends on it"
    for name, reader in READERS.items():
        unsaid = [row for row in rows if not is_said(name, reader, row)]
        read = reader(robot="r")
        is_other = read.expected(plain_facts).facts != read.expected(reference).facts
        assert is_other or not unsaid, (name, unsaid)


def is_said(name: str, reader: type[Reader], row: str) -> bool:
    """Whether the format says why it goes without a row of the robot's facts."""
    kind = row.partition(" ")[0]
    return bool({row, kind} & {*reader.lacks} or {f"{name} {row}", f"{name} {kind}"} & {*ELSEWHERE})


def reference_of(folder: Path, robot: TinyRobot) -> Reference:
    """Feet have contacts of their own, which would hide the robot's."""
    ports = write_robot_ports(folder, with_control(robot, contacts=()))
    return Reference.of_ports(ports, OPTIONS)
