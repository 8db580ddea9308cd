"""Bodies and cameras: where they are (base layer) and what they weigh (physics layer)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdPhysics

from assetbuild.findings import Finding, Rule
from assetbuild.robot.inertia import Tensor, matrix_of
from assetbuild.robot.model import Body, Camera, Inertial
from assetbuild.robot.pose import IDENTITY, Array, Quat, Vec3, quat_of, vec3
from assetbuild.robot.tree import forward_kinematics
from assetbuild.simulators.usd_names import camera_identifiers
from assetbuild.simulators.usd_options import UsdRigidBody
from assetbuild.targets.usd.layers import apply_foreign, label, new_layer, place, save
from assetbuild.targets.usd.names import PrimPaths
from assetbuild.targets.usd.units import to_usd_degrees

EDGE = 4e-7
"""Share of the largest moment: what turning a tensor in single precision may lose."""
MASS_MISSING = Rule(
    "usd.mass_missing",
    ("error", "info"),
    "a body has no mass; PhysX would take 1000 kg/m³ times the volume of its colliders (info on "
    "a fixed base)",
    "give it an inertial",
)


def write_base(folder: Path, names: PrimPaths, robot: str, cameras: Sequence[Camera]) -> None:
    """`base.usda`: an Xform per body where it stands at q = 0, frames and cameras below it.

    Where a fixed root is held stands on the robot's own prim, and the root link in its origin: a
    framework that spawns the robot replaces that pose and takes it for the root link's.

    Bodies are flat below the robot, not nested: every runtime loads that, and patterns such as
    `Robot/.*_foot` find them.
    """
    stage = new_layer(folder / "base.usda", names)
    stage.GetRootLayer().subLayerPaths[:] = ["./instances.usda", "./materials.usda"]
    prim = UsdGeom.Xform.Define(stage, f"/{names.root}").GetPrim()
    label(prim, robot)
    tree = names.tree
    if tree.X_world_root != IDENTITY:
        place(prim, tree.X_world_root)
    poses = forward_kinematics(tree, {})
    parts = [
        *((names.body(body.name), poses[body.name], body.name) for body in tree.bodies),
        *((names.frame(frame.name), frame.X_body_frame, frame.name) for frame in tree.frames),
    ]
    for path, pose, name in parts:
        prim = UsdGeom.Xform.Define(stage, path).GetPrim()
        place(prim, pose)
        label(prim, name)
    identifiers = camera_identifiers(tree, cameras)
    for camera in cameras:
        _define_camera(stage, names, camera, identifiers[camera.name])
    save(stage)


FOCAL_LENGTH = 24.0
"""Isaac Lab's default; only its ratio to the apertures says what a camera sees."""
CLIPPING_M = (0.01, 1000.0)
"""Nearest and farthest depth; USD's own default sees nothing within a metre."""


def _define_camera(stage: Usd.Stage, names: PrimPaths, camera: Camera, identifier: str) -> None:
    """The camera looks along -z with +y up, as in MuJoCo; the field of view is vertical."""
    tree, above = names.tree, f"/{names.root}"
    X_above_link = tree.X_world_root.inverse()
    if camera.link is not None:
        body, X_above_link = tree.placement(camera.link)
        above = names.body(body)
    made = UsdGeom.Camera.Define(stage, f"{above}/{identifier}")
    place(made.GetPrim(), X_above_link @ camera.X_link_camera)
    label(made.GetPrim(), camera.name)
    width, height = camera.resolution
    vertical = 2.0 * FOCAL_LENGTH * math.tan(camera.fovy / 2.0)
    made.CreateFocalLengthAttr(FOCAL_LENGTH)
    made.CreateVerticalApertureAttr(vertical)
    made.CreateHorizontalApertureAttr(vertical * width / height)
    made.CreateClippingRangeAttr(Gf.Vec2f(*CLIPPING_M))


