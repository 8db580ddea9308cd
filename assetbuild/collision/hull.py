"""One convex hull: the cheapest cover of everything, and it closes every gap."""

from __future__ import annotations

from collections.abc import Iterable

from pydantic import Field

from assetbuild.collision import CollisionMethod
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import TriangleMesh


class Hull(CollisionMethod):
    """The convex hull of each source shape, by qhull."""

    tools = CollisionMethod.hull_tools
    preload = ("numpy", "scipy.spatial", "scipy.stats", "embreex.rtcore_scene")

    max_vertices: int | None = Field(64, ge=4)
    """Most vertices: 64 is what PhysX takes on a GPU, and MuJoCo is 1.4 times faster with it
    than with thousands. A capped hull lies inside the full one; None = all."""

    def fit(self, mesh: TriangleMesh) -> Iterable[ConvexPiece]:
        """The vertices as they are: the base class hulls, caps and turns every piece."""
        yield ConvexPiece(mesh)
