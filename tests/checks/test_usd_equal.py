"""One number changed on the stage, and the comparison names it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from pxr import Gf, Usd, UsdPhysics
from tiny import (
    TinyRobot,
    check_inputs,
    examples,
    kept_feet,
    pendulum,
    robots,
    run_step,
    tiny_quadruped,
    with_mimic,
)

from assetbuild.checks.usd_equal import UsdEqual
from assetbuild.findings import Finding
from assetbuild.targets.usd import Usd as UsdTarget

JOINTS = "/robot/Joints"


def check(
    robot: TinyRobot, folder: Path, spoil: Callable[[Usd.Stage], object] | None = None
) -> list[Finding]:
    inputs = check_inputs(folder, robot, UsdTarget(robot="robot"), "usd")
    if spoil is not None:
        stage = Usd.Stage.Open(str(inputs / "usd/robot.usda"))
        spoil(stage)
        stage.Save()
        del stage
    return run_step(UsdEqual(robot="robot"), inputs, folder / "out")


def test_quadruped_is_equal_and_the_figures_say_how_near_the_limits(tmp_path: Path) -> None:
    assert check(tiny_quadruped(), tmp_path) == []
    figures = json.loads((tmp_path / "out/figures.json").read_text())
    assert {"mass", "com", "inertia", "axis", "limits", "gains", "effort"} <= set(figures)
    assert max(figures.values()) < 0.7  # float32 keeps a number to 6e-8, the limit is 2e-7


@settings(max_examples=examples(40), deadline=None)
@given(robots())
def test_every_random_tree_is_equal(robot: TinyRobot) -> None:
    with TemporaryDirectory() as folder:
        assert check(robot, Path(folder)) == []


def test_pendulum_and_mimic_are_equal(tmp_path: Path) -> None:
    assert check(pendulum(), tmp_path / "a") == []
    mimic = with_mimic(tiny_quadruped(), "FL_hip_joint", "FR_hip_joint", -1.0, 0.1)
    assert check(mimic, tmp_path / "b") == []


@pytest.mark.parametrize(
    ("kind", "subject", "attribute", "factor"),
    [
        ("mass", "link FR_hip", "/robot/FR_hip.physics:mass", 1.000001),
        ("gains", "actuator FR_hip_joint", "drive:angular:physics:stiffness", 180 / math.pi),
        ("gains", "actuator FR_hip_joint", "drive:angular:physics:damping", 1.00001),
        ("effort", "actuator FR_hip_joint", "drive:angular:physics:maxForce", math.pi / 180),
        ("target", "actuator FR_thigh_joint", "drive:angular:physics:targetPosition", 1.00001),
        ("limits", "joint FR_hip_joint", "physics:lowerLimit", math.pi / 180),
        ("limits", "joint FR_hip_joint", "physics:upperLimit", 1.000001),
        ("armature", "actuator FR_hip_joint", "physxJoint:armature", 0.0),
        ("armature", "actuator FR_hip_joint", "physxJointAxis:angular:armature", 0.0),
        ("armature", "actuator FR_hip_joint", "newton:armature", 0.0),
        ("friction", "actuator FR_hip_joint", "physxJointAxis:angular:dynamicFrictionEffort", 2.0),
        ("friction", "actuator FR_hip_joint", "newton:friction", 2.0),
        ("damping", "actuator FR_hip_joint", "newton:damping", 180 / math.pi),
        (
            "damping",
            "actuator FR_hip_joint",
            "physxJointAxis:angular:viscousFrictionCoefficient",
            180 / math.pi,
        ),
        ("velocity", "actuator FR_hip_joint", "physxJoint:maxJointVelocity", math.pi / 180),
        ("velocity", "actuator FR_hip_joint", "newton:velocityLimit", math.pi / 180),
        ("size", "shape FR_foot_collision", "/robot/FR_calf/collisions/{}.radius", 1.000001),
        ("size", "shape trunk_collision", "/robot/trunk/collisions/{}.size", 1.000001),
    ],
)
def test_changed_number_is_named(
    kind: str, subject: str, attribute: str, factor: float, tmp_path: Path
) -> None:
    name = subject.split()[1]
    path = attribute.format(name) if attribute[0] == "/" else f"{JOINTS}/{name}.{attribute}"

    def spoil(stage: Usd.Stage) -> None:
        found = stage.GetAttributeAtPath(path)
        found.Set(found.Get() * factor)

    findings = check(tiny_quadruped(), tmp_path, spoil)
    assert [(f.rule, f.subject, f.severity) for f in findings] == [
        (f"equal.usd.{kind}", subject, "error")
    ]
    assert findings[0].data["error"] > findings[0].data["tolerance"]


@pytest.mark.parametrize(
    ("kind", "path", "value"),
    [
        ("com", "/robot/FR_thigh.physics:centerOfMass", Gf.Vec3f(0, 0, 0.1)),
        ("inertia", "/robot/trunk.physics:diagonalInertia", Gf.Vec3f(0.085, 0.025, 0.1)),
        ("inertia", "/robot/trunk.physics:principalAxes", Gf.Quatf(1, 0, 0, 0)),
        ("joint_frame", f"{JOINTS}/FR_hip_joint.physics:localPos0", Gf.Vec3f(0.18, 0.05, 0)),
        ("joint_frame", f"{JOINTS}/FR_hip_joint.physics:localPos1", Gf.Vec3f(1e-4, 0, 0)),
        ("axis", f"{JOINTS}/FR_hip_joint.physics:axis", "Y"),
        ("pose", "/robot/FR_calf.xformOp:translate", Gf.Vec3d(0.18, -0.13, -0.2001)),
        ("frame", "/robot/FR_calf/FR_foot.xformOp:translate", Gf.Vec3d(0, 0, 0)),
        (
            "shape",
            "/robot/FR_calf/collisions/FR_calf_collision.xformOp:translate",
            Gf.Vec3d(0, 0, 0),
        ),
    ],
)
def test_moved_or_turned_thing_is_named(
    kind: str, path: str, value: object, tmp_path: Path
) -> None:
    findings = check(
        tiny_quadruped(), tmp_path, lambda stage: stage.GetAttributeAtPath(path).Set(value)
    )
    assert f"equal.usd.{kind}" in {f.rule for f in findings}


def test_axis_that_points_the_other_way_is_caught(tmp_path: Path) -> None:
    """Both frames turned by half a turn: consistent, and every command has the wrong sign."""

    def spoil(stage: Usd.Stage) -> None:
        joint = UsdPhysics.RevoluteJoint(stage.GetPrimAtPath(f"{JOINTS}/FR_hip_joint"))
        joint.GetLocalRot0Attr().Set(Gf.Quatf(0, 0, 1, 0))
        joint.GetLocalRot1Attr().Set(Gf.Quatf(0, 0, 1, 0))

    findings = check(tiny_quadruped(), tmp_path, spoil)
    assert {(f.rule, f.subject) for f in findings} == {("equal.usd.axis", "joint FR_hip_joint")}


def test_swapped_parent_and_child_are_caught(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        joint = UsdPhysics.Joint(stage.GetPrimAtPath(f"{JOINTS}/FR_hip_joint"))
        joint.GetBody0Rel().SetTargets(["/robot/FR_hip"])
        joint.GetBody1Rel().SetTargets(["/robot/trunk"])

    findings = check(tiny_quadruped(), tmp_path, spoil)
    assert {f.rule for f in findings} == {"equal.usd.connection"}


@pytest.mark.parametrize(
    ("path", "subject"),
    [
        ("/robot/FR_calf", "link FR_calf"),
        ("/robot/FR_calf/FR_foot", "link FR_foot"),
        (f"{JOINTS}/FR_calf_joint", "joint FR_calf_joint"),
        ("/robot/trunk/visuals/trunk_visual", "shape trunk_visual"),
    ],
)
def test_lost_thing_is_named(path: str, subject: str, tmp_path: Path) -> None:
    findings = check(
        tiny_quadruped(), tmp_path, lambda stage: stage.GetPrimAtPath(path).SetActive(False)
    )
    assert ("equal.usd.missing", subject) in {(f.rule, f.subject) for f in findings}


def test_lost_drive_and_lost_attribute_are_named(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        stage.GetPrimAtPath(f"{JOINTS}/FR_hip_joint").RemoveAPI(UsdPhysics.DriveAPI, "angular")
        armature = stage.GetAttributeAtPath(f"{JOINTS}/FL_hip_joint.newton:armature")
        armature.Block()

    findings = check(tiny_quadruped(), tmp_path, spoil)
    assert {(f.rule, f.subject) for f in findings} == {
        ("equal.usd.drive", "actuator FR_hip_joint"),
        ("equal.usd.armature", "actuator FL_hip_joint"),
    }


def test_limit_that_the_robot_does_not_have_is_named(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    free = tuple(replace(a, effort=None, velocity=None) for a in robot.control.actuators)
    robot = replace(robot, control=replace(robot.control, actuators=free))
    assert check(robot, tmp_path / "good") == []

    def spoil(stage: Usd.Stage) -> None:
        prim = stage.GetPrimAtPath(f"{JOINTS}/FR_hip_joint")
        UsdPhysics.DriveAPI(prim, "angular").CreateMaxForceAttr(5.0)

    findings = check(robot, tmp_path / "bad", spoil)
    assert [f.rule for f in findings] == ["equal.usd.effort"]


def test_lost_filter_is_named(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    excludes = (*robot.control.excludes, ("FL_hip", "FR_hip"), ("FR_thigh", "trunk"))
    robot = replace(robot, control=replace(robot.control, excludes=excludes))
    assert check(robot, tmp_path / "good") == []

    def spoil(stage: Usd.Stage) -> None:
        stage.GetRelationshipAtPath("/robot/FR_thigh.physics:filteredPairs").SetTargets([])

    findings = check(robot, tmp_path / "bad", spoil)
    assert [f.rule for f in findings] == ["equal.usd.excludes"]


@pytest.mark.parametrize(
    ("body", "targets", "said"),
    [
        ("FL_foot", [], "link FL_thigh collides with `FL_foot`"),
        ("FL_foot", ["FL_thigh", "FR_foot"], "link FR_foot passes through `FL_foot`"),
        ("FL_foot", ["FL_hip"], "link FL_hip passes through `FL_foot`"),
    ],
)
def test_pairs_that_mujoco_drops_by_itself_are_filtered_and_no_others(
    body: str, targets: list[str], said: str, tmp_path: Path
) -> None:
    """A foot that is welded to the shin passes through the thigh in MuJoCo."""
    robot = kept_feet()
    assert check(robot, tmp_path / "good") == []

    def spoil(stage: Usd.Stage) -> None:
        filters = stage.GetRelationshipAtPath(f"/robot/{body}.physics:filteredPairs")
        filters.SetTargets([f"/robot/{name}" for name in targets])

    findings = check(robot, tmp_path / "bad", spoil)
    assert {f.rule for f in findings} == {"equal.usd.excludes"}
    assert any(said in f"{f.subject} {f.message}" for f in findings)


def test_a_filter_that_speaks_for_the_whole_robot_is_named(tmp_path: Path) -> None:
    robot = tiny_quadruped()

    def spoil(stage: Usd.Stage) -> None:
        api = UsdPhysics.FilteredPairsAPI.Apply(stage.GetPrimAtPath("/robot/FR_thigh"))
        api.CreateFilteredPairsRel().SetTargets(["/robot/trunk"])

    findings = check(robot, tmp_path / "bad", spoil)
    assert {f.rule for f in findings} == {"equal.usd.excludes"}
    assert len(findings) > 5


def test_main_file_that_is_no_usd_is_caught(tmp_path: Path) -> None:
    inputs = check_inputs(tmp_path, pendulum(), UsdTarget(robot="robot"), "usd")
    (inputs / "usd/robot.usda").write_text("not usd")
    findings = run_step(UsdEqual(robot="robot"), inputs, tmp_path / "out")
    assert [f.rule for f in findings] == ["equal.usd.unreadable"]
