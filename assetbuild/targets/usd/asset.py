"""The layers of the asset, from the inside out, so that each finds what it refers to.

The scene comes last. Alone among the modules that the target imports these need USD's library: they
are imported late.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdPhysics, UsdShade

from assetbuild.findings import Finding
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.floor import Floor, floor_of
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.mjcf_only import whole_gravity
from assetbuild.robot.model import Control, Keyframe, Tree
from assetbuild.robot.pose import IDENTITY, Pose
from assetbuild.robot.sections import About
from assetbuild.robot.tree import forward_kinematics
from assetbuild.simulators.usd_names import (
    METADATA,
    NO_DATE,
    PHYSICS_MATERIALS,
    POSES,
    ROBOT_QCODE,
    ROOT_JOINT,
    scene_identifier,
    usd_identifiers,
)
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.targets.usd.bodies import apply_rigid_bodies, write_base
from assetbuild.targets.usd.colliders import (
    apply_filtered_pairs,
    apply_masks,
    define_colliders,
    define_surface,
    touching_neighbours,
)
from assetbuild.targets.usd.geometry import write_instances, write_materials
from assetbuild.targets.usd.joints import (
    apply_articulation,
    define_actuators,
    define_joints,
    define_loops,
)
from assetbuild.targets.usd.layers import (
    GEOMETRIES,
    PAYLOADS,
    apply_foreign,
    label,
    new_interface,
    new_layer,
    new_stage,
    save,
    save_by_engine,
    set_place,
)
from assetbuild.targets.usd.names import PrimPaths
from assetbuild.targets.usd.units import coordinate
from assetbuild.targets.usd.unsupported import unsupported


def write_asset(
    folder: Path,
    robot: str,
    files: RobotFiles,
    options: UsdOptions,
    about: About,
    licence: str | None,
    source: str | None,
) -> Iterator[Finding]:
    """`<robot>.usda`, its payloads and `scene.usda`. source: what it was built from."""
    tree, shapes, control = files.tree, files.shapes.all_coloured, files.control
    names = PrimPaths(robot, tree, shapes)
    payloads, main = folder / PAYLOADS, f"{robot}.usda"
    payloads.mkdir(parents=True)
    (payloads / GEOMETRIES).symlink_to(files.folder / GEOMETRIES)
    write_materials(payloads, names, shapes, files.mesh_dir)
    write_instances(payloads, names, shapes, instanceable=options.instanceable)
    write_base(payloads, names, robot, control.cameras)
    # What the variants of `Physics` add to the robot.
    stage = new_layer(payloads / "physics.usda", names)
    weightless = whole_gravity(control.mjcf_only)
    yield from apply_rigid_bodies(stage, names, options.rigid_body, weightless)
    yield from define_colliders(stage, names, shapes, control)
    touching = touching_neighbours(names, shapes, control)
    define_joints(stage, names, control, options, touching)
    define_loops(stage, names, control, touching)
    define_actuators(stage, names, control)
    apply_articulation(stage, names, options.articulation.solving(control.loops))
    apply_filtered_pairs(stage, names, shapes, control)
    apply_masks(stage, names, shapes, control)
    apply_robot_schema(stage, names, control, options)
    save_by_engine(stage, payloads, names)
    interface = new_interface(folder / main, names)
    write_metadata(interface, robot, tree, about, licence, source)
    save(interface)
    if main != SCENE:
        write_scene(folder, main, names, control)
    yield from names.findings(robot)
    yield from unsupported(tree, control, options)


# --- Isaac Sim's robot schema --------------------------------------------------------------------


def apply_robot_schema(
    stage: Usd.Stage, names: PrimPaths, control: Control, options: UsdOptions
) -> None:
    """Links, joints, sites and keyframes; after all of them are defined.

    Isaac Sim's tools list, name and pose a robot by these; PhysX and Newton do not read them. Sites
    follow their link, and the joint that holds a fixed base comes first, as Isaac Sim itself orders
    them. Source: isaacsim-robot-schema 6.2.
    """
    tree = names.tree
    robot = stage.GetPrimAtPath(f"/{names.root}")
    apply_foreign(robot, "IsaacRobotAPI", "isaac", {"robotType": options.robot_type})
    links = []
    for body in tree.bodies:
        links.append(names.body(body.name))
        _named(stage, links[-1], "IsaacLinkAPI", "nameOverride", body.name)
        for frame in tree.frames:
            if frame.body == body.name:
                links.append(names.frame(frame.name))
                stage.OverridePrim(links[-1]).AddAppliedSchema("IsaacSiteAPI")
    joints = {names.root_joint: ROOT_JOINT} if tree.base == "fixed" else {}
    joints |= {names.joint(name): name for name in tree.by_joint}
    for path, name in joints.items():
        _named(stage, path, "IsaacJointAPI", "NameOverride", name)
    _relate(robot, "isaac:physics:robotLinks", links)
    _relate(robot, "isaac:physics:robotJoints", list(joints))
    if control.keyframes:
        UsdGeom.Scope.Define(stage, f"/{names.root}/{POSES}")
        spelled = usd_identifiers(key.name for key in control.keyframes)
        paths = [f"/{names.root}/{POSES}/{spelled[key.name]}" for key in control.keyframes]
        for path, key in zip(paths, control.keyframes, strict=True):
            _define_pose(stage, names, path, key)
        _relate(robot, "isaac:robot:namedPoses", paths)


def _named(stage: Usd.Stage, path: str, schema: str, word: str, name: str) -> None:
    """Apply a schema that can say the robot's own name where the identifier is another."""
    prim = stage.OverridePrim(path)
    prim.AddAppliedSchema(schema)
    if prim.GetName() != name:
        kind = Sdf.ValueTypeNames.String
        prim.CreateAttribute(f"isaac:{word}", kind, custom=False).Set(name)


