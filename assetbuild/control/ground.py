"""Where the ground is under a robot: its lowest collision point."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from assetbuild.mesh.obj import read_triangles
from assetbuild.robot import model
from assetbuild.robot.pose import Array, Pose
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Geometry, Mesh, Shapes, Sphere
from assetbuild.robot.tree import forward_kinematics


class Ground:
    """The lowest collision point of the robot; mesh files are read once, when first needed."""

    def __init__(self, tree: model.Tree, shapes: Shapes, mesh_dir: Path) -> None:
        self._tree, self._shapes, self._mesh_dir = tree, shapes.of("collision"), mesh_dir
        self._files = {asset.name: asset.file for asset in shapes.meshes}
        self._vertices: dict[str, Array] = {}

    def lowest(self, q: Mapping[str, float]) -> float | None:
        """z of the lowest point in the root's frame, m; None without collision geometry."""
        X_root_body = forward_kinematics(self._tree, q)
        found = []
        for shape in self._shapes:
            body, X_body_link = self._tree.placement(shape.link)
            X_root_shape = X_root_body[body] @ X_body_link @ shape.X_link_shape
            found.append(self._bottom(shape.geometry, X_root_shape))
        return min(found, default=None)

    def _bottom(self, geometry: Geometry, X_root_shape: Pose) -> float:
        if isinstance(geometry, Mesh):
            points = self._mesh(geometry.mesh)
            return float(X_root_shape.apply(points)[:, 2].min())
        return X_root_shape.xyz[2] - half_height(geometry, X_root_shape.rotation[2])

    def _mesh(self, name: str) -> Array:
        if name not in self._vertices:
            path = self._mesh_dir / self._files[name]
            mesh = read_triangles(path.read_bytes(), f"mesh {name}")
            self._vertices[name] = mesh.vertices[np.unique(mesh.faces)]
        return self._vertices[name]


def half_height(geometry: Box | Sphere | Cylinder | Capsule, up: Array) -> float:
    """How far a primitive reaches from its centre towards `up`, m: its support function.

    up: (3,) unit vector in the frame of the primitive.
    """
    if isinstance(geometry, Sphere):
        return geometry.radius
    if isinstance(geometry, Box):
        return float(np.abs(up) @ np.asarray(geometry.size)) / 2
    along = abs(float(up[2])) * geometry.length / 2
    if isinstance(geometry, Capsule):
        return along + geometry.radius
    return along + geometry.radius * float(np.hypot(up[0], up[1]))
