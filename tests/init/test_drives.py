"""Gains and the home pose that `init` proposes: they hold the robot and do not creep."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import urdfs

from assetbuild.init.anatomy import study
from assetbuild.init.drives import MOST_DAMPED, SAG, DriveRow, drive_rows
from assetbuild.init.home import HEAVY, home_pose
from assetbuild.init.look import InspectedRobot, judge, look
from assetbuild.init.sections import urdf_recipe
from assetbuild.init.source import find_source
from assetbuild.robot.dynamics import dynamics
from assetbuild.robot.model import Base


def arm(
    folder: Path, links: list[tuple[float, float]], base: Base = "fixed", **limits: float
) -> InspectedRobot:
    """A chain that reaches along x from a base. links: (mass, distance of its centre)."""
    said = {"effort": 15.0, "damping": 0.0, "friction": 0.0} | limits
    heavy = urdfs.inertial(40.0, urdfs.tensor(2.0, 2.0, 2.0)) if base == "floating" else ""
    parts = [urdfs.link("world", heavy)]
    above, reach = "world", 0.0
    for index, (mass, distance) in enumerate(links):
        name, moment = f"link{index}", mass * distance**2 / 10
        solid = urdfs.inertial(mass, urdfs.tensor(moment, moment, moment), f"{distance} 0 0")
        limit = (
            f'<limit lower="-0.5" upper="1.5" effort="{said["effort"]}" velocity="5"/>'
            f'<dynamics damping="{said["damping"]}" friction="{said["friction"]}"/>'
        )
        hinge = urdfs.joint(f"j{index}", above, name, content=limit, xyz=f"{reach} 0 0")
        parts += [urdfs.link(name, solid), hinge]
        above, reach = name, 2 * distance
    path = folder / "arm.urdf"
    path.write_text(urdfs.robot(*parts, name="arm"))
    read = look(find_source(path, {}))
    return judge(read, base)


def rows_of(robot: InspectedRobot) -> tuple[dict[str, float], tuple[DriveRow, ...]]:
    legs = study(robot).legs
    pose = home_pose(robot.tree, legs)
    return pose, drive_rows(robot.tree, pose, legs)


def test_joints_of_a_hand_get_a_frequency_each_and_its_impossible_dampers_go(tmp_path: Path):
    robot = arm(tmp_path, [(0.2, 0.03), (0.05, 0.02), (0.01, 0.01)], damping=10.0, friction=10.0)
    _, (row,) = rows_of(robot)
    assert row.gains.keys() == {"frequency", "damping_ratio"}
    assert row.gains["damping_ratio"] == 1.0
    assert row.drops == ("damping", "friction")
    # Gravity on a point at a distance l: sag = g / (l (2 pi f)^2), most for the tip's 10 mm.
    assert 9.81 / (0.01 * 1.1 * (2 * math.pi * row.gains["frequency"]) ** 2) <= SAG["rad"] * 1.1
    source = find_source(tmp_path / "arm.urdf", {})
    text = urdf_recipe(robot, study(robot), source, tmp_path / "a").text
    assert "armature: 0.0025, damping: 0, friction: 0}" in text


@pytest.mark.parametrize("base", ["fixed", "floating"])
def test_one_pair_of_gains_holds_the_arm_and_neither_rings_nor_creeps(base: Base, tmp_path: Path):
    """A floating base without legs has wheels, or lies on the ground: that bears it."""
    pose, (row,) = rows_of(arm(tmp_path, [(4.0, 0.2)], base, effort=30.0))
    assert pose == {"j0": 0.0}
    kp, kd = row.gains["kp"], row.gains["kd"]
    assert 4.0 * 9.81 * 0.2 / kp <= SAG["rad"]
    inertia = 4.0 * 0.2**2 * 1.1
    assert 0.65 <= kd / (2 * math.sqrt(kp * inertia)) <= MOST_DAMPED


def test_joints_of_one_motor_that_move_unlike_loads_get_a_row_each(tmp_path: Path):
    """A shoulder moves fifty times what its wrist does; before, one kp served both.

    Each row's damping ratio, of the lightest and the heaviest of its joints, by the mass matrix of
    the chain laid out straight.
    """
    robot = arm(tmp_path, [(1.0, 0.1), (0.5, 0.06)], effort=9.0, damping=0.2)
    pose, rows = rows_of(robot)
    assert [row.joints for row in rows] == [("j0",), ("j1",)]
    inertia = dynamics(robot.tree, pose, {}).effective_inertia()
    for row in rows:
        (name,) = row.joints
        damping = row.gains["kd"] + 0.2  # the drive's and the source's
        ratio = damping / (2 * math.sqrt(row.gains["kp"] * inertia[name]))
        assert 0.65 <= ratio <= MOST_DAMPED


def test_the_damping_of_the_source_is_part_of_what_the_drive_would_add(tmp_path: Path):
    total = []
    for damping in (0.0, 1.0):
        (tmp_path / str(damping)).mkdir()
        _, (row,) = rows_of(
            arm(tmp_path / str(damping), [(4.0, 0.2)], effort=60.0, damping=damping)
        )
        total.append(row.gains["kd"] + damping)
    assert total[1] == pytest.approx(total[0], rel=0.02)


@pytest.mark.parametrize(("effort", "hangs"), [(14.0, False), (7.0, True)])
def test_an_arm_that_cannot_be_held_stretched_out_hangs(effort: float, hangs: bool, tmp_path: Path):
    """Stretched out it needs m g l = 7.8 N m; at 1.5 rad cos(1.5) = 7 % of it."""
    pose, _ = rows_of(arm(tmp_path, [(4.0, 0.2)], effort=effort))
    assert (pose["j0"] > 0.0) == hangs
    assert 4.0 * 9.81 * 0.2 * math.cos(pose["j0"]) <= HEAVY * effort


def test_a_leg_whose_drive_outruns_the_step_is_told():
    """kd dt / I of 4 N m s/rad, 5 ms and a link of 10 g m2 is 2: more than it bears."""
    row = DriveRow(("knee",), 20.0, 20.0, "rad", 0.1, {"kp": 80.0, "kd": 4.0}, standing=0.01)
    assert row.outruns(0.005)
    assert not row.outruns(0.002)
    assert not replace(row, standing=0.1).outruns(0.005)
    assert not replace(row, standing=0.0).outruns(0.005), "no leg"


def test_links_that_only_an_edit_gives_a_mass_get_gains_for_that_mass(tmp_path: Path):
    """The two balls of 0.01 kg that the edits make, each 0.2 m further out."""
    robot = arm(tmp_path, [(0.0, 0.2), (0.0, 0.2)], effort=0.1)
    source = find_source(tmp_path / "arm.urdf", {})
    text = urdf_recipe(robot, study(robot), source, tmp_path / "a").text
    assert "set_inertia" in text
    assert "\n# arm: 0.02 kg" in text
    assert "moves 0.000" in text
