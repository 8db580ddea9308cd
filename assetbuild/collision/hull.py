"""One convex hull: the cheapest cover of everything, and it closes every gap."""

from __future__ import annotations

from pydantic import Field

from assetbuild.collision import CollisionMethod, Fitted
from assetbuild.mesh.cover import Reference
from assetbuild.mesh.solid import ConvexPiece


class Hull(CollisionMethod):
    """The convex hull of each source shape, by qhull."""

    tools = CollisionMethod.hull_tools

    max_vertices: int | None = Field(64, ge=4)
    """Most vertices: 64 is what PhysX takes on a GPU, and MuJoCo is 1.4 times faster with it
    than with thousands. A capped hull lies inside the full one; None = all."""
    max_polygons: int | None = Field(None, ge=16)
    """Most polygons, coplanar triangles counted as one; PhysX takes 64 on a GPU. None = all."""

    def fit(self, reference: Reference) -> Fitted:
        """The hull as it is: the base class caps it."""
        return Fitted((ConvexPiece(reference.hull),), how="hull")
