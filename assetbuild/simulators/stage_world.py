"""Stages that PhysX is shown: the asset, untouched, in a small world of its own.

Everything that an experiment changes is an opinion in the layer of this world, above the asset.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade

from assetbuild.robot.pose import Pose
from assetbuild.simulators._moving import OBJECT, TABLE
from assetbuild.simulators.experiments import Gripped, Setting, StageNames

ROBOT = "/World/robot"
FLOOR_M = 100.0
PLAY = 1e-5
"""rad or m, to both sides of a locked joint: MuJoCo takes no range without any."""


def write_world(path: Path, main: Path, setting: Setting) -> StageNames:
    """Write a stage that references `main`; returns whose prims are whose."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    robot = UsdGeom.Xform.Define(stage, ROBOT)
    robot.GetPrim().GetReferences().AddReference(str(main))
    if setting.at is not None:
        _place(robot.GetPrim(), setting.at)
    gravity = np.asarray(setting.gravity)
    strength = float(np.linalg.norm(gravity))
    direction = gravity / strength if strength else np.array((0.0, 0.0, -1.0))
    scene = UsdPhysics.Scene.Define(stage, "/World/scene")
    scene.CreateGravityDirectionAttr(Gf.Vec3f(*direction.tolist()))
    scene.CreateGravityMagnitudeAttr(strength)
    steps = max(1, round(1.0 / setting.timestep))
    _foreign(
        scene.GetPrim(),
        "PhysxSceneAPI",
        {
            "physxScene:enableGPUDynamics": ("Bool", False),
            "physxScene:broadphaseType": ("Token", "MBP"),
            "physxScene:solverType": ("Token", "TGS"),
            "physxScene:timeStepsPerSecond": ("UInt", steps),
        },
    )
    names = _names(stage)
    if setting.floor_friction is not None:
        floor = UsdGeom.Plane.Define(stage, "/World/floor")
        floor.CreateAxisAttr(UsdGeom.Tokens.z)
        floor.CreateWidthAttr(FLOOR_M)
        floor.CreateLengthAttr(FLOOR_M)
        _make_solid(stage, floor.GetPrim(), setting.floor_friction * setting.slippery)
    if setting.base == "held":
        _hold_base(stage)
    if setting.gripped is not None:
        _define_object(stage, setting.gripped, names)
    for prim in Usd.PrimRange(robot.GetPrim()):
        _change(prim, names, setting)
    stage.Save()
    return names


def _names(stage: Usd.Stage) -> StageNames:
    bodies, joints, angular = {}, {}, set()
    for prim in Usd.PrimRange(stage.GetPrimAtPath(ROBOT)):
        name = str(prim.GetMetadata("displayName") or prim.GetName())
        if prim.HasAPI(UsdPhysics.RigidBodyAPI):
            bodies[str(prim.GetPath())] = name
        elif prim.IsA(UsdPhysics.Joint) and not _closes_loop(prim):
            joints[str(prim.GetPath())] = name
            if prim.IsA(UsdPhysics.RevoluteJoint):
                angular.add(name)
    return StageNames(bodies, joints, frozenset(angular))


def _closes_loop(prim: Usd.Prim) -> bool:
    return bool(UsdPhysics.Joint(prim).GetExcludeFromArticulationAttr().Get())


def _place(prim: Usd.Prim, pose: Pose) -> None:
    form = UsdGeom.Xformable(prim)
    form.ClearXformOpOrder()
    w, x, y, z = pose.quat
    form.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*pose.xyz))
    form.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Quatd(w, x, y, z))


def _make_solid(stage: Usd.Stage, prim: Usd.Prim, friction: float) -> Usd.Prim:
    """Make a shape touch things, with a material of its own; returns the material."""
    material = UsdShade.Material.Define(stage, f"{prim.GetPath()}_material")
    surface = UsdPhysics.MaterialAPI.Apply(material.GetPrim())
    surface.CreateStaticFrictionAttr(friction)
    surface.CreateDynamicFrictionAttr(friction)
    surface.CreateRestitutionAttr(0.0)
    UsdPhysics.CollisionAPI.Apply(prim)
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(
        material, UsdShade.Tokens.weakerThanDescendants, "physics"
    )
    return material.GetPrim()


