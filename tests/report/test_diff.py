"""What changed between two robots: found, ranked, told once for subjects with the same change."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from tiny import TinyRobot, run_step, tiny_quadruped, write_robot_ports

from assetbuild.errors import UsageError
from assetbuild.report.diff import changes, counts, diff_markdown, diff_text
from assetbuild.report.foreign import foreign_snapshot
from assetbuild.report.snapshot import Snapshot, bundle_snapshot, robot_facts, robot_json
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.urdf import Urdf
from assetbuild.targets.usd import Usd

ROBOT = tiny_quadruped()


def snapshot(robot: TinyRobot = ROBOT, **more: object) -> Snapshot:
    return Snapshot("r", robot_facts(robot.tree, robot.shapes, robot.control), **more)


def with_drives(**values: object) -> TinyRobot:
    control = ROBOT.control
    drives = tuple(replace(a, **values) for a in control.actuators)
    return replace(ROBOT, control=replace(control, actuators=drives))


def with_joint(name: str, **values: object) -> TinyRobot:
    joints = tuple(replace(j, **values) if j.name == name else j for j in ROBOT.tree.joints)
    return replace(ROBOT, tree=replace(ROBOT.tree, joints=joints))


def test_a_robot_does_not_differ_from_itself():
    assert changes(snapshot(), snapshot()) == []
    assert "no difference" in diff_text(snapshot(), snapshot(), [])


def test_the_same_new_gain_of_all_joints_is_one_line():
    kp = ROBOT.control.actuators[0].kp
    (change,) = changes(snapshot(), snapshot(with_drives(kp=1.1 * kp)))
    assert (change.rank, change.quantity) == ("MEDIUM", "kp")
    assert len(change.subjects) == len(ROBOT.control.actuators)


def test_a_gain_in_degrees_is_critical_and_named():
    kp = ROBOT.control.actuators[0].kp
    (change,) = changes(snapshot(), snapshot(with_drives(kp=kp * math.pi / 180)))
    assert change.rank == "CRITICAL"
    assert "degrees" in change.note


def test_a_reversed_axis_is_critical_and_named():
    joint = ROBOT.tree.moving_joints[2]
    turned = with_joint(joint.name, axis=tuple(-v for v in joint.axis))
    (change,) = changes(snapshot(), snapshot(turned))
    assert change.rank == "CRITICAL"
    assert change.subjects == (f"joint {joint.name}",)
    assert "other way" in change.note


def test_a_heavier_body_is_critical_in_its_own_row_and_in_the_total():
    bodies = list(ROBOT.tree.bodies)
    heavy = replace(bodies[0].inertial, mass_kg=10 * bodies[0].inertial.mass_kg)
    bodies[0] = replace(bodies[0], inertial=heavy)
    robot = replace(ROBOT, tree=replace(ROBOT.tree, bodies=tuple(bodies)))
    found = changes(snapshot(), snapshot(robot))
    assert {(c.rank, c.quantity) for c in found} == {
        ("CRITICAL", "total mass, kg"), ("CRITICAL", "mass, kg")}  # fmt: skip


def test_swapped_limits_are_high():
    joint = ROBOT.tree.moving_joints[0]
    limits = replace(joint.limits, lower=joint.limits.lower - 0.2)
    found = changes(snapshot(), snapshot(with_joint(joint.name, limits=limits)))
    assert [(c.rank, c.quantity) for c in found] == [("HIGH", "lower")]


def test_a_lost_joint_is_critical_and_nothing_more_is_said_of_it():
    joint = ROBOT.tree.moving_joints[-1]
    fewer = tuple(j for j in ROBOT.tree.joints if j.name != joint.name)
    facts = {k: v for k, v in snapshot().facts.items() if k[1] != joint.name}
    assert len(fewer) == len(ROBOT.tree.joints) - 1
    found = changes(snapshot(), Snapshot("s", facts))
    assert [(c.rank, c.subjects) for c in found] == [("CRITICAL", (f"joint {joint.name}",))]


def test_a_new_error_is_critical_a_new_warning_is_not_and_a_gone_one_is_low():
    before = snapshot(ready=True, findings={("a.a", "link x"): "warning"})
    after = snapshot(
        ready=False, findings={("b.b", "link x"): "error", ("c.c", "link x"): "warning"}
    )
    found = changes(before, after)
    assert [(c.rank, c.quantity) for c in found] == [
        ("CRITICAL", "ready for training"), ("CRITICAL", "finding b.b"),
        ("MEDIUM", "finding c.c"), ("LOW", "finding a.a")]  # fmt: skip
    assert counts(found) == "2 CRITICAL, 1 MEDIUM, 1 LOW"


def test_other_pictures_and_sizes_are_low():
    before = snapshot(files={"report/images/a.png": ("1", 5), "mjcf/r.xml": ("2", 100)})
    after = snapshot(files={"report/images/a.png": ("3", 5), "mjcf/r.xml": ("2", 300)})
    assert [(c.rank, c.quantity) for c in changes(before, after)] == [
        ("LOW", "picture"), ("LOW", "size")]  # fmt: skip


def test_the_markdown_is_one_table_row_for_each_change():
    found = changes(snapshot(), snapshot(with_drives(kp=1.0, kd=1.0)))
    text = diff_markdown(snapshot(), snapshot(), found)
    assert text.count("\n| ") == len(found) + 2


BALL = """
    def Xform "{0}" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])
    {{
        double3 xformOp:translate = ({1}, 0, 2)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        float physics:mass = {2}
        point3f physics:centerOfMass = (0, 0, 0)
        float3 physics:diagonalInertia = (0.01, 0.01, 0.01)
        quatf physics:principalAxes = (1, 0, 0, 0)
    }}
