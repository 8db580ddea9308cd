"""Isaac Sim's robot schema: which prims are the robot's links, joints and sites, and its poses.

Isaac Sim's tools list, name and pose a robot by these; PhysX and Newton do not read them. Sites
follow their link, and the joint that holds a fixed base comes first, as Isaac Sim itself orders
them. Source: isaacsim-robot-schema 6.2.
"""

from __future__ import annotations

from pxr import Sdf, Usd, UsdGeom

from assetbuild.robot.model import Control, Keyframe
from assetbuild.simulators.usd_names import POSES, usd_identifiers
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.targets.usd.layers import apply_foreign, label
from assetbuild.targets.usd.names import PrimPaths
from assetbuild.targets.usd.units import coordinate


def apply_robot_schema(
    stage: Usd.Stage, names: PrimPaths, control: Control, options: UsdOptions
) -> None:
    """Links, joints, sites and keyframes; after all of them are defined."""
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
    joints = [names.root_joint] if tree.base == "fixed" else []
    joints += [names.joint(joint.name) for joint in tree.joints]
    for path, name in zip(joints[-len(tree.joints) :], tree.by_joint, strict=False):
        _named(stage, path, "IsaacJointAPI", "NameOverride", name)
    if tree.base == "fixed":
        stage.OverridePrim(names.root_joint).AddAppliedSchema("IsaacJointAPI")
    _relate(robot, "isaac:physics:robotLinks", links)
    _relate(robot, "isaac:physics:robotJoints", joints)
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
