"""The USD asset: what a runtime finds on the stage, and which bytes are written."""

from __future__ import annotations

import math
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pxr import Usd as UsdCore
from pxr import UsdGeom, UsdPhysics
from random_robots import unit_vectors
from robot_files import check_inputs, contents, emit, run_step, write_robot_ports
from tiny import (
    TinyRobot,
    box_inertial,
    pendulum,
    tiny_quadruped,
    with_control,
    with_kinds,
    with_mimic,
)

from assetbuild.errors import StepError
from assetbuild.facts.readers._usd import UsdReader
from assetbuild.findings import Finding
from assetbuild.robot.model import Body, Frame, Inertial, Joint, JointKind, Limits, Tree
from assetbuild.robot.pose import Pose, Vec3, quat_of_rpy, rotation_of
from assetbuild.robot.shapes import Material, Mesh, MeshAsset, Shape, Shapes, Sphere
from assetbuild.simulators.usd_names import usd_identifier, usd_identifiers
from assetbuild.targets.usd import Usd
from assetbuild.targets.usd.bodies import EDGE, within_float32
from assetbuild.targets.usd.joints import joint_axis


def build(robot: TinyRobot, folder: Path, name: str = "robot") -> tuple[Path, list[Finding]]:
    """The folder `usd/` and the findings."""
    findings = emit(Usd(robot=name), robot, folder)
    return folder / "out/usd", findings


@pytest.fixture
def quadruped(tmp_path: Path) -> UsdCore.Stage:
    usd, _ = build(tiny_quadruped(), tmp_path)
    return UsdCore.Stage.Open(str(usd / "robot.usda"))


def everything(stage: UsdCore.Stage) -> Iterator[UsdCore.Prim]:
    return iter(UsdCore.PrimRange.Stage(stage, UsdCore.TraverseInstanceProxies()))


def value(stage: UsdCore.Stage, path: str) -> object:
    return stage.GetAttributeAtPath(path).Get()


@given(
    st.tuples(*[st.floats(1e-9, 1.0)] * 2),
    st.floats(0.0, 3e-7),
    st.permutations(range(3)),
    st.tuples(*[st.floats(-3.0, 3.0)] * 3),
)
def test_a_flat_body_keeps_its_triangle_in_single_precision(
    two: tuple[float, float], gap: float, order: list[int], turn: Vec3
) -> None:
    """As Newton does it: the tensor turned in float32, whose moments MuJoCo then compares."""
    flat = (*two, sum(two) * (1.0 - gap))
    moments = within_float32(tuple(flat[i] for i in order))
    assert moments == pytest.approx([flat[i] for i in order], rel=0.0, abs=2.0 * EDGE * flat[2])
    axes = rotation_of(quat_of_rpy(*turn)).astype(np.float32)
    turned = axes @ np.diag(np.array(moments, dtype=np.float32)) @ axes.T
    a, b, c = np.linalg.eigvalsh((turned + turned.T).astype(float) / 2.0)
    assert a + b >= c
    assert within_float32((1.0, 1.0, 2.1)) == (1.0, 1.0, 2.1), "what is impossible stays"


# --- the stage ----------------------------------------------------------------------------------


def test_physics_is_a_selected_variant_and_none_takes_all_of_it_away(
    quadruped: UsdCore.Stage,
) -> None:
    variants = quadruped.GetDefaultPrim().GetVariantSet("Physics")
    assert variants.HasAuthoredVariantSelection()
    assert variants.GetVariantSelection() == "physics"
    assert variants.GetVariantNames() == ["mujoco", "newton", "none", "physics", "physx"]
    variants.SetVariantSelection("none")
    physics = (UsdPhysics.RigidBodyAPI, UsdPhysics.CollisionAPI, UsdPhysics.ArticulationRootAPI)
    assert not [p for p in everything(quadruped) if any(p.HasAPI(api) for api in physics)]
    assert not [p for p in everything(quadruped) if p.IsA(UsdPhysics.Joint)]
    assert quadruped.GetPrimAtPath("/robot/trunk/visuals/trunk_visual/mesh").IsA(UsdGeom.Mesh)


