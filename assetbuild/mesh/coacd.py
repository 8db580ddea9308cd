"""CoACD: tight on clean manifold meshes; it remeshes, inflates and is slow on all others."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from assetbuild.mesh.native import NativeLimits, run_apart
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.recipe.collision import CoAcdOptions

NOT_CLEAN = b"Mesh Manifoldness: false"
"""What CoACD's log says when its own check (edges, self-intersection, orientation) fails."""


def coacd_parts(
    mesh: TriangleMesh,
    options: CoAcdOptions,
    *,
    max_hulls: int | None,
    max_vertices: int,
    limits: NativeLimits,
    only_clean: bool = False,
) -> list[TriangleMesh]:
    """Convex parts of a welded mesh; NativeError when there are none within the limits.

    max_hulls: parts that do not touch each other can exceed it; None = as many as needed.
    only_clean: end with cause `stopped` before CoACD remeshes a mesh that fails its own check.
    """

    def work() -> list[TriangleMesh]:
        return list(_parts(mesh, options, max_hulls, max_vertices, talks=only_clean))

    return run_apart(work, limits, stop_at=NOT_CLEAN if only_clean else b"")


def _parts(
    mesh: TriangleMesh,
    options: CoAcdOptions,
    max_hulls: int | None,
    max_vertices: int,
    *,
    talks: bool,
) -> Iterator[TriangleMesh]:
    import coacd

    coacd.set_log_level("info" if talks else "error")
    in_metres = options.threshold_m is not None
    parts = coacd.run_coacd(
        coacd.Mesh(np.ascontiguousarray(mesh.vertices), mesh.faces.astype(np.int32)),
        threshold=options.threshold_m if in_metres else options.threshold,
        max_convex_hull=-1 if max_hulls is None else max_hulls,
        preprocess_mode=options.preprocess,
        preprocess_resolution=options.preprocess_resolution,
        resolution=options.resolution,
        mcts_nodes=options.mcts_nodes,
        mcts_iterations=options.mcts_iterations,
        mcts_max_depth=options.mcts_depth,
        pca=options.pca,
        merge=options.merge,
        decimate=options.decimate,
        max_ch_vertex=max_vertices,
        extrude=options.extrude,
        extrude_margin=options.extrude_margin,
        apx_mode=options.approximation,
        seed=options.seed,
        real_metric=in_metres,
    )
    for vertices, faces in parts:
        triangles = np.asarray(faces, dtype=np.int64).reshape(-1, 3)
        yield TriangleMesh(np.asarray(vertices, dtype=np.float64), triangles)
