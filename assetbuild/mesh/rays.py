"""Rays through a mesh: grids of them from six sides, and which pass."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.pose import Array

SIDES = 6


def grids(mesh: TriangleMesh, rows: int, reach: float) -> tuple[Array, Array]:
    """(origins, directions), (6 rows², 3) each: square grids with edges of `reach`, m.

    Along the axes and the principal axes of the vertices, each from `reach` before the middle.
    """
    lower, upper = mesh.bounds
    middle = (lower + upper) / 2.0
    spread = mesh.vertices - mesh.vertices.mean(axis=0)
    principal = np.linalg.eigh(spread.T @ spread)[1].T
    across = (np.arange(rows) + 0.5) / rows * reach - reach / 2.0
    u, v = (side.ravel()[:, None] for side in np.meshgrid(across, across, indexing="ij"))
    directions = np.concatenate([np.eye(3), principal])
    origins = []
    for direction in directions:
        first = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
        first /= np.linalg.norm(first)
        origins.append(middle - reach * direction + u * first + v * np.cross(direction, first))
    return np.concatenate(origins), np.repeat(directions, rows * rows, axis=0)


def missed(origins: Array, directions: Array, mesh: TriangleMesh) -> NDArray[np.bool_]:
    """(n,) which rays strike no triangle; float32 of the ray tracer, in units of the size."""
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh as EmbreeMesh

    if not len(origins):
        return np.zeros(0, dtype=bool)
    lower, upper = mesh.bounds
    middle, size = (lower + upper) / 2.0, mesh.diagonal
    scene = rtcore_scene.EmbreeScene()
    vertices = ((mesh.vertices - middle) / size).astype(np.float32)
    kept = EmbreeMesh(scene, vertices, mesh.faces.astype(np.int32))
    struck = scene.run(
        ((origins - middle) / size).astype(np.float32), directions.astype(np.float32)
    )
    del kept
    missed: NDArray[np.bool_] = np.asarray(struck, dtype=np.int64) == -1
    return missed
