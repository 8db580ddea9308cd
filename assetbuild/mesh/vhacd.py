"""V-HACD 4: voxels, quick, for any mesh that has an inside; it shrinks by 1 to 6 %."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np
from pydantic import Field

from assetbuild.mesh.native import NativeLimits, run_apart
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.recipe_types import Model, NonNegative


class VHacdOptions(Model):
    """V-HACD's own parameters."""

    resolution: int = Field(
        400_000, ge=1_000, le=50_000_000, description="voxels; time grows with them"
    )
    fill: Literal["flood", "surface", "raycast"] = Field(
        "flood", description="what is inside; `raycast` leaves many real links hollow"
    )
    min_volume_error: NonNegative = Field(
        1.0, le=100, description="percent of a part's volume below which it is not cut further"
    )
    max_depth: int = Field(10, ge=2, le=64, description="most cuts in a row")
    shrink_wrap: bool = Field(True, description="pull the voxel hulls onto the mesh")
    min_edge: int = Field(2, ge=1, le=100, description="smallest edge of a part, voxels")
    best_plane: bool = Field(False, description="search for cutting planes (experimental)")


def vhacd_parts(
    mesh: TriangleMesh,
    options: VHacdOptions,
    max_hulls: int,
    max_vertices: int,
    limits: NativeLimits,
) -> list[TriangleMesh]:
    """Convex parts of a welded mesh; NativeError when there are none within the limits.

    max_hulls is a budget that V-HACD nearly always uses up and never exceeds.
    """

    def parts() -> Iterator[TriangleMesh]:
        import vhacdx

        # A flat list 3, a, b, c, 3, a, b, c, ...: an (n, 3) array is misread without an error.
        threes = np.full((len(mesh.faces), 1), 3, dtype=np.uint32)
        padded = np.hstack([threes, mesh.faces.astype(np.uint32)]).ravel()
        hulls = vhacdx.compute_vhacd(
            np.ascontiguousarray(mesh.vertices),
            padded,
            maxConvexHulls=max_hulls,
            resolution=options.resolution,
            minimumVolumePercentErrorAllowed=options.min_volume_error,
            maxRecursionDepth=options.max_depth,
            shrinkWrap=options.shrink_wrap,
            fillMode=options.fill,
            maxNumVerticesPerCH=max_vertices,
            asyncACD=False,
            minEdgeLength=options.min_edge,
            findBestPlane=options.best_plane,
        )
        for vertices, faces in hulls:
            triangles = np.asarray(faces, dtype=np.int64).reshape(-1, 3)
            yield TriangleMesh(np.asarray(vertices, dtype=np.float64).reshape(-1, 3), triangles)

    return run_apart(parts, limits)
