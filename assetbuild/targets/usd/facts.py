"""Masses, limits and drives of any USD file, in SI units and radians: for `assetbuild diff`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from assetbuild.errors import UsageError

Facts = dict[tuple[str, str, str], float | str | tuple[float, ...] | None]
AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


def usd_facts(path: Path) -> Facts:
    """Of the stage as it opens, with its default variants."""
    from pxr import Tf, Usd, UsdGeom, UsdPhysics

    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise UsageError(f"`{path}` does not open: {error}") from None
    if not math.isclose(UsdGeom.GetStageMetersPerUnit(stage), 1.0):
        raise UsageError(f"`{path}` is not in metres", hint="compare it after scaling it to metres")
    facts: Facts = {}
    total = 0.0
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if prim.HasAPI(UsdPhysics.RigidBodyAPI):
            mass = _mass_facts(prim, UsdPhysics.MassAPI(prim), facts)
            total += mass
        for kind, factor in (
            (UsdPhysics.RevoluteJoint, math.pi / 180),
            (UsdPhysics.PrismaticJoint, 1),
        ):
            if prim.IsA(kind):
                _joint_facts(prim, kind(prim), factor, facts)
    facts["robot", "robot", "total mass, kg"] = total
    return facts


def _mass_facts(prim: Any, api: Any, facts: Facts) -> float:  # Any: pxr has no types
    own = ("body", prim.GetName())
    mass = float(api.GetMassAttr().Get() or 0.0)
    facts[*own, "mass, kg"] = mass
    center, diagonal = api.GetCenterOfMassAttr().Get(), api.GetDiagonalInertiaAttr().Get()
    if center is not None and all(math.isfinite(v) for v in center):
        facts[*own, "centre of mass, m"] = tuple(float(v) for v in center)
    if diagonal is not None:
        facts[*own, "principal moments, kg m2"] = tuple(sorted(float(v) for v in diagonal))
    return mass


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
    if drive:
        facts[*own, "kp"] = float(drive.GetStiffnessAttr().Get() or 0.0) / factor
        facts[*own, "kd"] = float(drive.GetDampingAttr().Get() or 0.0) / factor
        effort = drive.GetMaxForceAttr().Get()
        if effort is not None and math.isfinite(effort):
            facts[*own, "effort"] = float(effort)
