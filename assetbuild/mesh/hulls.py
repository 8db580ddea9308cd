"""A robot's meshes and their convex hulls, each in one file: read and worked out once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from assetbuild.mesh.hull import hull_or_points
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.triangles import TriangleMesh, solid_moments
from assetbuild.robot.contradictions import Extent
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.pose import Array
from assetbuild.robot.shapes import Mesh, Role, Shapes

TABLES = {"vertices": (3,), "faces": (3,), "uv": (3, 2), "normals": (3, 3)}
"""Arrays of a mesh in one of these files, and the shape of a row."""


def write_meshes(file: Path, meshes: Sequence[TriangleMesh]) -> None:
    """All meshes of a robot, or their hulls, in the order in which it names them."""
    tables = {key: [getattr(mesh, key) for mesh in meshes] for key in TABLES}
    sizes = [[0 if table is None else len(table) for table in arrays] for arrays in tables.values()]
    joined: dict[str, Any] = {  # Any: `savez` has other keywords, too
        key: np.concatenate([np.zeros((0, *TABLES[key])), *(t for t in arrays if t is not None)])
        for key, arrays in tables.items()
    }
    joined["faces"] = joined["faces"].astype(np.int32)
    np.savez(file, sizes=np.array(sizes, dtype=np.int64), **joined)


def read_meshes(file: Path, shapes: Shapes, *, surface: bool = False) -> Mapping[str, TriangleMesh]:
    """Each mesh by name. surface: with texture coordinates and normals."""
    keys = [*TABLES] if surface else ["vertices", "faces"]
    with np.load(file) as stored:
        ends = np.cumsum(stored["sizes"], axis=1)[:, :-1]
        columns = [np.split(stored[key], at) for key, at in zip(keys, ends, strict=False)]
    names = [asset.name for asset in shapes.meshes]
    return {
        name: TriangleMesh(vertices, faces.astype(np.int64), *(t if len(t) else None for t in more))
        for name, vertices, faces, *more in zip(names, *columns, strict=False)
    }


def hulls_by_body(robot: RobotFiles) -> Mapping[tuple[str, Role], list[TriangleMesh]]:
    """(body, role) -> the hull of each of its shapes in the body's frame, m."""
    hulls = read_meshes(robot.hulls, robot.shapes)
    by_body: dict[tuple[str, Role], list[TriangleMesh]] = {}
    for shape in robot.shapes.shapes:
        body, X_body_shape = robot.tree.shape_placement(shape)
        geometry = shape.geometry
        hull = hulls[geometry.mesh] if isinstance(geometry, Mesh) else tessellate(geometry)
        by_body.setdefault((body, shape.role), []).append(hull.placed(X_body_shape))
    return by_body


def common_hull(hulls: Sequence[TriangleMesh]) -> TriangleMesh:
    """The hull of several; where they lie in one plane, all their vertices and no face."""
    if len(hulls) == 1:
        return hulls[0]
    return hull_or_points(np.concatenate([hull.vertices for hull in hulls]))


def extent_of(points: Sequence[Array]) -> Extent:
    """What points (n, 3) of one body's shapes span; without volume where they lie in a plane."""
    hull = hull_or_points(np.concatenate(points))
    if not len(hull.faces):
        return Extent(hull.vertices, 0.0, np.zeros(3))
    volume, _, inertia = solid_moments(hull)
    return Extent(hull.vertices, float(volume), np.asarray(np.linalg.eigvalsh(inertia), np.float64))
