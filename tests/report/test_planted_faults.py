"""Seven mistakes that people make: each is found by a check that names it, and seen in the report.

The robot is sound before: no check says more than an information. Every check that reads the robot
and its MJCF takes part, so a new one may find them too.
"""

from __future__ import annotations

import importlib.util
import math
from dataclasses import replace
from pathlib import Path

import pytest
from robot_files import run_step, write_robot_ports
from tiny import FOOT_RADIUS_M, SEGMENT_M, TinyRobot, tiny_quadruped

from assetbuild.findings import Finding
from assetbuild.plugin_types import Check
from assetbuild.plugins import load_plugin, plugin_names
from assetbuild.report.document import make_report
from assetbuild.report.html import html_page
from assetbuild.report.verdict import CheckResult
from assetbuild.robot.inertia import rotate_tensor
from assetbuild.robot.model import Inertial
from assetbuild.robot.pose import Pose, normalised_quat
from assetbuild.robot.shapes import Box, Shape, Sphere
from assetbuild.robot.sides import Side
from assetbuild.robot.softness import CouplingError, LimitError, softened
from assetbuild.targets.mjcf import Mjcf

from .robots_for_tests import changed, recipe, subject, with_drives, with_joint

pytestmark = pytest.mark.slow

RECIPE = recipe(
    base="floating",
    actuators=[{"joints": ".*", "model": "pd", "kp": 100, "kd": 3}],
    validate={"stand": {"feet": ".*_foot"}, "mass": {"total_kg": 12.01, "tolerance": 0.02}},
)
CHECKS = [
    name
    for name in plugin_names(Check)
    if set(load_plugin(Check, name).needs) <= {"mjcf"}
    and not any(
        importlib.util.find_spec(module) is None for module in load_plugin(Check, name).requires
    )
]


def sound() -> TinyRobot:
    """The tiny quadruped with visual boxes of its inertias' size, so that density makes sense.

    Its limits hold full effort, as those of a recipe do.
    """
    robot = tiny_quadruped()
    wishes = LimitError.model_validate({}), CouplingError.model_validate({})
    robot = replace(robot, control=softened(robot.tree, robot.control, (Side(),), *wishes))
    middle = Pose((0.0, 0.0, -SEGMENT_M / 2))
    shapes = [s for s in robot.shapes.shapes if s.role == "collision" and "hip" not in s.name]
    shapes.append(Shape("trunk_visual", "trunk", "visual", Box((0.4, 0.2, 0.1))))
    for leg in ("FR", "FL", "RR", "RL"):
        for link, edge in (("thigh", 0.03), ("calf", 0.025)):
            box = Box((edge, edge, SEGMENT_M))
            shapes.append(Shape(f"{leg}_{link}_visual", f"{leg}_{link}", "visual", box, middle))
        shapes.append(Shape(f"{leg}_hip_visual", f"{leg}_hip", "visual", Box((0.06, 0.06, 0.06))))
        foot = Sphere(FOOT_RADIUS_M)
        shapes.append(Shape(f"{leg}_foot_visual", f"{leg}_foot", "visual", foot))
    return replace(robot, shapes=replace(robot.shapes, shapes=tuple(shapes)))


THIGH = next(body for body in tiny_quadruped().tree.bodies if body.name == "FR_thigh").inertial


def with_thigh(robot: TinyRobot, inertial: Inertial) -> TinyRobot:
    bodies = changed(robot.tree.bodies, "FR_thigh", inertial=inertial)
    return replace(robot, tree=replace(robot.tree, bodies=bodies))


def knee_reversed(robot: TinyRobot) -> TinyRobot:
    return with_joint(robot, "FR_calf_joint", axis=(0.0, -1.0, 0.0))


def inertia_in_wrong_frame(robot: TinyRobot) -> TinyRobot:
    quarter = normalised_quat((1.0, 1.0, 0.0, 0.0))
    tensor = rotate_tensor(THIGH.inertia_com_kg_m2, quarter)
    return with_thigh(robot, replace(THIGH, inertia_com_kg_m2=tensor))


def mass_times_ten(robot: TinyRobot) -> TinyRobot:
    tensor = tuple(10.0 * v for v in THIGH.inertia_com_kg_m2)
    return with_thigh(robot, Inertial(10.0 * THIGH.mass_kg, THIGH.com_m, tensor))


def limits_swapped(robot: TinyRobot) -> TinyRobot:
    """Hips open to 0.9 rad outwards and 0.4 inwards; the front left one got the right side's."""
    right, left = (-0.9, 0.4), (-0.4, 0.9)
    for leg, (lower, upper) in {"FR": right, "FL": right, "RR": right, "RL": left}.items():
        hip = next(j for j in robot.tree.joints if j.name == f"{leg}_hip_joint")
        limits = replace(hip.limits, lower=lower, upper=upper)
        robot = with_joint(robot, hip.name, limits=limits)
    return robot


def collision_shifted(robot: TinyRobot) -> TinyRobot:
    aside = Pose((0.03, 0.0, -SEGMENT_M / 2))
    shapes = changed(robot.shapes.shapes, "FR_thigh_collision", X_link_shape=aside)
    return replace(robot, shapes=replace(robot.shapes, shapes=shapes))


def gain_in_degrees(robot: TinyRobot) -> TinyRobot:
    return with_drives(robot, kp=robot.control.actuators[0].kp * math.pi / 180)


def feet_above_the_floor(robot: TinyRobot) -> TinyRobot:
    home, *rest = robot.control.keyframes
    x, y, z = home.base.xyz
    home = replace(home, base=Pose((x, y, z + 0.03)))
    return replace(robot, control=replace(robot.control, keyframes=(home, *rest)))


FAULTS = {
    knee_reversed: ("stand.sole_gap", "mirror.limits"),
    inertia_in_wrong_frame: ("mass.axes",),
    mass_times_ten: ("mass.density", "mass.total", "mirror.mass"),
    limits_swapped: ("mirror.limits",),
    collision_shifted: ("coverage.shift",),
    gain_in_degrees: ("stand.", "trials.dead"),
    feet_above_the_floor: ("stand.sole_gap",),
}


def checked(robot: TinyRobot, folder: Path) -> tuple[list[Finding], str]:
    """All loud findings, and the page of the report."""
    inputs = write_robot_ports(folder / "in", robot)
    run_step(Mjcf(robot="tiny"), inputs, folder / "built")
    (inputs / "mjcf").symlink_to(folder / "built" / "mjcf")
    found: list[Finding] = []
    checks = {}
    for name in CHECKS:
        step = load_plugin(Check, name).configure(RECIPE)
        if step is not None:
            own = run_step(step, inputs, folder / name)
            found += own
            bad = any(f.severity == "error" for f in own)
            checks[name] = CheckResult("fail" if bad else "pass")
    report = make_report("tiny", found, checks, {}, lambda _: "")
    page = html_page(report, subject(robot, RECIPE), [], None)
    return [f for f in found if f.severity != "info"], page


def test_the_robot_is_sound_before(tmp_path: Path):
    found, page = checked(sound(), tmp_path)
    assert [(f.rule, f.subject, f.message) for f in found] == []
    assert "Ready for training: yes" in page


@pytest.mark.parametrize("fault", FAULTS, ids=lambda f: f.__name__)
def test_each_fault_is_found_by_a_named_check_and_seen_in_the_report(fault, tmp_path: Path):
    rules = FAULTS[fault]
    found, page = checked(fault(sound()), tmp_path)
    named = [f for f in found if f.rule.startswith(rules)]
    assert named, [(f.rule, f.message) for f in found]
    assert all(f"<code>{f.rule}</code>" in page for f in named)