def test_collision_meshes_are_hulls_and_say_when_that_fills_something(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    shapes = Shapes(
        (
            Shape("hull", "trunk", "collision", Mesh("trunk_box")),
            Shape("hollow", "trunk", "collision", Mesh("cup")),
            Shape("fine", "trunk", "collision", Mesh("ball")),
        ),
        (),
        (
            *robot.shapes.meshes,
            MeshAsset("cup", "trunk_box.obj", 8, 12, convex=False),
            MeshAsset("ball", "trunk_box.obj", 200, 396, convex=True),
        ),
    )
    usd, findings = build(replace(robot, shapes=shapes), tmp_path)
    stage = UsdCore.Stage.Open(str(usd / "robot.usda"))
    for name in ("hull", "hollow", "fine"):
        prim = stage.GetPrimAtPath(f"/robot/trunk/collisions/{name}")
        assert UsdPhysics.MeshCollisionAPI(prim).GetApproximationAttr().Get() == "convexHull"
        assert len(UsdGeom.Mesh(prim).GetPointsAttr().Get()) == 8
    rules = [f.rule for f in findings]
    assert rules.count("usd.concave_collision") == rules.count("usd.hull_vertices") == 1


# --- bases, joints, drives ----------------------------------------------------------------------


@pytest.mark.parametrize("moment", [0.0, 0.03])
def test_a_base_that_states_zeros_states_no_mass(moment: float, tmp_path: Path) -> None:
    """USD refuses an inertia of 0; MuJoCo and PhysX never move that body."""
    robot = pendulum()
    zeros = Inertial(0.0, (0.0, 0.0, 0.0), (moment,) * 3 + (0.0,) * 3)
    bodies = (replace(robot.tree.bodies[0], inertial=zeros), *robot.tree.bodies[1:])
    robot = replace(robot, tree=replace(robot.tree, bodies=bodies))
    if moment:  # and its joint has no row in the actuator table
        robot = with_control(robot, actuators=())
    _, findings = build(robot, tmp_path)
    assert [f.severity for f in findings if f.rule == "usd.mass_missing"] == ["info"]
    inputs = check_inputs(tmp_path / "equal", robot, Usd(robot="robot"), "usd")
    assert run_step(UsdReader(robot="robot"), inputs, tmp_path / "equal_out") == []


@given(unit_vectors())
def test_joint_axis_turns_the_token_onto_any_direction(axis: Vec3) -> None:
    token, turn = joint_axis(axis)
    assert rotation_of(turn) @ np.eye(3)["XYZ".index(token)] == pytest.approx(axis, abs=2e-9)


ARC = 180.0 / math.pi
"""deg in one rad."""


@pytest.mark.parametrize(
    ("follower", "leader", "multiplier", "gearing"),
    [
        ("prismatic", "revolute", 0.02, -0.02 / ARC),
        ("revolute", "prismatic", -20.0, 20.0 * ARC),
        ("prismatic", "continuous", -0.01, 0.01 / ARC),
        ("prismatic", "prismatic", 2.0, -2.0),
        ("continuous", "continuous", 0.5, -0.5),
    ],
)
def test_a_mimic_of_any_two_joints_is_in_the_units_of_each_engine(
    follower: JointKind, leader: JointKind, multiplier: float, gearing: float, tmp_path: Path
) -> None:
    """PhysX counts an angle in degrees, Newton in radians, and both a length in metres: measured.

    PhysX couples angles within limits alone; Newton takes a limit of 1e6 rad or more for none.
    """
    robot = with_mimic(tiny_quadruped(), "FL_hip_joint", "FR_hip_joint", multiplier, 0.1)
    kinds: dict[str, JointKind] = {"FL_hip_joint": follower, "FR_hip_joint": leader}
    usd, findings = build(with_kinds(robot, **kinds), tmp_path)
    stage = UsdCore.Stage.Open(str(usd / "robot.usda"))
    path = "/robot/Joints/FL_hip_joint"
    shift = 0.1 if follower == "prismatic" else 0.1 * ARC
    for name, expected in (
        ("physxMimicJoint:rotX:gearing", gearing),
        ("physxMimicJoint:rotX:offset", -shift),
        ("newton:mimicCoef1", multiplier),
        ("newton:mimicCoef0", shift),
    ):
        assert value(stage, f"{path}.{name}") == pytest.approx(expected, rel=1e-6)
    for name, kind in kinds.items():
        if kind == "continuous":
            stated = float(value(stage, f"/robot/Joints/{name}.physics:upperLimit"))
            assert 1e6 * ARC < stated < math.inf
    assert "usd.mimic" not in [f.rule for f in findings]


def test_newton_is_led_by_the_first_of_a_chain(tmp_path: Path) -> None:
    """q = -2 (3 q' + 0.1) + 0.5; Newton refuses a leader that follows, PhysX takes it."""
    robot = with_mimic(tiny_quadruped(), "FL_hip_joint", "FR_hip_joint", 3.0, 0.1)
    usd, _ = build(with_mimic(robot, "RL_hip_joint", "FL_hip_joint", -2.0, 0.5), tmp_path)
    stage = UsdCore.Stage.Open(str(usd / "robot.usda"))
    last = stage.GetPrimAtPath("/robot/Joints/RL_hip_joint")
    (newton,) = last.GetRelationship("newton:mimicJoint").GetTargets()
    (physx,) = last.GetRelationship("physxMimicJoint:rotX:referenceJoint").GetTargets()
    assert (newton.name, physx.name) == ("FR_hip_joint", "FL_hip_joint")
    found = [last.GetAttribute(f"newton:mimicCoef{n}").Get() for n in (1, 0)]
    assert found == pytest.approx([-6.0, 0.3 * ARC])


@pytest.mark.parametrize("kind", ["planar", "floating"])
def test_a_joint_that_no_articulation_holds_is_refused(kind: str, tmp_path: Path) -> None:
    robot = pendulum()
    joint = replace(robot.tree.joints[0], kind=kind)
    with pytest.raises(StepError, match=f"`swing_joint` is {kind}"):
        build(replace(robot, tree=replace(robot.tree, joints=(joint,))), tmp_path)


# --- names --------------------------------------------------------------------------------------


def test_names_become_identifiers_that_never_meet() -> None:
    assert usd_identifier("FR_hip") == "FR_hip"
    assert usd_identifier("left-arm.2") == "left_arm_2"
    assert usd_identifier("1st") == "_1st"
    names = usd_identifiers(["a-b", "a_b", "a.b", "Looks"], taken=("Looks",))
    assert names["a_b"] == "a_b"
    assert len(set(names.values())) == 4
    assert "Looks" not in names.values()


@given(st.lists(st.text(min_size=1, max_size=4), unique=True, max_size=8), st.randoms())
def test_identifiers_are_valid_distinct_and_independent_of_order(names: list[str], random) -> None:
    table = usd_identifiers(names)
    assert len(set(table.values())) == len(names)
    assert all(re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", v) for v in table.values())
    shuffled = list(names)
    random.shuffle(shuffled)
    assert usd_identifiers(shuffled) == table


def test_a_renamed_link_is_found_by_its_display_name_and_told(tmp_path: Path) -> None:
    robot = pendulum()
    tree = Tree(
        "my-robot",
        "fixed",
        (Body("base"), Body("arm-1", robot.tree.bodies[1].inertial)),
        (replace(robot.tree.joints[0], child="arm-1"),),
        (Frame("Werkzeug ä", "arm-1", Pose()),),
    )
    shapes = Shapes(
        (Shape("s", "arm-1", "visual", Sphere(0.1), material="材质"),), (Material("材质"),)
    )
    usd, findings = build(TinyRobot(tree, tree, shapes, robot.control), tmp_path, "my-robot")
    stage = UsdCore.Stage.Open(str(usd / "my-robot.usda"))
    assert stage.GetDefaultPrim().GetPath() == "/my_robot"
    prim = stage.GetPrimAtPath("/my_robot/arm_1")
    assert prim.GetMetadata("displayName") == "arm-1"
    renamed = {f.subject for f in findings if f.rule == "usd.renamed"}
    assert renamed == {"robot", "link arm-1", "link Werkzeug ä"}


# --- findings -----------------------------------------------------------------------------------


def test_what_usd_cannot_hold_is_told(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    first, *rest = robot.tree.joints
    joints = (replace(first, limits=Limits(lower=-1.0)), *rest)
    control = replace(robot.control, contact=robot.control.contact.model_copy(update={"condim": 6}))
    tree = replace(robot.tree, joints=joints)
    drives = (replace(control.actuators[0], model="ideal_pd"), *control.actuators[1:])
    control = replace(control, actuators=drives)
    _, findings = build(replace(robot, tree=tree, control=control), tmp_path)
    told = {(f.rule, f.subject) for f in findings}
    assert told == {
        ("usd.explicit_actuator", "robot"),
        ("usd.one_sided_limit", f"joint {first.name}"),
        ("usd.contact", "robot"),
    }


def test_a_body_without_mass_is_told(tmp_path: Path) -> None:
    bodies = (Body("b0", box_inertial(1.0, (0.1, 0.1, 0.1))), Body("b1"))
    tree = Tree("robot", "floating", bodies, (Joint("j1", "fixed", "b0", "b1"),))
    _, findings = build(TinyRobot(tree, tree), tmp_path)
    assert {(f.rule, f.severity) for f in findings} == {("usd.mass_missing", "error")}


# --- bytes --------------------------------------------------------------------------------------


def test_files_say_nothing_of_the_machine_and_name_one_another_relatively(tmp_path: Path) -> None:
    usd, _ = build(tiny_quadruped(), tmp_path / "here")
    write_robot_ports(tmp_path / "in", tiny_quadruped())
    (tmp_path / "out").mkdir()
    script = (
        "import sys, pathlib\n"
        "from assetbuild.engine.step import Files\n"
        "from assetbuild.targets.usd import Usd, UsdGeometries\n"
        "folder = pathlib.Path(sys.argv[1])\n"
        "list(UsdGeometries().run(Files(folder / 'in', folder / 'in')))\n"
        "list(Usd(robot='robot').run(Files(folder / 'in', folder / 'out')))\n"
    )
    environment = os.environ | {"PYTHONHASHSEED": "7", "TZ": "Asia/Kathmandu"}
    environment |= {"USD_WRITE_NEW_USDC_FILES_AS_VERSION": "0.9.0"}
    command = [sys.executable, "-c", script, str(tmp_path)]
    subprocess.run(command, check=True, env=environment, timeout=120)
    files = contents(usd)
    assert contents(tmp_path / "out/usd") == files
    for name in (name for name in files if name.endswith(".usda")):
        assert all(path.startswith(b"./") for path in re.findall(rb"@([^@]+)@", files[name]))
    assert files["payloads/geometries.usdc"][8:11] == b"\x00\x08\x00"  # what usd-core 24.5 reads
