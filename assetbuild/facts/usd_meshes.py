"""Meshes of a stage: measured once each, however many shapes refer to them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from assetbuild.facts.sketch import SKETCH, sketch_of
from assetbuild.facts.surface import Surface, cross, lengths, measure
from assetbuild.facts.table import Value
from assetbuild.facts.usd_prims import Prim, Units, rigid
from assetbuild.robot.pose import Array

Whole = NDArray[np.int64]
TOPOLOGY = ("points", "faceVertexCounts", "faceVertexIndices", "orientation")
NORMALS = ("normals", "primvars:st", "primvars:st:indices", "extent")
NEAR = 1e-6
"""Largest difference between a stated normal of a face and the normal of its corners, beside what
the rounding of corners to float32 makes of it: normals are float32 too."""


@dataclass
class Measured:
    """A mesh in its own frame. corners: (n, 3, 3) m; words: what it says besides its surface."""

    corners: Array
    uv: Array | None
    surface: Surface
    words: dict[str, Value]


@dataclass
class Meshes:
    """What has been measured, by the layers' specs that the numbers come from."""

    units: Units
    known: dict[tuple[str, ...], Measured] = field(default_factory=dict)

    def facts(self, prim: Prim, X_body_mesh: Array) -> dict[str, Value]:
        """Surface in its body's frame. X_body_mesh: (4, 4), with scale."""
        one = self._measured(prim)
        pose, scale = rigid(X_body_mesh)
        if np.all(scale == 1.0):
            surface = one.surface.moved(pose)
        else:
            corners = one.corners @ X_body_mesh[:3, :3].T + X_body_mesh[:3, 3]
            surface = measure(corners, one.uv)
        own: dict[str, Value] = {
            "usd:subdivisionScheme": prim.text("subdivisionScheme") or "catmullClark",
            "usd:doubleSided": bool(prim.flag("doubleSided")),
            f"usd:{SKETCH}": one.surface.sketch,
        }
        if surface.normals:
            own["usd:corner normals"] = surface.normals
        return surface.facts() | one.words | own

    def _measured(self, prim: Prim) -> Measured:
        key = tuple(_origin(prim.prim.GetAttribute(name)) for name in (*TOPOLOGY, *NORMALS))
        if key not in self.known:
            self.known[key] = _measure(prim.prim, self.units)
        _take_all(prim)
        return self.known[key]


def _origin(attribute: Usd.Attribute) -> str:
    """The strongest spec of an attribute."""
    if not attribute.IsAuthored():
        return ""
    spec = attribute.GetPropertyStack(Usd.TimeCode.Default())[0]
    return f"{spec.layer.identifier}{spec.path}"


def _take_all(prim: Prim) -> None:
    for name in (*TOPOLOGY, *NORMALS):
        prim.take(name)
        prim.note(name, "interpolation")


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
    fits = _normals(mesh, points, indices, where, counts) if sound else ("unknown", None)
    whose, normals = fits
    words: dict[str, Value] = {
        "usd:extent": _extent(mesh, points),
        "usd:normals": whose,
    }
    if not sound:
        words["usd:topology"] = "its faces do not fit its points"
    surface = replace(measure(corners, uv, normals), sketch=sketch_of(corners, uv, normals))
    return Measured(corners, uv, surface, words)


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


def _extent(mesh: UsdGeom.Mesh, points: Array) -> str:
    stated = mesh.GetExtentAttr().Get() if mesh.GetExtentAttr().HasAuthoredValue() else None
    bounds = (points.min(axis=0), points.max(axis=0)) if len(points) else np.zeros((2, 3))
    return extent_text(stated, np.array(bounds))


def extent_text(stated: object, bounds: Array) -> str:
    """Whether an extent is (2, 3) `bounds`, in words."""
    if stated is None:
        return "not stated"
    found = np.array(stated, dtype=np.float64).reshape(-1, 3)
    size = float(np.abs(bounds).max()) if bounds.size else 0.0
    if found.shape == bounds.shape and np.allclose(found, bounds, rtol=0.0, atol=2e-7 * size):
        return "its bounds"
    return f"{found.round(6).tolist()} for bounds of {bounds.round(6).tolist()}"


def _normals(
    mesh: UsdGeom.Mesh, points: Array, indices: Whole, where: Whole, counts: Whole
) -> tuple[str, Array | None]:
    """Whose the normals are, and (n, 3, 3) of the corners where they are not their faces' alone."""
    attribute = mesh.GetNormalsAttr()
    if not attribute.HasAuthoredValue():
        return "not stated", None
    normals = np.array(attribute.Get() or (), dtype=np.float64).reshape(-1, 3)
    kind = str(mesh.GetNormalsInterpolation())
    wanted = {"uniform": len(counts), "faceVarying": len(indices), "vertex": len(points),
              "varying": len(points)}.get(kind)  # fmt: skip
    if len(normals) != wanted:
        return f"{len(normals)} instead of {wanted} ({kind})", None
    if kind == "faceVarying":
        return "of its corners", normals[where]
    if kind != "uniform":
        return "of its points", normals[indices[where]]
    if not np.all(counts == 3):
        return "of its faces", None
    wrong = _wrong_normals(normals, points[indices[where]])
    return f"{wrong} are not those of its faces" if wrong else "of its faces", None


def _wrong_normals(normals: Array, corners: Array) -> int:
    """How many normals are not their triangles'. (n, 3), and (n, 3, 3) corners."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    across = cross(b - a, c - a)
    size = lengths(across)
    off = lengths(normals * size[:, None] - across)
    # Corners are float32: an edge is off by 1e-7 of their distance from the origin.
    longest = np.maximum(lengths(b - a), lengths(c - a))
    farthest = np.maximum.reduce([*np.abs(corners.reshape(-1, 9)).T])
    rounding = NEAR * size + 4e-7 * farthest * longest
    tiny = size <= 1e-3 * longest * longest + 1e-20
    return int(np.sum((off > rounding) & ~tiny))
