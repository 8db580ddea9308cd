"""`scene.usda`: the robot at home on a floor, with gravity and light, to look at and press play.

The robot's own file holds none of these: a training framework brings its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from assetbuild.robot.kinematics import forward_kinematics
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.pose import Pose
from assetbuild.targets.usd.layers import apply_foreign, new_stage, save, set_place
from assetbuild.targets.usd.names import Names

if TYPE_CHECKING:
    from pxr import Usd

SCENE = "scene.usda"
FLOOR_M = 20.0


def write_scene(
    folder: Path, main: str, names: Names, control: Control, poses: Mapping[str, Pose]
) -> None:
    """A world that references `main`; poses: X_world_body of every body, by name."""
    from pxr import UsdGeom, UsdLux, UsdPhysics

    stage = new_stage(folder / SCENE)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    _define_physics(stage, control)
    floor = UsdGeom.Plane.Define(stage, "/World/floor")
    floor.CreateAxisAttr(UsdGeom.Tokens.z)
    floor.CreateWidthAttr(FLOOR_M)
    floor.CreateLengthAttr(FLOOR_M)
    floor.CreateExtentAttr([(-FLOOR_M / 2, -FLOOR_M / 2, 0.0), (FLOOR_M / 2, FLOOR_M / 2, 0.0)])
    UsdPhysics.CollisionAPI.Apply(floor.GetPrim())
    UsdLux.DomeLight.Define(stage, "/World/light").CreateIntensityAttr(1000.0)
    robot = UsdGeom.Xform.Define(stage, f"/World/{names.root}").GetPrim()
    robot.GetReferences().AddReference(f"./{main}")
    for body, pose in poses.items():
        prim = stage.OverridePrim(f"/World/{names.root}/{names.bodies[body]}")
        set_place(prim, pose)
    save(stage)


def home_poses(tree: Tree, control: Control, X_world_root: Pose) -> dict[str, Pose]:
    """X_world_body at the keyframe `home`; at q = 0 and X_world_root without one."""
    home = next((key for key in control.keyframes if key.name == "home"), None)
    joints = dict(home.joints) if home else {}
    X_world_base = home.base if home and home.base is not None else X_world_root
    return {
        body: X_world_base @ X_root_body
        for body, X_root_body in forward_kinematics(tree, joints).items()
    }


def _define_physics(stage: Usd.Stage, control: Control) -> None:
    from pxr import Gf, UsdPhysics

    scene = UsdPhysics.Scene.Define(stage, "/World/physics")
    gravity = np.asarray(control.simulation.gravity)
    strength = float(np.linalg.norm(gravity))
    direction = gravity / strength if strength > 0.0 else np.array((0.0, 0.0, -1.0))
    scene.CreateGravityDirectionAttr(Gf.Vec3f(*direction.tolist()))
    scene.CreateGravityMagnitudeAttr(strength)
    rate = round(1.0 / control.simulation.timestep)
    apply_foreign(
        scene.GetPrim(), "PhysxSceneAPI", {"physxScene:timeStepsPerSecond": ("UInt", rate)}
    )
