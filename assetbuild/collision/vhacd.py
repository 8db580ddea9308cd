"""Convex decomposition by V-HACD 4: voxels, quick, for any mesh that has an inside."""

from __future__ import annotations

from pydantic import Field

from assetbuild.collision import (
    Fitted,
    LibraryMethod,
    MaxHulls,
    MaxPolygons,
    MaxVertices,
)
from assetbuild.mesh.cover import Reference
from assetbuild.mesh.decomposition import VHacdOptions


class VHacd(LibraryMethod):
    """Pieces of each source shape. It shrinks a little: 1 to 6 % of the volume is not covered."""

    usual_s = 3.0

    max_hulls: MaxHulls = 32
    max_vertices: MaxVertices = 64
    max_polygons: MaxPolygons = None
    vhacd: VHacdOptions = Field(VHacdOptions(), description="parameters of V-HACD")

    def fit(self, reference: Reference) -> Fitted:
        """V-HACD's parts; one hull when it fails."""
        return self.vhacd_or_hull(reference, self.vhacd, self.max_hulls, self.max_vertices)
