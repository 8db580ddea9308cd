"""One convex hull: the cheapest cover of everything, and it closes every gap."""

from __future__ import annotations

from pydantic import Field

from assetbuild.collision import CollisionMethod, Fitted, MaxPolygons
from assetbuild.mesh.cover import Reference
from assetbuild.mesh.solid import ConvexPiece


class Hull(CollisionMethod):
    """The convex hull of each source shape, by qhull."""

    usual_s = 0.4

    max_vertices: int | None = Field(
        64, ge=4, le=256, description="most vertices of a piece; PhysX on a GPU takes 64"
    )
    max_polygons: MaxPolygons = None

    def fit(self, reference: Reference) -> Fitted:
        """The hull as it is: the base class caps it."""
        return Fitted((ConvexPiece(reference.hull),), how="hull")
