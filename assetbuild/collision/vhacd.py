"""Convex decomposition by V-HACD 4: voxels, quick, for any mesh that has an inside."""

from __future__ import annotations

from pydantic import Field

from assetbuild.collision import CollisionMethod, Fitted
from assetbuild.mesh.cover import Reference
from assetbuild.mesh.native import NativeError
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.vhacd import VHacdOptions, vhacd_parts
from assetbuild.quantities import Positive


class VHacd(CollisionMethod):
    """Pieces of each source shape. It shrinks a little: 1 to 6 % of the volume is not covered."""

    usual_s = 3.0

    max_hulls: int = Field(32, ge=1, le=1024, description="most pieces")
    max_vertices: int = Field(
        64, ge=4, le=256, description="most vertices of a piece; PhysX on a GPU takes 64"
    )
    max_polygons: int | None = Field(
        None, ge=16, le=1024, description="most polygons of a piece; PhysX on a GPU takes 64"
    )
    vhacd: VHacdOptions = Field(VHacdOptions(), description="parameters of V-HACD")
    cpu_limit: Positive = Field(
        60.0, le=1800, description="CPU seconds of one run of a native library"
    )
    memory_limit_mb: int = Field(
        3072, ge=64, le=4096, description="memory of one run of a native library, MB"
    )

    def fit(self, reference: Reference) -> Fitted:
        """V-HACD's parts; one hull when it fails."""
        try:
            parts = vhacd_parts(
                reference.mesh,
                self.vhacd,
                max_hulls=self.max_hulls,
                max_vertices=self.max_vertices,
                limits=self.native_limits,
            )
        except NativeError as failure:
            return self.hull_after(reference, "V-HACD", failure)
        return Fitted(tuple(map(ConvexPiece, parts)), how="V-HACD")