def apply_rigid_bodies(
    stage: Usd.Stage, names: PrimPaths, options: UsdRigidBody, weightless: Collection[str]
) -> Iterator[Finding]:
    """RigidBodyAPI and MassAPI on every body; a body without mass gets none, and a finding.

    weightless: bodies that gravity does not pull.
    """
    tree = names.tree
    for body in tree.bodies:
        prim = stage.OverridePrim(names.body(body.name))
        UsdPhysics.RigidBodyAPI.Apply(prim)
        # All written out: PhysX's own are an angular damping of 0.05, 100 rad/s and 3 m/s.
        apply_foreign(
            prim,
            "PhysxRigidBodyAPI",
            "physxRigidBody",
            {
                "linearDamping": options.linear_damping,
                "angularDamping": options.angular_damping,
                "maxLinearVelocity": options.max_linear_velocity,
                "maxAngularVelocity": to_usd_degrees(options.max_angular_velocity),
                "maxDepenetrationVelocity": options.max_depenetration_velocity,
                "disableGravity": True if body.name in weightless else None,
            },
        )
        if body.inertial is not None and not body.is_massless:
            _apply_mass(prim, body.inertial)
        else:
            yield _no_mass(body, is_held=tree.base == "fixed" and body.name == tree.root)


def _apply_mass(prim: Usd.Prim, inertial: Inertial) -> None:
    moments, axes = principal_axes(inertial.inertia_com_kg_m2)
    moments = within_float32(moments)
    mass = UsdPhysics.MassAPI.Apply(prim)
    mass.CreateMassAttr(inertial.mass_kg)
    mass.CreateCenterOfMassAttr(Gf.Vec3f(*inertial.com_m))
    mass.CreateDiagonalInertiaAttr(Gf.Vec3f(*moments))
    mass.CreatePrincipalAxesAttr(Gf.Quatf(*axes))


def _no_mass(body: Body, *, is_held: bool) -> Finding:
    return MASS_MISSING(
        f"link {body.name}",
        "has no mass in USD; PhysX will take 1000 kg/m³ times its collision volume",
        severity="info" if is_held else "error",
        hint="harmless, the fixed base never moves"
        if is_held
        else "give the link an <inertial>; between the hinges of a ball joint: edit `share_mass`",
    )


def within_float32(moments: Vec3) -> Vec3:
    """The moments such that A + B >= C holds for whoever turns them in single precision.

    Of a flat body A + B is C, and rounding alone would make it a tensor that Newton refuses: the
    least is raised by a few roundings, at most 2 EDGE of C.
    """
    least, middle, most = sorted(range(3), key=lambda index: moments[index])
    lacking = moments[most] * (1.0 + EDGE) - moments[least] - moments[middle]
    if not 0.0 < lacking <= 2.0 * EDGE * moments[most]:
        return moments  # more is no rounding, and `inertia.triangle` has said so
    raised = list(moments)
    raised[least] += lacking
    return vec3(raised)


def principal_axes(tensor: Tensor) -> tuple[Vec3, Quat]:
    """Principal moments (kg m2) and the rotation (wxyz) of their axes in the body's.

    Of the 24 right-handed ways to name the axes, the one nearest to the body's own, so that
    equal tensors give equal bytes; a diagonal tensor keeps its order and the exact identity.
    """
    matrix = matrix_of(tensor)
    if not np.any(matrix - np.diag(np.diag(matrix))):
        return vec3(np.diag(matrix)), (1.0, 0.0, 0.0, 0.0)
    moments, axes = np.linalg.eigh(matrix)
    orders = [list(order) for order in itertools.permutations(range(3))]
    order = max(orders, key=lambda o: float(np.abs(np.diag(axes[:, o])).sum()))
    return vec3(moments[order]), quat_of(_right_handed(axes[:, order]))


def _right_handed(axes: Array) -> Array:
    """Columns turned to point along +x, +y, +z; the least certain one yields to the hand."""
    diagonal = np.diag(axes)
    out: Array = axes * np.where(diagonal < 0.0, -1.0, 1.0)
    if np.linalg.det(out) < 0.0:
        out[:, int(np.argmin(np.abs(diagonal)))] *= -1.0
    return out
