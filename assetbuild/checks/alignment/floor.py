"""The floors of `scene.xml` and `scene.usda`, which people open side by side."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from assetbuild.checks.alignment.row import NUMBER, Row
from assetbuild.simulators import mujoco

FLOOR = "/World/floor"
UNBOUND = 0.0
"""Friction of a collider without a physics material: engines choose their own."""


def floor_rows(model: mujoco.Model, stage: Any) -> Iterator[Row]:  # Any: Usd.Stage
    """Its friction and its height, m."""
    from pxr import UsdGeom

    planes, prim = mujoco.floors(model), stage.GetPrimAtPath(FLOOR)
    if not planes or not prim:
        return
    targets = prim.GetRelationship("material:binding:physics").GetTargets()
    material = stage.GetPrimAtPath(targets[0]) if targets else None
    found = material.GetAttribute("physics:dynamicFriction").Get() if material else UNBOUND
    ours, theirs = float(model.geom_friction[planes[0], 0]), float(found)
    apart = abs(theirs - ours) / max(ours, theirs, 1e-9)
    told = theirs if material else "unstated"
    yield Row("floor_friction", "MEDIUM", "robot", ours, told, apart, *NUMBER, "of it")
    place = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(0.0).ExtractTranslation()
    ours, theirs = float(model.geom_pos[planes[0], 2]), float(place[2])
    yield Row("floor_height", "MEDIUM", "robot", ours, theirs, abs(theirs - ours), 1e-5, 1e-3, "m")
