"""Meshes of a stage: measured once each, however many shapes refer to them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from assetbuild.facts.surface import Surface, measure
from assetbuild.facts.table import Value
from assetbuild.facts.usd_prims import Prim, Units, rigid
from assetbuild.robot.pose import Array

Whole = NDArray[np.int64]


@dataclass
class Measured:
    """A mesh in its own frame. corners: (n, 3, 3) m, none where its faces do not fit its points."""

    corners: Array
    uv: Array | None
    surface: Surface


@dataclass
class Meshes:
    """What has been measured; instances share a prototype."""

    units: Units
    known: dict[str, Measured] = field(default_factory=dict)

    def facts(self, prim: Prim, X_body_mesh: Array) -> dict[str, Value]:
        """Surface in its body's frame. X_body_mesh: (4, 4), with scale."""
        path = prim.path
        if prim.prim.IsInstanceProxy():
            path = str(prim.prim.GetPrimInPrototype().GetPath())
        if path not in self.known:
            self.known[path] = _measure(prim.prim, self.units)
        one = self.known[path]
        pose, scale = rigid(X_body_mesh)
        if np.all(scale == 1.0):
            return one.surface.moved(pose).facts()
        corners = one.corners @ X_body_mesh[:3, :3].T + X_body_mesh[:3, 3]
        return measure(corners, one.uv).facts()


def _measure(prim: Usd.Prim, units: Units) -> Measured:
    mesh = UsdGeom.Mesh(prim)
    points = np.array(mesh.GetPointsAttr().Get() or (), dtype=np.float64).reshape(-1, 3)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get() or (), dtype=np.int64)
    indices = np.array(mesh.GetFaceVertexIndicesAttr().Get() or (), dtype=np.int64)
    where = _triangles(counts, flip=mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded)
    sound = len(indices) == counts.sum() and not (indices.size and not
        0 <= indices.min() <= indices.max() < len(points))  # fmt: skip
    if not sound:
        where = where[:0]
    corners = points[indices[where]] * units.metre
    uv = _texture_corners(prim, indices, where) if sound else None
    return Measured(corners, uv, measure(corners, uv))


def _triangles(counts: Whole, *, flip: bool) -> Whole:
    """(n, 3) places in the list of face corners: each polygon cut into a fan."""
    starts = np.concatenate(([0], np.cumsum(counts)[:-1])) if len(counts) else counts
    if np.all(counts == 3):
        fans = starts[:, None] + np.array((0, 1, 2))
    else:
        fans = np.array(
            [(s, s + i, s + i + 1) for s, n in zip(starts, counts, strict=True)
             for i in range(1, n - 1)], dtype=np.int64,
        ).reshape(-1, 3)  # fmt: skip
    found: Whole = fans[:, ::-1] if flip else fans
    return found


def _texture_corners(prim: Usd.Prim, indices: Whole, where: Whole) -> Array | None:
    """(n, 3, 2) of the primvar `st`, None where it has none or does not fit the mesh."""
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("st")
    if not primvar or not primvar.HasAuthoredValue():
        return None
    flat = np.array(primvar.ComputeFlattened() or (), dtype=np.float64).reshape(-1, 2)
    kind = primvar.GetInterpolation()
    if kind in (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying):
        flat = flat[indices] if indices.size and indices.max() < len(flat) else flat[:0]
    elif kind != UsdGeom.Tokens.faceVarying:
        flat = flat[:0]
    if where.size and where.max() >= len(flat):
        return np.zeros((0, 3, 2))
    found: Array = flat[where]
    return found
