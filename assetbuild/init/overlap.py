"""How deep two bodies really lie in each other: hulls may, where the meshes do not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.quality import NearestSurface, surface_samples
from assetbuild.mesh.solid import Solid
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import Array, Pose
from assetbuild.robot.shapes import Mesh, Shape
from assetbuild.robot.tree import forward_kinematics

SAMPLES = 300
"""Points of a surface that may lie in another."""


class Surface:
    """A shape's triangles, in its own frame, and what is asked of them."""

    def __init__(self, mesh: TriangleMesh) -> None:
        self.mesh = mesh

    @cached_property
    def points(self) -> Array:
        """(SAMPLES, 3) m, on the surface."""
        return surface_samples(self.mesh, SAMPLES, 0)[0]

    def depth_of(self, points: Array) -> float:
        """How deep the deepest of points (n, 3) lies inside, m; 0 where none does."""
        lower, upper = self.mesh.bounds
        near = points[((points > lower) & (points < upper)).all(axis=1)]
        inside = near[self._solid.contains(near)] if len(near) else near
        return float(self._nearest.distance(inside).max()) if len(inside) else 0.0

    @cached_property
    def _solid(self) -> Solid:
        return Solid(self.mesh)

    @cached_property
    def _nearest(self) -> NearestSurface:
        return NearestSurface(self.mesh)


@dataclass(frozen=True)
class Overlaps:
    """shapes: of the robot by name; meshes: those of them that are meshes, in the shape's frame."""

    tree: Tree
    shapes: Mapping[str, Shape]
    meshes: Mapping[str, TriangleMesh]
    _surfaces: dict[str, Surface] = field(default_factory=dict)

    def body_of(self, shape: str) -> str:
        """The body that the shape belongs to; "" is the floor."""
        return self.tree.placement(self.shapes[shape].link)[0] if shape else ""

    def depth(self, one: str, other: str, positions: Mapping[str, float]) -> float:
        """Depth of the overlap of two shapes in a pose of all joints, m."""
        X_root = forward_kinematics(self.tree, positions)
        here, there = self._surface(one), self._surface(other)
        X_there_here = self._placed(other, X_root).inverse() @ self._placed(one, X_root)
        return max(
            there.depth_of(X_there_here.apply(here.points)),
            here.depth_of(X_there_here.inverse().apply(there.points)),
        )

    def _placed(self, name: str, X_root: Mapping[str, Pose]) -> Pose:
        shape = self.shapes[name]
        body, X_body_link = self.tree.placement(shape.link)
        return X_root[body] @ X_body_link @ shape.X_link_shape

    def _surface(self, name: str) -> Surface:
        if name not in self._surfaces:
            geometry = self.shapes[name].geometry
            mesh = self.meshes[name] if isinstance(geometry, Mesh) else tessellate(geometry)
            self._surfaces[name] = Surface(mesh)
        return self._surfaces[name]
