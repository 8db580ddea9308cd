"""`scene.usda`: the robot at home on a floor, with gravity and light, to look at and press play.

The robot's own file holds none of these: a training framework brings its own.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdLux, UsdPhysics, UsdShade

from assetbuild.robot.model import Control
from assetbuild.robot.pose import IDENTITY, Pose
from assetbuild.robot.tree import forward_kinematics
from assetbuild.simulators.usd_names import PHYSICS_MATERIALS
from assetbuild.targets.usd.colliders import define_surface
from assetbuild.targets.usd.joints import starting_positions
from assetbuild.targets.usd.layers import apply_foreign, new_stage, save, set_place
from assetbuild.targets.usd.names import PrimPaths

SCENE = "scene.usda"
FLOOR_M = 20.0
CLEARANCE_M = 1e-3
"""The soles start this far above the floor. PhysX throws out a sole that starts inside of it, by
rounding alone, with all of `maxDepenetrationVelocity`."""


def write_scene(folder: Path, main: str, names: PrimPaths, control: Control) -> None:
    """A world that references `main`, the robot at the keyframe `home`.

    Without that keyframe near q = 0. A fixed root is where the asset's own prim has it, any other
    in the origin.
    """
    stage = new_stage(folder / SCENE)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    _define_physics(stage, control)
    floor = UsdGeom.Plane.Define(stage, "/World/floor")
    floor.CreateAxisAttr(UsdGeom.Tokens.z)
    floor.CreateWidthAttr(FLOOR_M)
    floor.CreateLengthAttr(FLOOR_M)
    floor.CreateExtentAttr([(-FLOOR_M / 2, -FLOOR_M / 2, 0.0), (FLOOR_M / 2, FLOOR_M / 2, 0.0)])
    UsdPhysics.CollisionAPI.Apply(floor.GetPrim())
    _bind_surface(stage, floor.GetPrim(), control)
    UsdLux.DomeLight.Define(stage, "/World/light").CreateIntensityAttr(1000.0)
    robot = UsdGeom.Xform.Define(stage, f"/World/{names.root}").GetPrim()
    robot.GetReferences().AddReference(f"./{main}")
    joints = starting_positions(names.tree, control)  # where the asset's own joints start
    X_world_base = IDENTITY
    if control.home and control.home.base is not None:
        X_world_base = Pose((0.0, 0.0, CLEARANCE_M)) @ control.home.base
    for body, X_root_body in forward_kinematics(names.tree, joints).items():
        prim = stage.OverridePrim(f"/World{names.body(body)}")
        set_place(prim, X_world_base @ X_root_body)
    save(stage)


def _bind_surface(stage: Usd.Stage, floor: Usd.Prim, control: Control) -> None:
    """The robot's least friction, as in `scene.xml`: PhysX takes the mean of two surfaces."""
    surfaces = [control.contact, *(own for _, own in control.contacts if not own.priority)]
    sliding, torsional, rolling = (
        min(values) for values in zip(*(s.friction for s in surfaces), strict=True)
    )
    UsdGeom.Scope.Define(stage, f"/World/{PHYSICS_MATERIALS}")
    path = f"/World/{PHYSICS_MATERIALS}/floor"
    surface = define_surface(stage, path, (sliding, torsional, rolling))
    UsdShade.MaterialBindingAPI.Apply(floor).Bind(
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
