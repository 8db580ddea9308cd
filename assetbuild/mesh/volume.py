"""Area, volume, centroid, and whether a mesh is closed."""

from __future__ import annotations

import numpy as np

from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.pose import Array


def face_areas(mesh: TriangleMesh) -> Array:
    """(m,) areas of the faces, m2."""
    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0, dtype=np.float64)


def area(mesh: TriangleMesh) -> float:
    """Area of the surface, m2."""
    return float(face_areas(mesh).sum())


def signed_volume(mesh: TriangleMesh) -> float:
    """Enclosed volume, m3, by the divergence theorem; negative when the mesh is inside out.

    Of an open mesh it depends on where the hole is: ask `is_closed` first.
    """
    return float(_cone_volumes(mesh)[0].sum())


def solid_moments(mesh: TriangleMesh) -> tuple[float, Array, Array]:
    """Volume m3, centroid (3,) m, and inertia (3, 3) m5 about it, of a closed mesh of density 1.

    Exact: each face and a point span a tetrahedron, whose second moments are polynomials of its
    corners (Tonon, "Explicit exact formulas for the 3-D tetrahedron inertia tensor", 2004). A
    mesh that is inside out gives the same as when it is turned.
    """
    cones, about = _cone_volumes(mesh)
    volume = float(cones.sum())
    corners = mesh.corners - about
    total = corners.sum(axis=1)
    first = cones @ total / 4.0
    second = (
        np.einsum("n,ni,nj->ij", cones, total, total)
        + np.einsum("n,nci,ncj->ij", cones, corners, corners)
    ) / 20.0
    middle = first / volume
    second = second - volume * np.outer(middle, middle)
    inertia = np.trace(second) * np.eye(3) - second
    return abs(volume), about + middle, np.sign(volume) * inertia


def _cone_volumes(mesh: TriangleMesh) -> tuple[Array, Array]:
    """Signed volumes (m,) of the cones from a point to each face, and that point.

    The point is the middle of the bounds: a mesh far from its origin loses no digits.
    """
    if not len(mesh.faces):
        return np.zeros(0), np.zeros(3)
    lower, upper = mesh.bounds
    about = (lower + upper) / 2.0
    a, b, c = np.moveaxis(mesh.corners - about, 1, 0)
    return np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0, about


def is_closed(mesh: TriangleMesh) -> bool:
    """True when every edge is used exactly twice, once in each direction.

    Vertices must be welded. Stricter than "watertight" elsewhere: faces also agree on outside.
    """
    if not len(mesh.faces):
        return False
    start = mesh.faces.ravel()
    end = mesh.faces[:, [1, 2, 0]].ravel()
    n = len(mesh.vertices)
    there = np.sort(start * n + end)
    back = np.sort(end * n + start)
    return bool(np.array_equal(there, back) and (there[1:] != there[:-1]).all())
