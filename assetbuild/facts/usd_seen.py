"""How a shape is shown: purpose, bounds, sides and normals, each judged by the geometry itself."""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom

from assetbuild.facts.surface import cross, lengths, measure
from assetbuild.facts.table import Value
from assetbuild.robot.pose import Array

FLAT = "along its faces"
CLOSE = 1e-5
"""Share of its size by which the bounds of a shape may be off, and length by which a normal may."""


def seen_facts(prim: Usd.Prim) -> dict[str, Value]:
    """What viewers read of a shape besides its geometry."""
    shape = UsdGeom.Gprim(prim)
    facts: dict[str, Value] = {"usd:purpose": str(shape.ComputePurpose())}
    facts["usd:extent"] = _extent(shape)
    if prim.IsA(UsdGeom.Mesh):
        facts["usd:doubleSided"] = bool(shape.GetDoubleSidedAttr().Get())
    return facts


def _extent(shape: UsdGeom.Gprim) -> Value:
    """True where it is around the shape as closely as can be, else what is stated."""
    stated = np.ravel(shape.GetExtentAttr().Get() or ())
    meant = np.ravel(UsdGeom.Boundable.ComputeExtentFromPlugins(shape, Usd.TimeCode.Default()))
    if stated.shape != meant.shape or np.abs(stated - meant).max() > CLOSE * np.abs(meant).max():
        return tuple(map(float, stated))
    return True


def normals_of(mesh: UsdGeom.Mesh, corners: Array) -> Value:
    """Means of the normals at the corners, FLAT of one for each face, or what is wrong with them.

    corners: (n, 3, 3) of triangles.
    """
    stated: Array = np.array(mesh.GetNormalsAttr().Get() or (), dtype=np.float64).reshape(-1, 3)
    kind = mesh.GetNormalsInterpolation()
    if np.abs(lengths(stated) - 1.0).max(initial=0.0) > CLOSE:
        return f"up to {lengths(stated).max():.4g} long"
    if kind == UsdGeom.Tokens.faceVarying and len(stated) == 3 * len(corners):
        return measure(corners, None, stated).normals
    if kind != UsdGeom.Tokens.uniform or len(stated) != len(corners):
        return f"{len(stated)}, {kind}"
    edges = corners - np.roll(corners, 1, axis=1)
    across, longest = cross(edges[:, 1], edges[:, 2]), np.linalg.norm(edges, axis=2).max(axis=1)
    # float32 says nothing of the direction of a thinner sliver.
    told = lengths(across) > CLOSE * np.abs(corners).max(initial=0.0) * longest
    along = np.einsum("ij,ij->i", across, stated) > (1.0 - 1e-4) * lengths(across)
    against = np.count_nonzero(told & ~along)
    return f"against {against} faces" if against else FLAT
