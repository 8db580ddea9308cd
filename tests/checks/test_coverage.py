"""Collision beside visual geometry: a shift is told, a simplification is not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiny import TinyRobot, box_obj, pendulum, run_step, write_robot_ports

from assetbuild.checks.coverage import Coverage, _length
from assetbuild.findings import Finding
from assetbuild.mesh.obj import obj_bytes
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.solid import distance_to
from assetbuild.mesh.triangles import merged
from assetbuild.robot.pose import Pose, Vec3
from assetbuild.robot.shapes import Box, Capsule, Geometry, Mesh, MeshAsset, Shape, Shapes

SIZE = (0.05, 0.04, 0.3)


def told(
    collision: Geometry, at: tuple[float, float, float], folder: Path, obj: bytes = box_obj(SIZE)
) -> list[Finding]:
    robot: TinyRobot = pendulum()
    link = robot.tree.bodies[-1].name
    asset = MeshAsset("bar-1", "bar-1.obj", 8, 12)
    shapes = Shapes(
        (
            Shape("v", link, "visual", Mesh("bar-1")),
            Shape("c", link, "collision", collision, Pose(at)),
        ),
        (),
        (asset,),
    )
    robot = replace(robot, shapes=shapes, meshes={"bar-1.obj": obj})
    return run_step(Coverage(), write_robot_ports(folder / "in", robot), folder / "out")


def test_a_box_in_its_place_is_quiet_and_exact(tmp_path: Path):
    assert told(Box(SIZE), (0.0, 0.0, 0.0), tmp_path) == []
    (row,) = json.loads((tmp_path / "out/figures.json").read_text())["bodies"]
    assert row["sticks_out_mm"] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("collision", [Box(SIZE), Mesh("bar-1")])
def test_three_centimetres_are_told_with_their_direction(collision: Geometry, tmp_path: Path):
    (finding,) = told(collision, (0.0, -0.03, 0.0), tmp_path)
    assert finding.rule == "coverage.shift"
    assert finding.data["shift_m"] == pytest.approx((0.0, -0.03, 0.0), abs=1e-9)
    assert " y " in finding.message
    (row,) = json.loads((tmp_path / "out/figures.json").read_text())["bodies"]
    assert row["sticks_out_mm"] == pytest.approx(30.0)


def test_a_length_is_told_in_the_unit_of_its_size():
    """A collision mesh in millimetres lay `2e+03 mm` off."""
    lengths = (0.0274, 0.345, 0.9994, 2.03, 1350.0)
    assert [_length(v) for v in lengths] == ["27.4 mm", "345 mm", "999 mm", "2.03 m", "1350 m"]


def test_a_shorter_and_a_thicker_shape_are_simplifications(tmp_path: Path):
    assert told(Capsule(0.02, 0.2), (0.0, 0.0, 0.0), tmp_path / "a") == []
    assert told(Box((0.1, 0.1, 0.35)), (0.0, 0.0, 0.0), tmp_path / "b") == []
    assert told(Box((0.05, 0.04, 0.1)), (0.0, 0.0, 0.1), tmp_path / "c") == []


def test_points_in_one_plane_are_as_far_as_their_box():
    flat = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    points = np.array([[1.0, 0.5, 0.3], [5.0, 0.5, 4.0], [1.0, 0.5, 0.0]])
    assert distance_to(flat, Pose())(points) == pytest.approx([0.3, 5.0, 0.0])


def frame_of_bars(parts: tuple[tuple[Vec3, Vec3], ...]) -> bytes:
    """An OBJ of boxes: (size, middle) each, m."""
    boxes = [tessellate(Box(size)).placed(Pose(at)) for size, at in parts]
    return obj_bytes(merged(boxes))


SIDES = (((0.02, 0.02, 0.2), (-0.06, 0.0, 0.0)), ((0.02, 0.02, 0.2), (0.06, 0.0, 0.0)))
TOP: tuple[Vec3, Vec3] = ((0.14, 0.02, 0.02), (0.0, 0.0, 0.09))
BOTTOM: tuple[Vec3, Vec3] = ((0.14, 0.02, 0.02), (0.0, 0.0, -0.09))


def test_a_hull_that_fills_a_hole_is_told_with_its_size_and_place(tmp_path: Path):
    ring = frame_of_bars((*SIDES, TOP, BOTTOM))
    (finding,) = told(Mesh("bar-1"), (0.0, 0.0, 0.0), tmp_path, ring)
    assert (finding.rule, finding.severity) == ("coverage.hole", "info")
    assert finding.data["area_m2"] == pytest.approx(0.10 * 0.16, rel=0.1)  # inside of the bars
    assert finding.data["middle_m"] == pytest.approx((0.0, 0.0, 0.0), abs=5e-3)
    assert np.abs(finding.data["direction"]) == pytest.approx((0.0, 1.0, 0.0), abs=1e-9)


def test_a_notch_and_a_hole_left_open_are_no_holes_filled(tmp_path: Path):
    notch = frame_of_bars((*SIDES, TOP))
    assert told(Mesh("bar-1"), (0.0, 0.0, 0.0), tmp_path / "a", notch) == []
    ring = frame_of_bars((*SIDES, TOP, BOTTOM))
    beside = told(Box(SIDES[0][0]), SIDES[0][1], tmp_path / "b", ring)
    assert [f.rule for f in beside if f.rule == "coverage.hole"] == []
