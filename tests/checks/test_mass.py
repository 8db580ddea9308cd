"""Masses and collision against the geometry: each slip has a robot, a simplification is none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from robot_files import figures, laid_out, ranked, rules, run_step
from tiny import TinyRobot, box_inertial, box_obj, pendulum

from assetbuild.checks.coverage import Coverage, _length
from assetbuild.checks.mass import Mass
from assetbuild.findings import Finding
from assetbuild.mesh.solid import distance_to
from assetbuild.robot.model import Frame, Inertial
from assetbuild.robot.pose import Pose, Vec3
from assetbuild.robot.shapes import Box, Capsule, Geometry, Mesh, MeshAsset, Shape, Shapes

SIZE = (0.05, 0.04, 0.4)
WEIGHT = 0.05 * 0.04 * 0.4 * 1000.0
SOUND = box_inertial(WEIGHT, SIZE)


def robot(inertial: Inertial = SOUND, role: str = "visual", size: Vec3 = SIZE) -> TinyRobot:
    """A pendulum whose last body is a bar of water. inertial: the body's; size: the shape's."""
    base = pendulum()
    name = base.tree.bodies[-1].name
    bodies = (*base.tree.bodies[:-1], replace(base.tree.bodies[-1], inertial=inertial))
    shapes = Shapes((Shape("bar", name, role, Box(size)),))
    return replace(base, tree=replace(base.tree, bodies=bodies), shapes=shapes, meshes={})


def weighed(made: TinyRobot, folder: Path, **fields: object) -> list[Finding]:
    return run_step(Mass(**fields), laid_out(folder / "in", made), folder / "out")


def row_of(folder: Path) -> dict[str, Any]:
    """The figures of its one body."""
    (row,) = figures(folder / "out")["bodies"]
    return row


@pytest.mark.parametrize("role", ["visual", "collision"])
def test_a_bar_of_water_is_sound(role: str, tmp_path: Path):
    assert weighed(robot(role=role), tmp_path) == []
    row = row_of(tmp_path)
    assert row["density_kg_m3"] == pytest.approx(1000.0)
    assert row["long_axes_apart_rad"] == pytest.approx(0.0, abs=1e-6)


def test_a_body_whose_mesh_the_source_lacks_is_not_judged_by_the_rest(tmp_path: Path):
    """A trunk of 7 kg in a hull of 1e-6 litres: of it, only the box of its IMU was drawn."""
    made = robot()
    link = made.tree.bodies[-1].name
    chip = Shape("chip", "imu", "visual", Box((0.01, 0.01, 0.01)))
    shapes = Shapes((Shape("bar", link, "collision", Box(SIZE)), chip))
    tree = replace(made.tree, frames=(Frame("imu", link, Pose()),))
    made = replace(made, tree=tree, shapes=shapes)
    assert "mass.density" in rules(weighed(made, tmp_path / "whole"))
    assert weighed(made, tmp_path / "lacking", absent=("skin.obj",)) == []


@pytest.mark.parametrize(
    ("inertial", "rule", "measured"),
    [
        (box_inertial(10.0 * WEIGHT, SIZE), "mass.density", {}),
        (box_inertial(0.02 * WEIGHT, SIZE), "mass.density", {}),
        (box_inertial(WEIGHT, (0.05, 0.4, 0.04)), "mass.axes", {"angle_rad": np.pi / 2}),
        (replace(SOUND, com_m=(0.0, 0.3, 0.0)), "mass.center", {"outside_m": 0.28}),
    ],
    ids=["ten times", "a fiftieth", "a tensor in other axes", "a centre outside of the part"],
)
def test_what_cannot_be_the_inertia_of_a_bar_is_told(
    inertial: Inertial, rule: str, measured: dict[str, float], tmp_path: Path
):
    (finding,) = weighed(robot(inertial), tmp_path)
    assert finding.rule == rule
    assert {name: finding.data[name] for name in measured} == pytest.approx(measured)


def test_the_total_is_compared_with_the_datasheet(tmp_path: Path):
    total = sum(b.inertial.mass_kg for b in robot().tree.bodies if b.inertial)
    for factor, found in (
        (1.02, []),
        (1.1, [("mass.total", "warning")]),
        (2.0, [("mass.total", "error")]),
    ):
        assert ranked(weighed(robot(), tmp_path, total_kg=factor * total)) == found


def test_a_ball_has_no_long_direction_and_a_screw_is_too_small_to_judge(tmp_path: Path):
    flat = Inertial(WEIGHT, (0.0, 0.0, 0.0), (1e-3, 1e-3, 1e-3, 0.0, 0.0, 0.0))
    assert "mass.axes" not in rules(weighed(robot(flat), tmp_path / "a"))
    tiny = replace(SOUND, mass_kg=5e-3, com_m=(5.0, 0.0, 0.0))
    assert weighed(robot(tiny), tmp_path / "b") == []


def test_a_hand_of_a_hundred_tonnes_and_a_shoulder_of_175_m_are_errors(tmp_path: Path):
    """A density taken for a mesh in millimetres; a mesh in millimetres read in metres."""
    heavy = robot(replace(SOUND, mass_kg=264277.0))
    made = {finding.rule: finding for finding in weighed(heavy, tmp_path / "heavy")}
    assert made["mass.absurd"].severity == "error"
    assert "264277" in made["mass.absurd"].message or "2.643e+05" in made["mass.absurd"].message
    found = weighed(robot(size=(0.05, 0.04, 175.0)), tmp_path / "long")
    assert [f.severity for f in found if f.rule == "mass.size"] == ["error"]


def test_a_bolted_root_may_be_a_hall(tmp_path: Path):
    made = robot()
    hall = Shape("hall", made.tree.root, "visual", Box((90.0, 60.0, 12.0)))
    found = weighed(replace(made, shapes=Shapes((*made.shapes.shapes, hall))), tmp_path)
    assert "mass.size" not in rules(found)


@pytest.mark.parametrize(
    ("mass_kg", "says"),
    [(1e-5, "lighter than foam"), (2e-3, "lighter than foam"), (200.0, "heavier than any metal")],
)
def test_a_robot_of_no_matter_is_an_error(mass_kg: float, says: str, tmp_path: Path):
    """Masses of 1e-5 kg are placeholders: every drive and every simulation would be one, too."""
    made = weighed(robot(replace(SOUND, mass_kg=mass_kg)), tmp_path)
    (found,) = (finding for finding in made if finding.rule == "mass.absurd")
    assert says in found.message
    assert (found.severity, found.subject) == ("error", "robot")
    assert found.data["volume_m3"] == pytest.approx(8e-4)


# --- Collision against visual geometry: a shift is reported, a simplification is not ---


BAR = (0.05, 0.04, 0.3)


def covered(collision: Geometry, at: Vec3, folder: Path) -> list[Finding]:
    seen = Shape("v", "arm", "visual", Mesh("bar-1"))
    solid = Shape("c", "arm", "collision", collision, Pose(at))
    shapes = Shapes((seen, solid), (), (MeshAsset("bar-1", "bar-1.obj", 8, 12),))
    made = replace(pendulum(), shapes=shapes, meshes={"bar-1.obj": box_obj(BAR)})
    return run_step(Coverage(), laid_out(folder / "in", made), folder / "out")


@pytest.mark.parametrize("collision", [Box(BAR), Mesh("bar-1")])
def test_three_centimetres_are_told_with_their_direction(collision: Geometry, tmp_path: Path):
    (finding,) = covered(collision, (0.0, -0.03, 0.0), tmp_path)
    assert finding.rule == "coverage.shift"
    assert finding.data["shift_m"] == pytest.approx((0.0, -0.03, 0.0), abs=1e-9)
    assert " y " in finding.message
    assert row_of(tmp_path)["sticks_out_mm"] == pytest.approx(30.0)


def test_a_box_in_its_place_is_exact_and_a_shorter_or_thicker_one_a_simplification(
    tmp_path: Path,
):
    assert covered(Box(BAR), (0.0, 0.0, 0.0), tmp_path) == []
    assert row_of(tmp_path)["sticks_out_mm"] == pytest.approx(0.0, abs=1e-6)
    assert covered(Capsule(0.02, 0.2), (0.0, 0.0, 0.0), tmp_path / "a") == []
    assert covered(Box((0.1, 0.1, 0.35)), (0.0, 0.0, 0.0), tmp_path / "b") == []
    assert covered(Box((0.05, 0.04, 0.1)), (0.0, 0.0, 0.1), tmp_path / "c") == []


def test_points_in_one_plane_are_as_far_as_their_box():
    flat = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    points = np.array([[1.0, 0.5, 0.3], [5.0, 0.5, 4.0], [1.0, 0.5, 0.0]])
    assert distance_to(flat, Pose())(points) == pytest.approx([0.3, 5.0, 0.0])


def test_a_length_is_told_in_the_unit_of_its_size():
    """A collision mesh in millimetres lay `2e+03 mm` off."""
    lengths = (0.0274, 0.345, 0.9994, 2.03, 1350.0)
    assert [_length(v) for v in lengths] == ["27.4 mm", "345 mm", "999 mm", "2.03 m", "1350 m"]
