"""V-HACD 4: voxels, quick, for any mesh that has an inside; it shrinks by 1 to 6 %."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from assetbuild.mesh.native import NativeLimits, run_apart
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.recipe.collision import VHacdOptions


def vhacd_parts(
    mesh: TriangleMesh,
    options: VHacdOptions,
    *,
    max_hulls: int,
    max_vertices: int,
    limits: NativeLimits,
) -> list[TriangleMesh]:
    """Convex parts of a welded mesh; NativeError when there are none within the limits.

    max_hulls is a budget that V-HACD nearly always uses up and never exceeds.
    """

    return run_apart(lambda: _parts(mesh, options, max_hulls, max_vertices), limits)


def _parts(
    mesh: TriangleMesh, options: VHacdOptions, max_hulls: int, max_vertices: int
) -> Iterator[TriangleMesh]:
    import vhacdx

    # A flat list 3, a, b, c, 3, a, b, c, ...: an (n, 3) array is misread without an error.
    threes = np.full((len(mesh.faces), 1), 3, dtype=np.uint32)
    padded = np.hstack([threes, mesh.faces.astype(np.uint32)]).ravel()
    found = vhacdx.compute_vhacd(
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
    for vertices, faces in found:
        triangles = np.asarray(faces, dtype=np.int64).reshape(-1, 3)
        yield TriangleMesh(np.asarray(vertices, dtype=np.float64).reshape(-1, 3), triangles)
