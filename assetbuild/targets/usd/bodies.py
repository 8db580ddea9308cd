"""Bodies: where they are (base layer) and what they weigh (physics layer)."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from assetbuild.findings import Finding, Rule
from assetbuild.robot.inertia import Tensor, matrix_of
from assetbuild.robot.model import Body, Inertial, Tree
from assetbuild.robot.pose import IDENTITY, Array, Pose, Quat, Vec3, quat_of, vec3
from assetbuild.simulators.usd_options import UsdRigidBody
from assetbuild.targets.usd.layers import apply_foreign, label, new_layer, place, save
from assetbuild.targets.usd.names import Names
from assetbuild.targets.usd.units import to_usd_degrees

if TYPE_CHECKING:
    from pxr import Usd

MASS_MISSING = Rule(
    "usd.mass_missing",
    ("error", "info"),
    "a body has no mass; PhysX would take 1000 kg/m³ times the volume of its colliders (info on "
    "a fixed base)",
    "give it an inertial",
)


def write_base(
    folder: Path, names: Names, robot: str, tree: Tree, poses: Mapping[str, Pose]
) -> None:
    """`base.usda`: an Xform per body at `poses` (X_root_body at q = 0), frames below it.

    Where a fixed root is held stands on the robot's own prim, and the root link in its origin: a
    framework that spawns the robot replaces that pose and takes it for the root link's.

    Bodies are flat below the robot, not nested: every runtime loads that, and patterns such as
    `Robot/.*_foot` find them.
    """
    from pxr import UsdGeom

    stage = new_layer(folder / "base.usda", names)
    stage.GetRootLayer().subLayerPaths[:] = ["./instances.usda", "./materials.usda"]
    prim = UsdGeom.Xform.Define(stage, f"/{names.root}").GetPrim()
    label(prim, robot)
    if tree.X_world_root != IDENTITY:
        place(prim, tree.X_world_root)
    for body in tree.bodies:
        prim = UsdGeom.Xform.Define(stage, names.body(body.name)).GetPrim()
        place(prim, poses[body.name])
        label(prim, body.name)
    for frame in tree.frames:
        prim = UsdGeom.Xform.Define(stage, names.frame(frame.name)).GetPrim()
        place(prim, frame.X_body_frame)
        label(prim, frame.name)
    save(stage)


def apply_rigid_bodies(
    stage: Usd.Stage, names: Names, tree: Tree, options: UsdRigidBody
) -> Iterator[Finding]:
    """RigidBodyAPI and MassAPI on every body; a body without mass gets none, and a finding."""
    from pxr import UsdPhysics

    for body in tree.bodies:
        prim = stage.OverridePrim(names.body(body.name))
        UsdPhysics.RigidBodyAPI.Apply(prim)
        # All written out: PhysX's own are an angular damping of 0.05, 100 rad/s and 3 m/s.
        apply_foreign(
            prim,
            "PhysxRigidBodyAPI",
            {
                "physxRigidBody:linearDamping": ("Float", options.linear_damping),
                "physxRigidBody:angularDamping": ("Float", options.angular_damping),
                "physxRigidBody:maxLinearVelocity": ("Float", options.max_linear_velocity),
                "physxRigidBody:maxAngularVelocity": (
                    "Float",
                    to_usd_degrees(options.max_angular_velocity),
                ),
                "physxRigidBody:maxDepenetrationVelocity": (
                    "Float",
                    options.max_depenetration_velocity,
                ),
            },
        )
        if body.inertial is not None and not body.is_massless:
            _apply_mass(prim, body.inertial)
        else:
            yield _no_mass(body, is_held=tree.base == "fixed" and body.name == tree.root)


def _apply_mass(prim: Usd.Prim, inertial: Inertial) -> None:
    from pxr import Gf, UsdPhysics

    moments, (w, x, y, z) = principal_axes(inertial.inertia_com_kg_m2)
    mass = UsdPhysics.MassAPI.Apply(prim)
    mass.CreateMassAttr(inertial.mass_kg)
    mass.CreateCenterOfMassAttr(Gf.Vec3f(*inertial.com_m))
    mass.CreateDiagonalInertiaAttr(Gf.Vec3f(*moments))
    mass.CreatePrincipalAxesAttr(Gf.Quatf(w, x, y, z))


def _no_mass(body: Body, *, is_held: bool) -> Finding:
    return MASS_MISSING(
        f"link {body.name}",
        "has no mass in USD; PhysX will take 1000 kg/m³ times its collision volume",
        severity="info" if is_held else "error",
        hint="harmless, the fixed base never moves"
        if is_held
        else "give the link an <inertial>; between the hinges of a ball joint: edit `share_mass`",
    )


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
