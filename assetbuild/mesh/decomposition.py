"""V-HACD and CoACD, each in a process of its own.

V-HACD 4 works on voxels: quick, for any mesh that has an inside; it shrinks by 1 to 6 %. CoACD is
tight on clean manifold meshes; it remeshes, inflates and is slow on all others.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any, Literal

import numpy as np
from pydantic import Field

from assetbuild.mesh.native import NativeLimits, run_apart
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.recipe_types import Length, Model, NonNegative, Positive

# Any below: the libraries have no type hints.


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

    def parts() -> Iterable[TriangleMesh]:
        import vhacdx

        # A flat list 3, a, b, c, 3, a, b, c, ...: an (n, 3) array is misread without an error.
        threes = np.full((len(mesh.faces), 1), 3, dtype=np.uint32)
        padded = np.hstack([threes, mesh.faces.astype(np.uint32)]).ravel()
        made = vhacdx.compute_vhacd(
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
        return map(_part, made)

    return run_apart(parts, limits)


NOT_CLEAN = b"Mesh Manifoldness: false"
"""What CoACD's log says when its own check (edges, self-intersection, orientation) fails."""
TRIANGLES = re.compile(rb"# Triangles: (\d+)$")
WAITING = re.compile(rb"iter \d+ ---- waiting pool: (\d+)$")
"""What it says before the search, and before each round of it: the parts that wait for a cut."""
FACES_PER_PART = 800
"""A round takes about as long for so many faces of the mesh as for one part more."""


class CoAcdOptions(Model):
    """CoACD's own parameters; the defaults are our fast ones, 3 to 5 times quicker than its own."""

    threshold: Positive = Field(
        0.05, ge=0.01, le=1, description="concavity that a piece may keep, share of the mesh's size"
    )
    threshold_m: Length | None = Field(
        None, gt=0, description="the same in metres, `5 mm`; used instead of `threshold`"
    )
    preprocess: Literal["auto", "on", "off"] = Field(
        "auto", description="remesh first; it inflates and closes gaps; auto: meshes not manifold"
    )
    preprocess_resolution: int = Field(
        50, ge=20, le=100, description="of the remesh; high values can hollow out open meshes"
    )
    resolution: int = Field(1000, ge=1000, le=10_000, description="samples of the concavity")
    mcts_nodes: int = Field(10, ge=10, le=40, description="cuts tried per axis")
    mcts_iterations: int = Field(60, ge=60, le=2000, description="iterations of the tree search")
    mcts_depth: int = Field(2, ge=2, le=7, description="cuts that the search looks ahead")
    pca: bool = Field(False, description="cut along the principal axes")
    merge: bool = Field(True, description="join pieces afterwards")
    decimate: bool = Field(
        True, description="reduce pieces to `max_vertices`, which is ignored without"
    )
    extrude: bool = Field(False, description="let neighbouring pieces overlap")
    extrude_margin: Positive = Field(0.01, description="of `extrude`, share of the mesh's size")
    approximation: Literal["ch", "box"] = Field("ch", description="convex hulls or boxes")
    seed: int = Field(0, ge=0, le=2**31 - 1, description="of the random search")


OWN_NAMES = {"threshold", "threshold_m", "preprocess", "mcts_depth", "approximation"}
"""Fields of `CoAcdOptions` that CoACD calls otherwise."""


class Patience:
    """Hears CoACD's log; True at a mesh that is not clean, and where the work becomes too much.

    Work is counted in looks at a part, each about 0.1 s of a processor: of a round they are its
    parts and its share of the mesh's faces. So what is given up depends on the mesh and on the
    options alone; a limit in seconds would let another processor come to another robot.
    """

    def __init__(self, most: float) -> None:
        self._left = most
        self._faces = 0

    def __call__(self, line: bytes) -> bool:
        """Whether this line of the log is where to stop."""
        if match := TRIANGLES.search(line):
            self._faces = int(match[1])
        if match := WAITING.search(line):
            self._left -= int(match[1]) + self._faces / FACES_PER_PART
        return self._left < 0.0 or NOT_CLEAN in line


def coacd_parts(
    mesh: TriangleMesh,
    options: CoAcdOptions,
    *,
    max_hulls: int | None,
    max_vertices: int,
    limits: NativeLimits,
    patience: Patience | None = None,
) -> list[TriangleMesh]:
    """Convex parts of a welded mesh; NativeError when there are none within the limits.

    max_hulls: parts that do not touch each other can exceed it; None = as many as needed.
    patience: when it ends the run the cause is `stopped`: before a mesh that is not clean is
    remeshed, or before the round that is too much.
    """

    def parts() -> Iterable[TriangleMesh]:
        import coacd

        coacd.set_log_level("error" if patience is None else "info")
        in_metres = options.threshold_m is not None
        made = coacd.run_coacd(
            coacd.Mesh(np.ascontiguousarray(mesh.vertices), mesh.faces.astype(np.int32)),
            **options.model_dump(exclude=OWN_NAMES),
            threshold=options.threshold_m if in_metres else options.threshold,
            max_convex_hull=-1 if max_hulls is None else max_hulls,
            preprocess_mode=options.preprocess,
            mcts_max_depth=options.mcts_depth,
            max_ch_vertex=max_vertices,
            apx_mode=options.approximation,
            real_metric=in_metres,
        )
        return map(_part, made)

    return run_apart(parts, limits, stop_when=patience)


def _part(made: tuple[Any, Any]) -> TriangleMesh:
    """The vertices and faces of a part as a mesh."""
    vertices, faces = made
    triangles = np.asarray(faces, dtype=np.int64).reshape(-1, 3)
    return TriangleMesh(np.asarray(vertices, dtype=np.float64).reshape(-1, 3), triangles)