def _relate(prim: Usd.Prim, name: str, paths: list[str]) -> None:
    if paths:
        prim.CreateRelationship(name, custom=False).SetTargets(paths)


def _define_pose(stage: Usd.Stage, names: PrimPaths, path: str, key: Keyframe) -> None:
    """The coordinates of a keyframe in degrees and metres; where its base stands is left out."""
    prim = stage.DefinePrim(path, "IsaacNamedPose")
    label(prim, key.name)
    _relate(prim, "isaac:robot:pose:joints", [names.joint(joint) for joint, _ in key.joints])
    joints = names.tree.by_joint
    values = [coordinate(joints[joint], value) for joint, value in key.joints]
    kind = Sdf.ValueTypeNames.FloatArray
    prim.CreateAttribute("isaac:robot:pose:jointValues", kind, custom=False).Set(values)


# --- the robot on a floor -------------------------------------------------------------------------


SCENE = "scene.usda"
FLOOR_M = 20.0
CLEARANCE_M = 1e-3
"""The soles start this far above the floor. PhysX throws out a sole that starts inside of it, by
rounding alone, with all of `maxDepenetrationVelocity`."""


def write_scene(folder: Path, main: str, names: PrimPaths, control: Control) -> None:
    """A world that references `main`, the robot in its initial pose, with gravity and light.

    The robot's own file holds none of these: a training framework brings its own.
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


# --- metadata ------------------------------------------------------------------------------------


EXTENTS_DIGITS = 4
"""Decimals of a metre to which extents are rounded."""


def write_metadata(
    stage: Usd.Stage, robot: str, tree: Tree, about: About, licence: str | None, source: str | None
) -> None:
    """Author `SimReady_Metadata` in the custom data of the stage's root layer.

    In the words of NVIDIA's SimReady, for people and for libraries of assets; nothing here is
    simulated. What the recipe does not state is left out.
    """
    texts = {
        "author": about.author,
        "vendor": about.vendor,
        "description": about.description,
        "tags": ", ".join(about.tags),
        "asset_name": robot,
        "asset_type": "robot",
        "asset_license": licence,
        "category": "robot",
        "qcode": ROBOT_QCODE,
        "source_file": source and PurePosixPath(source).name,
        "usd_date_generated": about.date or NO_DATE,
    }
    metadata: dict[str, object] = {word: text for word, text in texts.items() if text}
    metadata["rigid_body_count"] = len(tree.bodies)
    metadata["mass"] = total_mass(tree)
    if (size := extents(stage)) is not None:
        metadata["asset_extents"] = size
        # The bounds by purpose, so that a viewer frames the robot before it loads it.
        purposes = UsdGeom.Imageable.GetOrderedPurposeTokens()
        cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), purposes)
        model = UsdGeom.ModelAPI.Apply(stage.GetDefaultPrim())
        model.SetExtentsHint(model.ComputeExtentsHint(cache))
    stage.GetRootLayer().customLayerData = {METADATA: metadata}


def extents(stage: Usd.Stage) -> Gf.Vec3f | None:
    """Size of the robot in its zero pose along the axes of the stage, m; None without a shape."""
    seen = [UsdGeom.Tokens.default_, UsdGeom.Tokens.render, UsdGeom.Tokens.proxy]
    for purposes in (seen, [*seen, UsdGeom.Tokens.guide]):
        box = UsdGeom.BBoxCache(Usd.TimeCode.Default(), purposes).ComputeWorldBound(
            stage.GetDefaultPrim()
        )
        bounds = box.ComputeAlignedRange()
        if not bounds.IsEmpty():
            return Gf.Vec3f(*(round(side, EXTENTS_DIGITS) for side in bounds.GetSize()))
    return None