def _define_object(stage: Usd.Stage, gripped: Gripped, names: StageNames) -> None:
    """The object and the table below it alone; the robot gets the object's friction too."""
    kind = {"cube": UsdGeom.Cube, "cylinder": UsdGeom.Cylinder, "sphere": UsdGeom.Sphere}
    solid = kind[gripped.shape].Define(stage, OBJECT)
    if gripped.shape == "cube":
        solid.CreateSizeAttr(gripped.size[0])
    else:
        solid.CreateRadiusAttr(gripped.size[0] / 2.0)
    if gripped.shape == "cylinder":
        solid.CreateHeightAttr(gripped.size[2])
    material = _make_solid(stage, solid.GetPrim(), gripped.friction)
    _foreign(material, "PhysxMaterialAPI", {"physxMaterial:frictionCombineMode": ("Token", "max")})
    # As MuJoCo's object: in Newton it resists turning.
    _foreign(solid.GetPrim(), "MjcCollisionAPI", {"mjc:condim": ("Int", 4)})
    mass = UsdPhysics.MassAPI.Apply(solid.GetPrim())
    mass.CreateMassAttr(gripped.mass)
    mass.CreateDiagonalInertiaAttr(Gf.Vec3f(*gripped.inertia))
    mass.CreatePrincipalAxesAttr(Gf.Quatf(1.0))
    table = UsdGeom.Xform.Define(stage, TABLE)
    board = UsdGeom.Cube.Define(stage, f"{TABLE}/board")
    board.CreateSizeAttr(1.0)
    UsdGeom.XformCommonAPI(board).SetTranslate((0.0, 0.0, -0.5))
    _make_solid(stage, board.GetPrim(), gripped.friction)
    filtered = UsdPhysics.FilteredPairsAPI.Apply(table.GetPrim())
    filtered.CreateFilteredPairsRel().SetTargets(list(names.bodies))
    for prim, pose in (
        (solid.GetPrim(), gripped.X_world_object),
        (table.GetPrim(), gripped.X_world_table),
    ):
        body = UsdPhysics.RigidBodyAPI.Apply(prim)
        body.CreateKinematicEnabledAttr(prim == table.GetPrim())
        _place(prim, pose)


def _hold_base(stage: Usd.Stage) -> None:
    """Move the articulation root from the root link to a fixed joint with the world.

    On the link itself, with a joint beside it, PhysX would let the base drift.
    """
    roots = [
        prim
        for prim in Usd.PrimRange(stage.GetPrimAtPath(ROBOT))
        if prim.HasAPI(UsdPhysics.ArticulationRootAPI) and not prim.IsA(UsdPhysics.Joint)
    ]
    for root in roots[:1]:
        joint = UsdPhysics.FixedJoint.Define(stage, "/World/robot/held_base")
        joint.CreateBody1Rel().SetTargets([root.GetPath()])
        UsdPhysics.ArticulationRootAPI.Apply(joint.GetPrim())
        joint.GetPrim().AddAppliedSchema("PhysxArticulationAPI")
        for attribute in root.GetAttributes():
            if attribute.GetName().startswith("physxArticulation:"):
                copy = joint.GetPrim().CreateAttribute(
                    attribute.GetName(), attribute.GetTypeName(), custom=False
                )
                copy.Set(attribute.Get())
        root.RemoveAPI(UsdPhysics.ArticulationRootAPI)
        for schema in ("PhysxArticulationAPI", "NewtonArticulationRootAPI"):
            root.RemoveAppliedSchema(schema)  # Newton's means a root by itself


def _change(prim: Usd.Prim, names: StageNames, setting: Setting) -> None:
    if not setting.contacts and prim.HasAPI(UsdPhysics.CollisionAPI):
        UsdPhysics.CollisionAPI(prim).CreateCollisionEnabledAttr(False)
    if prim.HasAPI(UsdPhysics.MaterialAPI):
        surface, gripped = UsdPhysics.MaterialAPI(prim), setting.gripped
        for attribute in (surface.GetStaticFrictionAttr(), surface.GetDynamicFrictionAttr()):
            friction = (attribute.Get() or 0.0) * setting.slippery
            attribute.Set(gripped.friction if gripped else friction)
    name = names.joints.get(str(prim.GetPath()))
    if name is None:
        if not setting.loops and prim.IsA(UsdPhysics.Joint) and _closes_loop(prim):
            prim.SetActive(False)
        return
    if not setting.rubbing:
        for attribute in prim.GetAttributes():
            spelled = attribute.GetName().lower()
            if spelled.startswith(("physxjoint", "newton:")) and (
                "friction" in spelled or spelled == "newton:damping"
            ):
                attribute.Set(0.0)
    for attribute in () if setting.limited else prim.GetAttributes():
        if attribute.GetName().endswith((":physics:maxForce", ":maxJointVelocity")):
            attribute.Block()  # unwritten, it is not limited
    if name in setting.locked:
        for end, off in (("lower", -PLAY), ("upper", PLAY)):
            value = setting.locked[name] + off
            shown = math.degrees(value) if name in names.angular else value
            prim.CreateAttribute(f"physics:{end}Limit", Sdf.ValueTypeNames.Float).Set(shown)
    actuator = (setting.drives or {}).get(name)
    if actuator is not None:
        per = math.pi / 180.0 if name in names.angular else 1.0
        kind = "angular" if name in names.angular else "linear"
        drive = UsdPhysics.DriveAPI.Apply(prim, kind)
        drive.CreateTypeAttr(setting.drive_type)
        drive.CreateStiffnessAttr(actuator.kp * per)
        drive.CreateDampingAttr(actuator.kd * per)


def _foreign(prim: Usd.Prim, schema: str, values: dict[str, tuple[str, object]]) -> None:
    prim.AddAppliedSchema(schema)
    for name, (kind, value) in values.items():
        value_type = getattr(Sdf.ValueTypeNames, kind)
        prim.CreateAttribute(name, value_type, custom=False).Set(value)
