"""Masses, limits and drives of any USD file, in SI units and radians: for `assetbuild diff`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from assetbuild.errors import UsageError
from assetbuild.robot.inertia import combine, move_inertial, principal_moments, rotate_tensor
from assetbuild.robot.model import Inertial
from assetbuild.robot.pose import Pose, Quat, normalised_quat, vec3

Facts = dict[tuple[str, str, str], float | str | tuple[float, ...] | None]
AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class _Rigid:
    """A rigid body of the stage. whole: centre and inertia are stated, in metres."""

    name: str
    X_world_body: Pose
    inertial: Inertial
    whole: bool


def usd_facts(path: Path) -> Facts:
    """Of the stage as it opens, with its default variants; fixed joints make one body of two."""
    from pxr import Tf, Usd, UsdGeom, UsdPhysics

    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise UsageError(f"`{path}` does not open: {error}") from None
    if not math.isclose(UsdGeom.GetStageMetersPerUnit(stage), 1.0):
        raise UsageError(f"`{path}` is not in metres", hint="compare it after scaling it to metres")
    facts: Facts = {}
    bodies: dict[str, _Rigid] = {}
    held: dict[str, str] = {}
    bolted = False
    places = UsdGeom.XformCache()
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if prim.HasAPI(UsdPhysics.RigidBodyAPI):
            bodies[str(prim.GetPath())] = _rigid(prim, places)
        elif prim.IsA(UsdPhysics.FixedJoint):
            joint = UsdPhysics.Joint(prim)
            ends = [joint.GetBody0Rel().GetTargets(), joint.GetBody1Rel().GetTargets()]
            if all(ends):
                held[str(ends[1][0])] = str(ends[0][0])
            bolted = bolted or (any(ends) and not all(ends))
        for kind, factor in (
            (UsdPhysics.RevoluteJoint, math.pi / 180),
            (UsdPhysics.PrismaticJoint, 1),
        ):
            if prim.IsA(kind):
                _joint_facts(prim, kind(prim), factor, facts)
    _mass_facts(bodies, held, facts)
    if bodies:
        facts["robot", "robot", "base"] = "fixed" if bolted else "floating"
    return facts


def _rigid(prim: Any, places: Any) -> _Rigid:  # Any: pxr has no types
    from pxr import Gf, UsdPhysics

    api = UsdPhysics.MassAPI(prim)
    world = places.GetLocalToWorldTransform(prim)
    placed = world.RemoveScaleShear()
    turn = placed.ExtractRotationQuat()
    mass = float(api.GetMassAttr().Get() or 0.0)
    center, diagonal = api.GetCenterOfMassAttr().Get(), api.GetDiagonalInertiaAttr().Get()
    axes = api.GetPrincipalAxesAttr().Get() or Gf.Quatf(1.0)
    stated = (center, diagonal)
    scaled = not Gf.IsClose(world, placed, 1e-6)  # lengths and moments are then in other units
    whole = not scaled and all(v is not None and all(map(math.isfinite, v)) for v in stated)
    inertial = Inertial(mass, (0.0, 0.0, 0.0), (0.0,) * 6)
    if whole:
        xx, yy, zz = (float(v) for v in diagonal)
        own = rotate_tensor((xx, yy, zz, 0.0, 0.0, 0.0), _quat(axes))
        inertial = Inertial(mass, vec3(center), own)
    return _Rigid(
        prim.GetName(), Pose(vec3(placed.ExtractTranslation()), _quat(turn)), inertial, whole
    )


def _quat(turn: Any) -> Quat:  # Any: as above
    """Of a Gf.Quat; PhysX takes one without length for none at all."""
    parts = (turn.GetReal(), *turn.GetImaginary())
    w, x, y, z = (float(part) for part in parts)
    return normalised_quat((w, x, y, z)) if any((w, x, y, z)) else (1.0, 0.0, 0.0, 0.0)


def _mass_facts(bodies: Mapping[str, _Rigid], held: Mapping[str, str], facts: Facts) -> None:
    groups: dict[str, list[_Rigid]] = {}
    for path, body in bodies.items():
        root, seen = path, {path}
        while held.get(root) in bodies and held[root] not in seen:
            root = held[root]
            seen.add(root)
        groups.setdefault(root, []).append(body)
    for path, parts in groups.items():
        own = ("body", bodies[path].name)
        facts[*own, "mass, kg"] = math.fsum(part.inertial.mass_kg for part in parts)
        if all(part.whole for part in parts):
            X_root_world = bodies[path].X_world_body.inverse()
            one = combine([move_inertial(p.inertial, X_root_world @ p.X_world_body) for p in parts])
            facts[*own, "centre of mass, m"] = one.com_m
            facts[*own, "principal moments, kg m2"] = principal_moments(one.inertia_com_kg_m2)
    total = math.fsum(body.inertial.mass_kg for body in bodies.values())
    facts["robot", "robot", "total mass, kg"] = total


def _joint_facts(prim: Any, joint: Any, factor: float, facts: Facts) -> None:  # Any: as above
    from pxr import Gf, UsdPhysics

    own = ("joint", prim.GetName())
    angular = factor != 1
    facts[*own, "kind"] = "hinge" if angular else "slide"
    turn = joint.GetLocalRot1Attr().Get()
    axis = Gf.Vec3d(*AXES[str(joint.GetAxisAttr().Get())])
    if turn is not None:
        axis = Gf.Rotation(Gf.Quatd(turn)).TransformDir(axis)
    facts[*own, "axis"] = tuple(round(float(v), 6) for v in axis)
    for name, value in (
        ("lower", joint.GetLowerLimitAttr().Get()),
        ("upper", joint.GetUpperLimitAttr().Get()),
    ):
        stated = value is not None and math.isfinite(value) and abs(value) < 1e30
        facts[*own, name] = float(value) * factor if stated else None
    drive = UsdPhysics.DriveAPI.Get(prim, "angular" if angular else "linear")
    if not drive:
        facts[*own, "kp"] = facts[*own, "kd"] = 0.0
    else:
        facts[*own, "kp"] = float(drive.GetStiffnessAttr().Get() or 0.0) / factor
        facts[*own, "kd"] = float(drive.GetDampingAttr().Get() or 0.0) / factor
        effort = drive.GetMaxForceAttr().Get()
        if effort is not None and math.isfinite(effort):
            facts[*own, "effort"] = float(effort)
