"""`scene.usda`: the robot in its initial pose on a floor, with gravity and light.

The robot's own file holds none of these: a training framework brings its own.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdLux, UsdPhysics, UsdShade

from assetbuild.robot.floor import Floor, floor_of
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Control
from assetbuild.robot.pose import IDENTITY, Pose
from assetbuild.robot.tree import forward_kinematics
from assetbuild.simulators.usd_names import PHYSICS_MATERIALS, scene_identifier
from assetbuild.targets.usd.colliders import define_surface
from assetbuild.targets.usd.layers import apply_foreign, new_stage, save, set_place
from assetbuild.targets.usd.names import PrimPaths

SCENE = "scene.usda"
FLOOR_M = 20.0
CLEARANCE_M = 1e-3
"""The soles start this far above the floor. PhysX throws out a sole that starts inside of it, by
rounding alone, with all of `maxDepenetrationVelocity`."""


def write_scene(folder: Path, main: str, names: PrimPaths, control: Control) -> None:
    """A world that references `main`, the robot in its initial pose.

    A fixed root is where the asset's own prim has it, a floating one without a keyframe in the
    origin.
    """
    stage = new_stage(folder / SCENE)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    _define_physics(stage, control)
    _define_floor(stage, floor_of(names.tree, control))
    UsdLux.DomeLight.Define(stage, "/World/light").CreateIntensityAttr(1000.0)
    robot = UsdGeom.Xform.Define(stage, f"/World/{scene_identifier(names.root)}").GetPrim()
    robot.GetReferences().AddReference(f"./{main}")
    start = initial_pose(names.tree, control)
    X_world_base = IDENTITY
    if start.base is not None:
        X_world_base = Pose((0.0, 0.0, CLEARANCE_M)) @ start.base
    for body, X_root_body in forward_kinematics(names.tree, dict(start.joints)).items():
        below = names.body(body).removeprefix(f"/{names.root}")
        prim = stage.OverridePrim(f"{robot.GetPath()}{below}")
        set_place(prim, X_world_base @ X_root_body)
    save(stage)


def _define_floor(stage: Usd.Stage, ground: Floor) -> None:
    floor = UsdGeom.Plane.Define(stage, "/World/floor")
    floor.CreateAxisAttr(UsdGeom.Tokens.z)
    floor.CreateWidthAttr(FLOOR_M)
    floor.CreateLengthAttr(FLOOR_M)
    floor.CreateExtentAttr([(-FLOOR_M / 2, -FLOOR_M / 2, 0.0), (FLOOR_M / 2, FLOOR_M / 2, 0.0)])
    if ground.height_m:
        floor.AddTranslateOp().Set(Gf.Vec3d(0.0, 0.0, ground.height_m))
    UsdPhysics.CollisionAPI.Apply(floor.GetPrim())
    UsdGeom.Scope.Define(stage, f"/World/{PHYSICS_MATERIALS}")
    surface = define_surface(stage, f"/World/{PHYSICS_MATERIALS}/floor", ground.friction)
    UsdShade.MaterialBindingAPI.Apply(floor.GetPrim()).Bind(
        surface, UsdShade.Tokens.weakerThanDescendants, "physics"
    )


def _define_physics(stage: Usd.Stage, control: Control) -> None:
    scene = UsdPhysics.Scene.Define(stage, "/World/physics")
    gravity = np.asarray(control.simulation.gravity)
    strength = float(np.linalg.norm(gravity))
    direction = gravity / strength if strength > 0.0 else np.array((0.0, 0.0, -1.0))
    scene.CreateGravityDirectionAttr(Gf.Vec3f(*direction.tolist()))
    scene.CreateGravityMagnitudeAttr(strength)
    rate = round(1.0 / control.simulation.timestep)
    apply_foreign(scene.GetPrim(), "PhysxSceneAPI", "physxScene", {"timeStepsPerSecond": rate})
