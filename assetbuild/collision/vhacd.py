"""Convex decomposition by V-HACD 4: voxels, quick, for any mesh that has an inside."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np
from pydantic import Field

from assetbuild.collision import CollisionMethod
from assetbuild.engine.step import Limits
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import TriangleMesh


class VHacd(CollisionMethod):
    """Pieces of each source shape. It shrinks a little: 1 to 6 % of the volume is not covered."""

    tools = (*CollisionMethod.hull_tools, "vhacdx")
    preload = ("numpy", "scipy.spatial", "scipy.stats", "embreex.rtcore_scene", "vhacdx")
    limits: ClassVar[Limits] = Limits(wall_s=180.0, memory_mb=4096)

    max_hulls: int = Field(32, ge=1, le=1024)
    """A budget that V-HACD nearly always uses up, never exceeded."""
    max_vertices: int = Field(64, ge=4, le=256)
    """Most vertices of one piece."""
    resolution: int = Field(400_000, ge=1_000, le=50_000_000)
    """Voxels; time grows with them, 100,000 is 2.6 times faster and 2 to 5 % worse in IoU."""

    def fit(self, mesh: TriangleMesh) -> Iterable[ConvexPiece]:
        """V-HACD, one thread, flood fill (ray fill leaves real links hollow)."""
        import vhacdx

        # A flat list 3, a, b, c, 3, a, b, c, ...: an (n, 3) array is misread without an error.
        threes = np.full((len(mesh.faces), 1), 3, dtype=np.uint32)
        padded = np.hstack([threes, mesh.faces.astype(np.uint32)]).ravel()
        found = vhacdx.compute_vhacd(
            np.ascontiguousarray(mesh.vertices),
            padded,
            maxConvexHulls=self.max_hulls,
            resolution=self.resolution,
            maxNumVerticesPerCH=self.max_vertices,
            fillMode="flood",
            asyncACD=False,
        )
        for vertices, faces in found:
            triangles = np.asarray(faces, dtype=np.int64).reshape(-1, 3)
            yield ConvexPiece(TriangleMesh(np.asarray(vertices, dtype=np.float64), triangles))
