"""Which meshes have the same shape, perhaps mirrored: each class need be decomposed once only.

Exact hashes find no left and right: each side is tessellated apart. So surfaces are sampled and
compared. A part that is nearly its own mirror image can give a false match, so whoever reuses a
result measures it again.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from pydantic import Field

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.findings import Finding
from assetbuild.mesh import MESH_MODULES
from assetbuild.mesh.arrays import PARTS, read_meshes
from assetbuild.mesh.quality import surface_samples
from assetbuild.mesh.triangles import TriangleMesh, area, merged

SAMPLES = 2000
SAME = 1.2
"""Mean distance between two samplings / that of one surface sampled twice: 1 = the same."""
AREA = 0.03
EXTENT = 0.02
"""Candidates differ by no more than these shares of the area and of the size."""
MIRRORS = ((1.0, 1.0, 1.0), (-1.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, -1.0))


class MatchShapes(Step):
    """`matches.json`: {folder: {"like": earlier folder, "signs": [3], "shift": [3] m}}.

    A point of the mesh is signs * point of the earlier one + shift, per axis.
    """

    usual_s = 0.5
    outputs = ("matches.json",)
    isolated = True
    preload = MESH_MODULES
    limits = Limits(wall_s=600.0, memory_mb=4096)

    folders: tuple[str, ...] = Field(min_length=2)
    """Input folders with converted meshes, in the order in which they may be reused."""

    def run(self, files: Files) -> Iterable[Finding]:
        """Compare each mesh with the first of every class before it."""
        matches: dict[str, dict[str, object]] = {}
        first: list[_Sampled] = []
        for name in self.folders:
            this = _Sampled(name, merged([*read_meshes(files.inputs / name / PARTS).values()]))
            match = _match(this, first)
            if match is not None:
                matches[name] = match
            else:
                first.append(this)
        files.write_json("matches.json", matches)
        return ()


class _Sampled:
    """Samples of a mesh about the middle of its bounds. base: mean distance between two samplings,
    m.
    """

    def __init__(self, name: str, mesh: TriangleMesh) -> None:
        from scipy.spatial import cKDTree

        lower, upper = mesh.bounds
        self.name, self.area, self.extents = name, area(mesh), upper - lower
        self.middle = (lower + upper) / 2.0
        self.points, again = (
            surface_samples(mesh, SAMPLES, seed)[0] - self.middle for seed in (0, 1)
        )
        self.tree = cKDTree(self.points)
        self.base = float(np.mean(self.tree.query(again)[0]))


def _match(this: _Sampled, known: Sequence[_Sampled]) -> dict[str, object] | None:
    for other in known:
        if abs(this.area - other.area) > AREA * other.area:
            continue
        size = float(np.linalg.norm(other.extents))
        if float(np.linalg.norm(this.extents - other.extents)) > EXTENT * size:
            continue
        turned = (this.points * np.asarray(signs) for signs in MIRRORS)
        apart = [float(np.mean(other.tree.query(points)[0])) for points in turned]
        best = int(np.argmin(apart))
        if apart[best] < SAME * this.base:
            signs = np.asarray(MIRRORS[best])
            shift = this.middle - signs * other.middle
            return {"like": other.name, "signs": signs.tolist(), "shift": shift.tolist()}
    return None
