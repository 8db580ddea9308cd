"""A surface of one triangle in four corners: MuJoCo takes no mesh of three vertices."""

from __future__ import annotations

import numpy as np

from assetbuild.mesh.triangles import TriangleMesh, unit_vectors
from assetbuild.robot.pose import Array


def with_four_corners(mesh: TriangleMesh) -> TriangleMesh:
    """The same surface; where it has but three vertices, one more in its middle.

    The edges stay, so that a closed mesh of several parts stays closed.
    mesh: welded, without collapsed faces. Texture coordinates and normals are averaged alike.
    """
    if len(mesh.vertices) != 3 or not len(mesh.faces):
        return mesh
    ends = np.roll(mesh.faces, -1, axis=1)
    middle = np.full(len(mesh.faces), 3)
    thirds = [np.stack([mesh.faces[:, i], ends[:, i], middle], axis=1) for i in range(3)]
    return TriangleMesh(
        np.vstack([mesh.vertices, mesh.vertices.mean(axis=0)]),
        np.concatenate(thirds),
        None if mesh.uv is None else _thirds(mesh.uv, mesh.uv.mean(axis=1)),
        None
        if mesh.normals is None
        else _thirds(mesh.normals, unit_vectors(mesh.normals.mean(axis=1))),
    )


def _thirds(corners: Array, middle: Array) -> Array:
    """(3 m, 3, k): from each edge of (m, 3, k) corners to the (m, k) middle."""
    ends = np.roll(corners, -1, axis=1)
    thirds = [np.stack([corners[:, i], ends[:, i], middle], axis=1) for i in range(3)]
    return np.concatenate(thirds)