"""
TWO_BALLS = f"""#usda 1.0
(
    defaultPrim = "r"
    metersPerUnit = 1
)
def Xform "r"
{{{BALL.format("a", 1.0, 1)}{BALL.format("b", 1.4, 3)}
    def PhysicsFixedJoint "weld"
    {{
        rel physics:body0 = </r/a>
        rel physics:body1 = </r/b>
    }}
    def PhysicsFixedJoint "bolt"
    {{
        rel physics:body1 = </r/a>
    }}
    def PhysicsRevoluteJoint "swing"
    {{
        rel physics:body0 = </r/a>
        rel physics:body1 = </r/b>
        uniform token physics:axis = "X"
    }}
}}
"""


@pytest.mark.parametrize("target", [Mjcf, Usd])
def test_our_own_files_say_the_same_as_the_robot(target: type, tmp_path: Path):
    """Masses, axes, limits and gains by another road: MuJoCo, pxr."""
    robot = replace(ROBOT, control=replace(ROBOT.control))
    inputs = write_robot_ports(tmp_path / "in", robot)
    run_step(target(robot="tiny"), inputs, tmp_path / "out")
    (main,) = [*tmp_path.glob("out/mjcf/tiny.xml"), *tmp_path.glob("out/usd/tiny.usda")]
    found = changes(snapshot(), foreign_snapshot(main))
    loud = [c for c in found if c.quantity not in ("collision", "timestep, s")]
    assert [c for c in loud if c.rank in ("CRITICAL", "HIGH")] == []


def test_bodies_that_fixed_joints_hold_are_one(tmp_path: Path):
    """Two balls of 1 and 3 kg, 0.4 m apart: m1 m2 / (m1 + m2) d2 about their common centre."""
    file = tmp_path / "two.usda"
    file.write_text(TWO_BALLS)
    facts = foreign_snapshot(file).facts
    assert facts["robot", "robot", "total mass, kg"] == 4.0
    assert facts["robot", "robot", "base"] == "fixed"
    assert ("body", "b", "mass, kg") not in facts
    assert facts["body", "a", "mass, kg"] == 4.0
    assert facts["body", "a", "centre of mass, m"] == pytest.approx((0.3, 0, 0))
    moments = (0.02, 0.02 + 0.75 * 0.16, 0.02 + 0.75 * 0.16)
    assert facts["body", "a", "principal moments, kg m2"] == pytest.approx(moments)
    assert facts["joint", "swing", "kp"] == 0.0


def test_our_urdf_says_the_same_as_the_robot(tmp_path: Path):
    inputs = write_robot_ports(tmp_path / "in", ROBOT)
    run_step(Urdf(robot="tiny"), inputs, tmp_path / "out")
    found = changes(snapshot(), foreign_snapshot(tmp_path / "out/urdf/tiny.urdf"))
    assert [c for c in found if c.rank == "CRITICAL"] == []


def test_a_bundle_is_read_back_as_it_was(tmp_path: Path):
    (tmp_path / "report").mkdir()
    text = robot_json(ROBOT.tree, ROBOT.shapes, ROBOT.control)
    (tmp_path / "report/robot.json").write_text(text)
    report = {"verdict": {"ready": True}, "findings": []}
    (tmp_path / "report/report.json").write_text(json.dumps(report))
    (tmp_path / "manifest.json").write_text('{"files": []}')
    assert changes(snapshot(), bundle_snapshot(tmp_path)) == []


@pytest.mark.parametrize("content", ["", "[1, 2]", "<html/>"])
def test_what_is_no_model_is_refused_with_a_hint(content: str, tmp_path: Path):
    file = tmp_path / "x.xml"
    file.write_text(content)
    with pytest.raises(UsageError):
        foreign_snapshot(file)
    with pytest.raises(UsageError):
        bundle_snapshot(tmp_path)
