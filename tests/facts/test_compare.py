"""The comparison of two tables: what rounding explains, and what it does not."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from tiny import TinyRobot, pendulum, tiny_quadruped, with_mimic

from assetbuild.facts.compare import EXACT, FLOAT32, Precision, differences
from assetbuild.facts.reader import Lost, Reader
from assetbuild.facts.readers._usd import UsdReader
from assetbuild.facts.readers.urdf import UrdfFacts
from assetbuild.facts.reference import Assets, Reference, robot_table
from assetbuild.facts.surface import measure
from assetbuild.facts.table import Key, Table
from assetbuild.facts.vocabulary import Comparison
from assetbuild.robot.model import Camera, Control, Keyframe, Place, Sensor
from assetbuild.robot.pose import IDENTITY, Array, Pose
from assetbuild.robot.shapes import Shapes

STEP_M, ROWS = 3e-4, 150


def far_grille() -> Array:
    """(n, 3, 3) corners of many small triangles that lean, 26 cm from the origin, m."""
    u, v = np.meshgrid(np.arange(ROWS) * STEP_M, np.arange(ROWS) * STEP_M, indexing="ij")
    x = 0.26 + STEP_M * (np.arange(ROWS)[:, None] % 2)
    points = np.stack([np.broadcast_to(x, u.shape), u, v], axis=-1)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    return np.concatenate([np.stack([a, b, c], 2), np.stack([a, c, d], 2)]).reshape(-1, 3, 3)


def table_of(corners: Array) -> Table:
    facts = measure(corners).facts()
    return Table({Key("shape", "grille", quantity): value for quantity, value in facts.items()})


def test_small_triangles_far_out_keep_their_area_when_rounded_to_float32() -> None:
    exact, rounded = far_grille(), far_grille().astype(np.float32).astype(np.float64)
    relative = measure(rounded).area / measure(exact).area - 1.0
    assert abs(relative) > 10.0 * FLOAT32["length"]  # rounding is not small here
    assert differences(table_of(exact), table_of(rounded), Precision(FLOAT32)) == []


@pytest.mark.parametrize("tolerances", [EXACT, FLOAT32])
def test_an_area_off_by_a_thousandth_is_found(tolerances: Mapping[Comparison, float]) -> None:
    exact = table_of(far_grille())
    area = Key("shape", "grille", "area")
    more = (1.001 * measure(far_grille()).area,)
    (found,) = differences(exact, Table({**exact.facts, area: more}), Precision(tolerances))
    assert found.key == area


HALF = 0.5**0.5
ALONG_X, ABOUT_X = (HALF, 0.0, HALF, 0.0), (0.0, 1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("geometry", "turn", "same"),
    [
        ("sphere", ALONG_X, True),
        ("capsule", (HALF, 0.0, 0.0, HALF), True),
        ("cylinder", ABOUT_X, True),
        ("capsule", ALONG_X, False),
        ("box", ABOUT_X, False),
    ],
)
def test_a_round_shape_is_the_same_however_it_is_turned(
    geometry: str, turn: tuple[float, ...], same: bool
) -> None:
    """A quarter turn about its own axis, or end for end."""
    tables = [
        Table({
            Key("shape", "s", "geometry"): geometry,
            Key("shape", "s", "pose"): (0.1, 0.2, 0.3, *quat),
        })
        for quat in ((1.0, 0.0, 0.0, 0.0), turn)
    ]  # fmt: skip
    assert (differences(*tables, Precision()) == []) is same


def test_slivers_drawn_far_from_the_origin_of_their_file_keep_their_area_in_float32() -> None:
    """Spokes of 0.26 m by 0.01 mm about the origin of the body, 0.67 m from that of the file."""
    rng = np.random.default_rng(0)
    angle, wide = rng.uniform(0.0, np.pi, 16), np.tile((0.0, 0.0, 1e-5), (16, 1))
    along = 0.13 * np.stack([np.cos(angle), np.sin(angle), rng.uniform(-0.1, 0.1, 16)], 1)
    corners, middle = np.stack([-along, along, along + wide], 1), np.array((0.1, 0.1, 0.66))
    there = (corners + middle).astype(np.float32).astype(np.float64) - middle
    assert abs(measure(there).area / measure(corners).area - 1.0) > 10.0 * FLOAT32["length"]
    assert differences(table_of(corners), table_of(there), Precision(FLOAT32)) == []


def test_a_part_drawn_far_from_the_origin_of_its_file_is_the_same_in_float32() -> None:
    """A cap of 0.3 mm, 0.37 m from the origin of its file and 0.3 mm from that of its body."""
    rng = np.random.default_rng(4)
    corners = rng.uniform(-1.5e-4, 1.5e-4, (40, 3, 3)) + np.array((0.3, 0.2, 0.1))
    back = Pose((-0.3003, -0.2, -0.1))
    exact, rounded = (
        measure(points).moved(back)
        for points in (corners, corners.astype(np.float32).astype(np.float64))
    )
    tables = [
        Table({Key("shape", "cap", q): v for q, v in one.facts().items()})
        for one in (exact, rounded)
    ]
    assert differences(*tables, Precision(FLOAT32)) == []
    size = 1.5e-4
    moved = Key("shape", "cap", "mean corner")
    off = tuple(v + 1e-2 * size for v in tables[1].facts[moved])  # type: ignore[union-attr] # a vector
    assert differences(tables[0], Table({**tables[1].facts, moved: off}), Precision(FLOAT32))


# --- losses --------------------------------------------------------------------------------------


def table(robot: TinyRobot, control: Control) -> Table:
    """All facts but those of the shapes."""
    return robot_table(Reference(robot.tree, robot.tree, Shapes(), control, Assets(), {}))


SENSING = Control(
    sensors=(
        Sensor("gyro", "gyro", Place("frame", "arm")),
        Sensor("push", "touch", Place("frame", "arm")),
    ),
    cameras=(Camera("eye", "arm", IDENTITY), Camera("chase", None, IDENTITY, tracking="trackcom")),
    keyframes=(Keyframe("home", (("swing_joint", 0.1),)), Keyframe("up", (("swing_joint", 3.0),))),
)


@pytest.mark.parametrize(
    ("control", "urdf", "usd"),
    [
        (Control(), {"simulation": 1}, {}),
        (SENSING, {"sensor": 2, "camera": 2, "keyframe": 2, "simulation": 1},
         {"sensor": 2, "camera": 1}),
        (pendulum().control, {"joint": 1, "keyframe": 1, "simulation": 1}, {}),
    ],
    ids=["nothing beyond the tree", "senses and poses", "a drive and a pose"],
)  # fmt: skip
def test_what_a_format_goes_without_is_counted(
    control: Control, urdf: Mapping[str, int], usd: Mapping[str, int]
):
    """The expected numbers are the robot's own: how many sensors, cameras and poses it states."""
    facts = table(pendulum(), control)
    for reader, expected in ((UrdfFacts, urdf), (UsdReader, usd)):
        found = list(reader.losses(facts))
        assert [(f.rule, f.severity, f.data) for f in found] == (
            [(f"lost.{reader.format_id}", "info", expected)] if expected else []
        )


@pytest.mark.parametrize(
    ("lacks", "simulated", "severity"),
    [
        ({"joint mimics": Lost("none")}, True, "error"),
        ({"joint mimics": Lost("none")}, False, "warning"),
        ({"joint upper": Lost("none")}, True, "error"),
        ({"joint kp": Lost("none")}, True, "info"),
        ({"joint mimics": "in other words"}, True, None),
        ({"joint": Lost("none")}, True, "error"),
        ({}, True, None),
    ],
)
def test_a_lost_motion_is_an_error_where_robots_are_simulated(
    lacks: Mapping[str, str], simulated: bool, severity: str | None
):
    robot = with_mimic(tiny_quadruped(), "FL_hip_joint", "FR_hip_joint", -1.0, 0.1)
    fields = {"format_id": "x", "display_name": "an X", "lacks": lacks, "simulated": simulated}
    found = list(type("ReadsX", (Reader,), fields).losses(table(robot, robot.control)))
    assert [(f.rule, f.severity) for f in found] == ([("lost.x", severity)] if severity else [])
