"""One thing changed on the stage, and a finding names it with both values."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from gripper import gripper
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics
from robot_files import about, check_inputs, run_step, spoil_stage
from tiny import TinyRobot, four_bar, pendulum, sprung, tiny_quadruped, with_control

from assetbuild.errors import UsageError
from assetbuild.facts.readers._usd import UsdReader, UsdSceneReader, ignored_words
from assetbuild.findings import Finding
from assetbuild.robot.model import Contact, Simulation
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.targets.usd import Usd as UsdTarget

JOINTS = "/robot/Joints"
Spoil = Callable[[Usd.Stage], object]


def check(
    robot: TinyRobot,
    folder: Path,
    spoil: Spoil | None = None,
    options: UsdOptions | None = None,
    layer: str = "robot.usda",
) -> list[Finding]:
    options = options or UsdOptions()
    inputs = check_inputs(folder, robot, UsdTarget(robot="robot", options=options), "usd")
    if spoil is not None:
        spoil_stage(inputs / "usd" / layer, spoil)
    kind = UsdSceneReader if layer == "scene.usda" else UsdReader
    reader = kind(robot="robot", options={"usd": options.model_dump(mode="json")})
    findings = run_step(reader, inputs, folder / "out")
    assert {f.severity for f in findings} <= {"error"}
    return findings


def test_a_spring_is_the_drive_of_a_joint_that_has_no_other(tmp_path: Path) -> None:
    assert check(sprung(), tmp_path) == []
    main = next(tmp_path.rglob("robot.usda"))
    stage = Usd.Stage.Open(str(main))
    drive = UsdPhysics.DriveAPI(stage.GetPrimAtPath(f"{JOINTS}/swing_joint"), "angular")
    assert math.degrees(drive.GetStiffnessAttr().Get()) == pytest.approx(6.0)
    assert math.radians(drive.GetTargetPositionAttr().Get()) == pytest.approx(0.5)
    assert (drive.GetDampingAttr().Get(), drive.GetMaxForceAttr().Get()) == (0.0, math.inf)


@pytest.mark.parametrize("end", [1e6, 5e6])
def test_a_range_that_means_none_is_the_stated_one(end: float, tmp_path: Path) -> None:
    """Wheels of public URDFs are hinges of +-1e6 rad."""
    robot = pendulum()
    limits = replace(robot.tree.joints[0].limits, lower=-end, upper=end)
    joints = (replace(robot.tree.joints[0], limits=limits),)
    tree = replace(robot.tree, joints=joints)
    assert check(replace(robot, tree=tree, links=tree), tmp_path) == []


def test_neighbours_whose_masks_never_meet_are_told_apart_by_their_joint(tmp_path: Path) -> None:
    never = Contact(contype=2, conaffinity=1)
    robot = with_control(gripper(), contact=never, contacts=(), excludes=())
    assert check(robot, tmp_path) == []


def test_the_scene_of_a_robot_on_the_moon_is_equal(tmp_path: Path) -> None:
    moon = Simulation(gravity=(0.0, 0.3, -1.6), timestep=0.003)
    feet = (("FR_foot_collision", Contact(friction=(0.5, 0.01, 0.02))),)
    robot = with_control(tiny_quadruped(), simulation=moon, contacts=feet)
    assert check(robot, tmp_path, layer="scene.usda") == []


@pytest.mark.parametrize("name", ["physics", "floor", "PhysicsMaterials"])
def test_a_robot_may_be_called_like_a_part_of_the_scene(name: str, tmp_path: Path) -> None:
    inputs = check_inputs(tmp_path, tiny_quadruped(), UsdTarget(robot=name), "usd")
    assert run_step(UsdSceneReader(robot=name), inputs, tmp_path / "out") == []


def test_identifiers_options_and_masks_are_equal(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    none = Contact(friction=(0.8, 0.02, 0.01), contype=0, conaffinity=0)
    foot = Contact(friction=(1.2, 0.02, 0.01), contype=2, conaffinity=4)
    contacts = (("trunk_collision", none), ("FR_foot_collision", foot))
    joints = tuple(replace(j, name=f"{j.name}.1") for j in robot.tree.joints)
    rows = tuple(replace(a, joint=f"{a.joint}.1", effort=None, velocity=None)
                 for a in robot.control.actuators)  # fmt: skip
    robot = replace(robot, tree=replace(robot.tree, joints=joints))
    robot = with_control(robot, actuators=rows, keyframes=(), contacts=contacts)
    options = UsdOptions.model_validate({
        "instanceable": False, "drive_type": "acceleration", "mimics": False,
        "rigid_body": {"linear_damping": 0.1, "max_angular_velocity": 50.0},
        "articulation": {"self_collisions": False, "solver_position_iterations": 4},
    })  # fmt: skip
    assert check(robot, tmp_path, options=options) == []


def test_a_default_that_a_tool_states_is_no_difference(tmp_path: Path) -> None:
    """Isaac Sim writes these when anybody touches a body or a joint."""

    def state(stage: Usd.Stage) -> None:
        body = UsdPhysics.RigidBodyAPI(stage.GetPrimAtPath("/robot/trunk"))
        body.GetRigidBodyEnabledAttr().Set(True)
        body.CreateVelocityAttr().Set(Gf.Vec3f(0.0))
        UsdPhysics.Joint(stage.GetPrimAtPath(HIP)).CreateJointEnabledAttr().Set(True)

    assert check(tiny_quadruped(), tmp_path, state) == []


# --- one attribute

HIP = f"{JOINTS}/FR_hip_joint"
FOOT = "/robot/FR_calf/collisions/FR_foot_collision"


def times(factor: float) -> Callable[[object], object]:
    return lambda value: value * factor  # type: ignore[operator] # a number or a vector


ATTRIBUTES = [
    ("mass", "body FR_hip", "/robot/FR_hip.physics:mass", times(1.000001)),
    ("inertia", "body trunk", "/robot/trunk.physics:principalAxes",
     lambda _: Gf.Quatf(0.9, 0.1, 0.2, 0.3)),
    ("kp", "joint FR_hip_joint", f"{HIP}.drive:angular:physics:stiffness", times(57.3)),
    ("drive_type", "joint FR_hip_joint", f"{HIP}.drive:angular:physics:type",
     lambda _: "acceleration"),
    ("start", "joint FR_thigh_joint",
     f"{JOINTS}/FR_thigh_joint.state:angular:physics:position", times(-1.0)),
    ("upper", "joint FR_hip_joint", f"{HIP}.physics:upperLimit", times(1.000001)),
    ("armature", "joint FR_hip_joint", f"{HIP}.physxJointAxis:angular:armature", times(100.0)),
    ("limitstiffness", "joint FR_hip_joint", f"{HIP}.newton:limitStiffness", times(57.3)),
    ("condim", "shape FR_foot_collision", f"{FOOT}.mjc:condim", lambda _: 6),
    ("anchor", "joint FR_hip_joint", f"{HIP}.physics:localPos1", lambda _: Gf.Vec3f(0, 0, 0.01)),
    ("pose", "body FR_calf", "/robot/FR_calf.xformOp:translate", times(1.01)),
    ("size", "shape FR_foot_collision", f"{FOOT}.radius", times(10.0)),
    ("purpose", "shape FR_foot_collision", f"{FOOT}.purpose", lambda _: "render"),
    ("solverpositioniterationcount", "body trunk",
     "/robot/trunk.physxArticulation:solverPositionIterationCount", lambda _: 4),
    ("friction", "shape FR_foot_collision",
     "/robot/PhysicsMaterials/contact.physics:staticFriction", times(0.1)),
]  # fmt: skip
FOLLOWS, TILE, LOOP = f"{JOINTS}/b_joint", "/Geometries/tile/mesh", "/robot/Loops/coupler_loop"
OF_A_GRIPPER = [
    ("mimic_multiplier", "joint b_joint", f"{FOLLOWS}.physxMimicJoint:rotX:gearing", times(-1.0)),
    ("reference_axis", "joint b_joint", f"{FOLLOWS}.physxMimicJoint:rotX:referenceJointAxis",
     lambda _: "rotY"),
    ("mimic_multiplier", "joint b_joint", f"{FOLLOWS}.newton:mimicCoef1", times(-1.0)),
    ("texture_corners", "shape skin", f"{TILE}.primvars:st",
     lambda v: [(1.5 * uv[0], uv[1]) for uv in v]),
    ("doublesided", "shape skin", f"{TILE}.doubleSided", lambda _: False),
    ("subdivisionscheme", "shape skin", f"{TILE}.subdivisionScheme", lambda _: "catmullClark"),
    ("normals", "shape skin", f"{TILE}.normals", lambda v: list(v)[1:]),
    ("triangles", "shape skin", f"{TILE}.faceVertexIndices", lambda v: [0, 0, 9, *list(v)[3:]]),
    ("volume", "shape skin", f"{TILE}.faceVertexIndices", lambda v: [v[1], v[0], *list(v)[2:]]),
]  # fmt: skip
OF_A_LOOP = [
    ("end_a", "loop coupler_loop", f"{LOOP}.physics:localPos0", times(1.01)),
    ("missing", "loop coupler_loop", f"{LOOP}.physics:excludeFromArticulation", lambda _: False),
    ("solimp", "loop coupler_loop", f"{LOOP}.mjc:solimp", lambda _: [0.1, 0.95, 0.001, 0.5, 2.0]),
]
SCENE, FLOOR = "/World/physics", "/World/PhysicsMaterials/floor"
OF_THE_SCENE = [
    ("gravity", "simulation", f"{SCENE}.physics:gravityMagnitude", lambda _: 9.0),
    ("gravity", "simulation", f"{SCENE}.physics:gravityDirection", times(-1.0)),
    ("timestep", "simulation", f"{SCENE}.physxScene:timeStepsPerSecond", lambda _: 100),
    ("friction", "floor", f"{FLOOR}.physics:staticFriction", times(0.1)),
    ("restitution", "floor", f"{FLOOR}.physics:restitution", lambda _: 0.5),
    ("frictioncombinemode", "floor", f"{FLOOR}.physxMaterial:frictionCombineMode", lambda _: "min"),
    ("size", "floor", "/World/floor.width", lambda _: 1.0),
    ("initial_pose", "start FR_calf", "/World/robot/FR_calf.xformOp:translate", times(2.0)),
    ("intensity", "light", "/World/light.inputs:intensity", lambda _: 1.0),
]


@pytest.mark.parametrize(
    ("robot", "rule", "subject", "attribute", "change"),
    [(tiny_quadruped(), *row) for row in ATTRIBUTES + OF_THE_SCENE]
    + [(gripper(), *row) for row in OF_A_GRIPPER]
    + [(four_bar("weld"), *row) for row in OF_A_LOOP],
)
def test_a_changed_attribute_is_named_with_both_values(
    robot: TinyRobot,
    rule: str,
    subject: str,
    attribute: str,
    change: Callable[[object], object],
    tmp_path: Path,
) -> None:
    def spoil(stage: Usd.Stage) -> None:
        found = stage.GetAttributeAtPath(attribute)
        assert found, attribute
        assert found.Set(change(found.Get()))

    places = {TILE: ("payloads/geometries.usdc", "usd"), "/World": ("scene.usda", "usd_scene")}
    of = next((place for place in places if attribute.startswith(place)), "")
    layer, form = places.get(of, ("robot.usda", "usd"))
    findings = check(robot, tmp_path, spoil, layer=layer)
    ours = [f for f in findings if f.rule == f"equal.{form}.{rule}"]
    assert any(subject in {f.subject, *f.data.get("subjects", ())} for f in ours)
    assert rule == "missing" or all({"expected", "found"} <= set(f.data) for f in ours)


def test_what_libraries_and_tools_read_is_found(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        robot = stage.GetDefaultPrim()
        Usd.ModelAPI(robot).SetKind("assembly")
        stage.GetRootLayer().customLayerData = {"SimReady_Metadata": {"mass": 1.0}}
        robot.CreateAttribute("isaac:robotType", Sdf.ValueTypeNames.Token).Set("Humanoid")
        stage.GetPrimAtPath(HIP).RemoveAppliedSchema("IsaacJointAPI")
        stage.GetPrimAtPath(HIP).RemoveAppliedSchema("PhysxJointAPI")
        stage.GetPrimAtPath("/robot/trunk/visuals/trunk_visual").SetInstanceable(False)

    found = about(check(tiny_quadruped(), tmp_path, spoil))
    words = ("kind", "mass", "rigid_body_count", "robottype", "robotjoints")
    assert {(f"equal.usd.{word}", "robot") for word in words} <= found
    instanced = ("equal.usd.instanced", "shape trunk_visual")
    assert {instanced, ("equal.usd.engines", "joint FR_hip_joint")} <= found


def test_one_material_for_all_is_found(tmp_path: Path) -> None:
    def bind(stage: Usd.Stage) -> None:
        for path, name, material in (
            ("/robot/a/collisions/a_pad", "material:binding:physics", "PhysicsMaterials/contact"),
            ("/robot/b/visuals/b_skin", "material:binding", "Looks/wood"),
        ):
            stage.GetPrimAtPath(path).GetRelationship(name).SetTargets([f"/robot/{material}"])

    found = about(check(gripper(), tmp_path, bind))
    assert {("equal.usd.friction", "shape a_pad"), ("equal.usd.rgba", "shape b_skin"),
            ("equal.usd.dynamicfriction", "shape a_pad"), ("equal.usd.texture", "shape b_skin"),
            ("equal.usd.material", "shape b_skin")} <= found  # fmt: skip


def test_a_word_of_an_engine_that_nobody_reads_is_told(tmp_path: Path) -> None:
    found = check(tiny_quadruped(), tmp_path, lambda stage: UsdPhysics.MassAPI(
        stage.GetPrimAtPath("/robot/trunk")).CreateDensityAttr(7.0))  # fmt: skip
    assert [(f.rule, f.subject) for f in found] == [("equal.usd.density", "body trunk")]
    tables = map(UsdReader(robot="robot").read, tmp_path.rglob("robot.usda"))
    told = [finding for table in tables for finding in ignored_words(table)]
    assert [(f.rule, f.data) for f in told] == [
        ("usd.ignored", {"attributes": ("physics:density",)})
    ]


def test_lost_filters_are_found(tmp_path: Path) -> None:
    def lose(stage: Usd.Stage) -> None:
        for prim in stage.Traverse():
            if prim.HasAPI(UsdPhysics.FilteredPairsAPI):
                prim.GetRelationship("physics:filteredPairs").SetTargets([])

    found = {f.subject: f for f in check(gripper(), tmp_path, lose)}
    assert found["pair a b"].data["subjects"] == ("pair a b", "pair a slide", "pair b slide")
    assert found["shape pair a_pad base_hull"].rule == "equal.usd.filtered"


def test_an_axis_that_points_the_other_way_is_found(tmp_path: Path) -> None:
    """Both frames turned by half a turn: consistent, and every command has the wrong sign."""

    def spoil(stage: Usd.Stage) -> None:
        joint = UsdPhysics.RevoluteJoint(stage.GetPrimAtPath(HIP))
        joint.GetLocalRot0Attr().Set(Gf.Quatf(0, 0, 1, 0))
        joint.GetLocalRot1Attr().Set(Gf.Quatf(0, 0, 1, 0))

    findings = check(tiny_quadruped(), tmp_path, spoil)
    assert about(findings) == {("equal.usd.axis", "joint FR_hip_joint")}


@pytest.mark.parametrize(
    ("rule", "subject", "spoil"),
    [
        ("metres_per_unit", "robot", lambda s: UsdGeom.SetStageMetersPerUnit(s, 0.01)),
        ("articulation_root", "robot", lambda s: UsdPhysics.ArticulationRootAPI.Apply(
            s.GetPrimAtPath("/robot/FR_hip"))),
        ("collides", "shape FR_foot_collision", lambda s: UsdPhysics.CollisionAPI(
            s.GetPrimAtPath(FOOT)).CreateCollisionEnabledAttr(False)),
        ("missing", "joint FR_hip_joint", lambda s: s.GetDefaultPrim().GetVariantSet(
            "Physics").SetVariantSelection("none")),
        ("base", "robot", lambda s: UsdPhysics.FixedJoint.Define(
            s, "/robot/Joints/root_joint").CreateBody1Rel().SetTargets(["/robot/trunk"])),
        ("robotlinks", "robot", lambda s: s.GetDefaultPrim().GetRelationship(
            "isaac:physics:robotLinks").RemoveTarget("/robot/FR_hip")),
        ("robotlinks", "robot", lambda s: s.GetPrimAtPath("/robot/FR_hip").CreateAttribute(
            "isaac:nameOverride", Sdf.ValueTypeNames.String).Set("FL_hip")),
        ("height", "floor", lambda s: UsdGeom.Xformable(
            s.GetPrimAtPath("/World/floor")).AddTranslateOp().Set((0.0, 0.0, 0.1))),
        ("collides", "floor", lambda s: s.GetPrimAtPath("/World/floor").RemoveAPI(
            UsdPhysics.CollisionAPI)),
        ("friction", "floor", lambda s: s.GetRelationshipAtPath(
            "/World/floor.material:binding:physics").SetTargets([])),
    ],
)  # fmt: skip
def test_what_is_said_of_whole_prims_is_compared(
    rule: str, subject: str, spoil: Spoil, tmp_path: Path
) -> None:
    layer, form = ("scene.usda", "usd_scene") if subject == "floor" else ("robot.usda", "usd")
    found = check(tiny_quadruped(), tmp_path, spoil, layer=layer)
    assert (f"equal.{form}.{rule}", subject) in about(found)


def test_a_layer_that_is_no_usd_is_one_finding(tmp_path: Path) -> None:
    """With the prim and the line, in USD's own words."""
    inputs = check_inputs(tmp_path, tiny_quadruped(), UsdTarget(robot="robot"), "usd")
    path = inputs / "usd/payloads/base.usda"
    path.write_text(path.read_text().replace("quatd xformOp:orient", "xformOp:orient", 1))
    (found,) = run_step(UsdReader(robot="robot"), inputs, tmp_path / "out")
    assert found.rule == "equal.unreadable"
    assert "payloads/base.usda:" in found.message and "</robot/trunk>" in found.message
    (inputs / "usd/robot.usda").write_text("not usd")
    (found,) = run_step(UsdReader(robot="robot"), inputs, tmp_path / "out")
    assert found.rule == "equal.unreadable"
    Usd.Stage.CreateNew(str(tmp_path / "none.usda")).Save()
    with pytest.raises(UsageError, match="no default prim"):
        UsdReader(robot="none").read(tmp_path / "none.usda")


