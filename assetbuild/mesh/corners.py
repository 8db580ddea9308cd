"""The corners of all geometry of a body: what its mass properties are held against."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from assetbuild.errors import StepError
from assetbuild.mesh.hull import convex_hull
from assetbuild.mesh.obj import read_triangles
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import Array
from assetbuild.robot.shapes import Geometry, Mesh, Shapes

Corners = dict[tuple[str, Literal["visual", "collision"]], Array]


def corners_by_body(tree: Tree, shapes: Shapes, mesh_dir: Path) -> Corners:
    """(body, role) -> (n, 3) points in the body's frame, m, whose hull is the geometry's own.

    Each mesh file is read once; flat ones keep all their vertices.
    """
    files = {asset.name: asset.file for asset in shapes.meshes}
    read: dict[str, Array] = {}

    def corners(geometry: Geometry) -> Array:
        if not isinstance(geometry, Mesh):
            return tessellate(geometry).vertices
        name = geometry.mesh
        if name not in read:
            read[name] = _corners(read_triangles((mesh_dir / files[name]).read_bytes(), name))
        return read[name]

    found: dict[tuple[str, Literal["visual", "collision"]], list[Array]] = {}
    for shape in shapes.shapes:
        body, X_body_shape = tree.shape_placement(shape)
        placed = X_body_shape.apply(corners(shape.geometry))
        found.setdefault((body, shape.role), []).append(placed)
    return {key: np.concatenate(parts) for key, parts in found.items()}


def _corners(mesh: TriangleMesh) -> Array:
    try:
        return convex_hull(mesh.vertices).vertices
    except StepError:
        return mesh.vertices
