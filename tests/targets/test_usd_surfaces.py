"""Surfaces per shape, masks, starts and the recipe's `usd` keys in the USD."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd as UsdCore
from pxr import UsdGeom, UsdPhysics
from tiny import TinyRobot, check_inputs, pendulum, run_step, tiny_quadruped, with_mimic

from assetbuild.findings import Finding
from assetbuild.pipeline.recipes import whole_model
from assetbuild.robot.model import Contact, Limits
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.targets.usd import Usd


def build(
    robot: TinyRobot, folder: Path, options: dict[str, object] | None = None
) -> tuple[UsdCore.Stage, list[Finding]]:
    target = Usd(robot="robot", options=UsdOptions.model_validate(options or {}))
    inputs = check_inputs(folder, robot, target, "usd")
    found = run_step(target, inputs, folder / "again")
    return UsdCore.Stage.Open(str(inputs / "usd/robot.usda")), found


def with_surfaces(robot: TinyRobot, **surfaces: Contact) -> TinyRobot:
    return replace(robot, control=replace(robot.control, contacts=tuple(surfaces.items())))


def friction_of(stage: UsdCore.Stage, path: str) -> float:
    prim = stage.GetPrimAtPath(path)
    (material,) = prim.GetRelationship("material:binding:physics").GetTargets()
    return float(stage.GetPrimAtPath(material).GetAttribute("physics:dynamicFriction").Get())


def test_a_shape_of_its_own_surface_has_a_material_of_its_own(tmp_path: Path) -> None:
    foot = Contact(friction=(1.2, 0.02, 0.01))
    robot = with_surfaces(tiny_quadruped(), FR_foot_collision=foot, FL_foot_collision=foot)
    stage, _ = build(robot, tmp_path)
    path = "/robot/{0}_calf/collisions/{0}_foot_collision"
    found = [friction_of(stage, path.format(leg)) for leg in ("FR", "FL", "RR")]
    assert found == pytest.approx([1.2, 1.2, 0.8])
    materials = [p for p in stage.Traverse() if p.HasAPI(UsdPhysics.MaterialAPI)]
    assert len(materials) == 2


def test_shapes_whose_bits_never_meet_are_filtered(tmp_path: Path) -> None:
    feet = Contact(friction=(0.8, 0.02, 0.01), mask=2, partners=4)
    none = Contact(friction=(0.8, 0.02, 0.01), mask=0, partners=0)
    robot = with_surfaces(tiny_quadruped(), FR_foot_collision=feet, trunk_collision=none)
    stage, _ = build(robot, tmp_path)
    foot = stage.GetPrimAtPath("/robot/FR_calf/collisions/FR_foot_collision")
    apart = {path.name for path in foot.GetRelationship("physics:filteredPairs").GetTargets()}
    hip = stage.GetPrimAtPath("/robot/FR_hip/collisions/FR_hip_collision")
    other = {path.name for path in hip.GetRelationship("physics:filteredPairs").GetTargets()}
    assert "RL_foot_collision" in apart
    assert "FR_foot_collision" in other  # each pair is written once
    assert "FR_calf_collision" not in apart  # on the same body
    trunk = stage.GetPrimAtPath("/robot/trunk/collisions/trunk_collision")
    assert UsdPhysics.CollisionAPI(trunk).GetCollisionEnabledAttr().Get() is False


def test_each_value_that_physx_cannot_hold_is_told_once(tmp_path: Path) -> None:
    soft = Contact(
        friction=(0.8, 0.02, 0.01),
        condim=6,
        priority=1,
        solref=(0.01, 1.0),
        solimp=(0.9, 0.95, 0.001, 0.5, 2.0),
        margin=0.001,
        gap=0.001,
    )
    robot = with_surfaces(tiny_quadruped(), FR_foot_collision=soft, FL_foot_collision=soft)
    _, found = build(robot, tmp_path)
    told = [f.data["value"] for f in found if f.rule == "usd.contact"]
    assert told == [
        "condim",
        "torsional and rolling friction",
        "priority",
        "solref",
        "solimp",
        "margin",
        "gap",
    ]


def test_joints_start_at_home_and_else_inside_of_their_limits(tmp_path: Path) -> None:
    stage, found = build(tiny_quadruped(), tmp_path / "home")
    knee = stage.GetPrimAtPath("/robot/Joints/FR_calf_joint")
    assert knee.GetAttribute("state:angular:physics:position").Get() == pytest.approx(-91.67, 1e-3)
    assert not [f for f in found if f.rule == "usd.start"]

    homeless = tiny_quadruped()
    homeless = replace(homeless, control=replace(homeless.control, keyframes=()))
    stage, found = build(homeless, tmp_path / "homeless")
    knee = stage.GetPrimAtPath("/robot/Joints/FR_calf_joint")
    at_limit = knee.GetAttribute("state:angular:physics:position").Get()
    assert at_limit == pytest.approx(knee.GetAttribute("physics:upperLimit").Get())
    assert len([f for f in found if f.rule == "usd.start"]) == 4


def test_one_sided_limits_keep_the_start_inside(tmp_path: Path) -> None:
    robot = pendulum()
    joint = replace(robot.tree.joints[0], limits=Limits(lower=0.5, effort=5.0))
    control = replace(robot.control, keyframes=())
    tree = replace(robot.tree, joints=(joint,))
    stage, _ = build(replace(robot, tree=tree, control=control), tmp_path)
    prim = stage.GetPrimAtPath("/robot/Joints/swing_joint")
    assert prim.GetAttribute("state:angular:physics:position").Get() == pytest.approx(28.6479, 1e-5)


def test_the_recipe_decides_what_only_physx_knows(tmp_path: Path) -> None:
    options: dict[str, object] = {
        "instanceable": False,
        "drive_type": "acceleration",
        "mimics": False,
        "rigid_body": {"max_depenetration_velocity": 5.0, "angular_damping": 0.05},
        "articulation": {"self_collisions": False, "solver_position_iterations": 32},
    }
    robot = with_mimic(tiny_quadruped(), "FL_hip_joint", "FR_hip_joint", 1.0, 0.0)
    stage, found = build(robot, tmp_path, options)
    trunk = stage.GetPrimAtPath("/robot/trunk")
    assert trunk.GetAttribute("physxRigidBody:maxDepenetrationVelocity").Get() == 5.0
    assert trunk.GetAttribute("physxRigidBody:angularDamping").Get() == pytest.approx(0.05)
    assert trunk.GetAttribute("physxArticulation:solverPositionIterationCount").Get() == 32
    assert trunk.GetAttribute("physxArticulation:enabledSelfCollisions").Get() is False
    joint = stage.GetPrimAtPath("/robot/Joints/FL_hip_joint")
    assert UsdPhysics.DriveAPI(joint, "angular").GetTypeAttr().Get() == "acceleration"
    assert not joint.HasRelationship("newton:mimicJoint")
    assert [f.rule for f in found if f.subject == "joint FL_hip_joint"] == ["usd.mimic"]
    assert not [p for p in stage.Traverse() if p.IsInstance()]
    base = {"schema": "assetbuild/v1", "robot": "r", "source": {"path": ".", "urdf": "r.urdf"}}
    recipe = whole_model().model_validate(base | {"usd": options})
    assert Usd.configure(recipe).options == recipe.usd


def test_meshes_have_normals_by_the_winding_of_their_faces(tmp_path: Path) -> None:
    stage, _ = build(tiny_quadruped(), tmp_path)
    prim = stage.GetPrimAtPath("/robot/trunk/visuals/trunk_visual/mesh")
    if not prim:  # the instance's own prims are proxies
        prim = UsdCore.Stage.Open(str(tmp_path / "inputs/usd/payloads/geometries.usdc"))
        prim = prim.GetPrimAtPath("/Geometries/trunk_box/mesh")
    mesh = UsdGeom.Mesh(prim)
    assert mesh.GetNormalsInterpolation() == UsdGeom.Tokens.uniform
    normals = np.array(mesh.GetNormalsAttr().Get())
    points = np.array(mesh.GetPointsAttr().Get())
    faces = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
    assert len(normals) == len(faces) == 12
    outward = points[faces].mean(axis=1)  # a box about its own origin
    assert (np.einsum("ij,ij->i", normals, outward) > 0.0).all()
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0)
