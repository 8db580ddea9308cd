"""Every quantity of the vocabulary is compared in each format, or the format says why not."""

from __future__ import annotations

from dataclasses import replace

import pytest
from tiny import TinyRobot, four_bar, pendulum, tiny_quadruped, with_mimic, write_robot_ports

from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.table import Key
from assetbuild.facts.vocabulary import VOCABULARY, Required
from assetbuild.plugins import load_plugin, plugin_names
from assetbuild.robot.model import Camera, General, Place, Sensor
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Material

READERS = {name: load_plugin(Reader, name) for name in plugin_names(Reader)}
OPTIONS = {"feet": {"links": ".*_foot"}, "imu": {"link": "trunk"}, "xrdf": {"max_spheres": 1}}


def rich() -> list[TinyRobot]:
    """Robots that have everything between them."""
    robot = tiny_quadruped()
    control = robot.control
    drives = [replace(row, stall=30.0) if hasattr(row, "stall") else row
              for row in control.actuators]  # fmt: skip
    models = ("velocity", "motor", "dc_motor", "ideal_pd")
    drives[:4] = [replace(row, model=m) for row, m in zip(drives, models, strict=False)]
    general = General(gainprm=(3.0,), dyntype="filter", dynprm=(0.1,))
    drives[4] = replace(drives[4], model="general", general=general, name="fifth")
    senses = (Sensor("gyro", "gyro", Place("frame", "trunk"), None, 1.0, 0.1),)
    cameras = (Camera("eye", "trunk", Pose()),)
    full = replace(control, actuators=tuple(drives), sensors=senses, cameras=cameras)
    shapes = replace(robot.shapes, materials=(Material("red", (1.0, 0.0, 0.0, 1.0)),))
    worn = tuple(replace(s, material="red") if s.role == "visual" else s for s in shapes.shapes)
    whole = replace(robot, control=full, shapes=replace(shapes, shapes=worn))
    follower, leader = (joint.name for joint in robot.tree.moving_joints[1:3])
    led = with_mimic(robot, follower, leader, -2.0, 0.1)
    return [whole, pendulum(), replace(led, links=led.tree), four_bar("weld")]


@pytest.fixture(scope="module")
def references(tmp_path_factory: pytest.TempPathFactory) -> list[Reference]:
    """Of those robots."""
    folder = tmp_path_factory.mktemp("rich")
    return [
        Reference.of_ports(write_robot_ports(folder / str(i), robot), OPTIONS)
        for i, robot in enumerate(rich())
    ]


ONLY_OF_MESHES = frozenset(
    {"triangles", "area", "volume", "mean corner", "corner moments", "texture corners", "texture",
     "normals"}
)  # fmt: skip
"""The tiny robots here are of primitives; the readers' own tests have meshes."""


@pytest.mark.parametrize("name", READERS)
def test_a_reader_expects_a_quantity_or_says_why_its_format_lacks_it(
    name: str, references: list[Reference]
):
    kind = READERS[name]
    expected = {
        (key.kind, key.quantity)
        for reference in references
        for key in kind(robot="robot", options=dict(OPTIONS)).expected(reference).facts
    }
    held = {
        (k, q)
        for (k, q), quantity in VOCABULARY.items()
        if kind.holds(Key(k, "", q))
        and q not in ONLY_OF_MESHES
        # Where a default is a value, a file that says another differs from it.
        and (quantity.unstated is None or isinstance(quantity.unstated, Required))
    }
    assert held - expected == set(), "compared by nobody: expect it, or list it in `lacks`"


@pytest.mark.parametrize("name", READERS)
def test_what_a_format_lacks_is_a_quantity_with_a_reason(name: str):
    kinds = {kind for kind, _ in VOCABULARY}
    for lacking, reason in READERS[name].lacks.items():
        kind, _, quantity = lacking.partition(" ")
        assert (kind, quantity) in VOCABULARY or lacking in kinds, lacking
        assert reason, lacking


def test_the_robot_s_table_uses_the_vocabulary_alone(references: list[Reference]):
    for reference in references:
        for merged in (True, False):
            for key in robot_table(reference, merged=merged).facts:
                assert (key.kind, key.quantity) in VOCABULARY, key