# --- anybody's USD


def test_any_stage_is_read_in_metres_and_kilograms(tmp_path: Path) -> None:
    """Centimetres and grams: an arm of 2 kg on a wall, half a metre above its base."""
    path = tmp_path / "arm.usda"
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 0.001)
    top = UsdGeom.Xform.Define(stage, "/arm").GetPrim()
    stage.SetDefaultPrim(top)
    for name, height in (("base", 0.0), ("link", 50.0)):
        body = UsdGeom.Xform.Define(stage, f"/arm/{name}")
        body.AddTranslateOp().Set((0.0, 0.0, height))
        UsdPhysics.RigidBodyAPI.Apply(body.GetPrim())
        mass = UsdPhysics.MassAPI.Apply(body.GetPrim())
        mass.CreateMassAttr(2000.0)
        mass.CreateCenterOfMassAttr((0.0, 0.0, 10.0))
    cube = UsdGeom.Cube.Define(stage, "/arm/link/shape")
    cube.CreateSizeAttr(10.0)
    UsdPhysics.CollisionAPI.Apply(cube.GetPrim())
    world = UsdPhysics.FixedJoint.Define(stage, "/arm/hold")
    world.CreateBody1Rel().SetTargets(["/arm/base"])
    hinge = UsdPhysics.RevoluteJoint.Define(stage, "/arm/hinge")
    hinge.CreateBody0Rel().SetTargets(["/arm/base"])
    hinge.CreateBody1Rel().SetTargets(["/arm/link"])
    hinge.CreateLocalPos0Attr((0.0, 0.0, 50.0))
    drive = UsdPhysics.DriveAPI.Apply(hinge.GetPrim(), "angular")
    drive.CreateStiffnessAttr(1e7)  # g cm2 / s2 per degree
    drive.CreateMaxForceAttr(1e7)
    stage.Save()
    table = UsdReader(robot="arm").read(path)
    assert table.of("robot", "")["base"] == "fixed"
    assert table.of("body", "link")["mass"] == pytest.approx(2.0)
    assert table.of("body", "link")["centre of mass"] == pytest.approx((0.0, 0.0, 0.1))
    assert table.of("body", "link")["pose"] == pytest.approx((0, 0, 0.5, 1, 0, 0, 0))
    joint = table.of("joint", "hinge")
    assert joint["kp"] == pytest.approx(1.0 * 180 / math.pi)
    assert joint["effort"] == pytest.approx(1.0)
    assert joint["lower"] is None
    assert joint["usd:child pose"] == pytest.approx((0, 0, 0.5, 1, 0, 0, 0))
    assert table.of("shape", "shape")["size"] == pytest.approx((0.1, 0.1, 0.1))


def test_a_body_that_is_its_own_shape_is_both(tmp_path: Path) -> None:
    path = tmp_path / "ball.usda"
    stage = Usd.Stage.CreateNew(str(path))
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/r").GetPrim())
    ball = UsdGeom.Sphere.Define(stage, "/r/ball").GetPrim()
    UsdPhysics.RigidBodyAPI.Apply(ball)
    UsdPhysics.CollisionAPI.Apply(ball)
    stage.Save()
    table = UsdReader(robot="r").read(path)
    assert table.names("body") == table.names("shape") == ("ball",)
    assert table.of("shape", "ball")["size"] == (0.01,)  # a stage without units is in centimetres
