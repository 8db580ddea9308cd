"""Visual meshes light enough to look at, for the 3D view of the report."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
from pydantic import Field

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.findings import Finding
from assetbuild.mesh import MESH_MODULES
from assetbuild.mesh.obj import obj_bytes, read_triangles
from assetbuild.mesh.quality import NearestSurface, surface_samples
from assetbuild.mesh.simplify import clustered, simplified
from assetbuild.mesh.triangles import TriangleMesh, cleaned

SMALLEST = 400
"""Triangles up to which a mesh is left as it is: a screw stays a screw."""
OWN, WHOLE = 0.0025, 0.0006
"""Error that is allowed, as a share of the mesh's own diagonal and of the largest mesh's: 0.4 mm
on a trunk of 0.6 m, less than a pixel of the view. The larger of the two counts."""
SAMPLES = 500
"""Points of the light surface whose distance from the full one is the error."""
DENSE, LOST = 4000, 0.04
"""Points of the light surface of which one must lie within this share of the diagonal of each
sample of the full one: else a part was lost."""
CELL = 2.0
"""Side of the cells within which vertices become one, in allowed errors."""
STALLED = 0.9
"""Decimation that keeps more than 90 % of the triangles finds no more to take."""
DECIMALS = 5
"""Of a metre, to which vertices are rounded."""


class Lighten(Step):
    """Converted meshes -> `light/`: those that lost triangles, each named after its full file.

    Each mesh keeps its shape: 99 % of its surface lies within an error that the view does not show,
    and no part of it is lost. Only a robot that has more than `max_faces` triangles then loses more
    of them, all meshes in proportion. The view shows colours and no textures, so their coordinates
    are lost as well.
    Nothing of this is physics, and no target reads it.
    """

    usual_s = 1.0
    outputs = ("light/",)
    isolated = True
    preload = MESH_MODULES
    limits: ClassVar[Limits] = Limits(wall_s=600.0)

    max_faces: int = Field(150_000, ge=100)
    """Triangles of all visual meshes together, each counted once."""

    def run(self, files: Files) -> Iterable[Finding]:
        """Reads `meshes/<n>/parts/`; writes `<SHA-256 of the full OBJ>.obj`."""
        found: dict[str, bytes] = {}
        for path in sorted((files.inputs / "meshes").glob("*/parts/*.obj")):
            text = path.read_bytes()
            found.setdefault(hashlib.sha256(text).hexdigest(), text)
        (files.outputs / "light").mkdir()
        for digest, mesh in self._lightened(dict(sorted(found.items()))).items():
            (files.outputs / "light" / f"{digest}.obj").write_bytes(obj_bytes(mesh))
        return ()

    def _lightened(self, data: Mapping[str, bytes]) -> dict[str, TriangleMesh]:
        """The meshes that became smaller, by name."""
        plain = {
            name: cleaned(replace(read_triangles(text, name), normals=None, uv=None))
            for name, text in data.items()
        }
        whole = max((mesh.diagonal for mesh in plain.values() if len(mesh.faces)), default=0.0)
        light = {
            name: _light(mesh, max(OWN * mesh.diagonal, WHOLE * whole))
            for name, mesh in plain.items()
            if len(mesh.faces) > SMALLEST
        }
        total = sum(len(light.get(name, mesh).faces) for name, mesh in plain.items())
        share = self.max_faces / max(total, 1)
        if share < 1.0:
            light = {n: _thinned(m, int(len(m.faces) * share)) for n, m in light.items()}
        return {name: mesh for name, mesh in light.items() if mesh is not plain[name]}


def _light(mesh: TriangleMesh, error_m: float) -> TriangleMesh:
    """A smaller mesh that keeps its shape; `mesh` itself where there is none.

    Vertices that nearly touch become one; then the triangles are halved as long as the shape stays.
    """
    from scipy.spatial import cKDTree

    surface, points = NearestSurface(mesh), surface_samples(mesh, SAMPLES, 1)[0]

    def better(made: TriangleMesh, than: TriangleMesh) -> bool:
        if not 4 <= len(made.faces) <= STALLED * len(than.faces):
            return False
        kept = surface_samples(made, DENSE, 0)[0]
        off = surface.distance(kept[:: DENSE // SAMPLES])
        lost = np.asarray(cKDTree(kept).query(points)[0])
        return bool(np.quantile(off, 0.99) <= error_m and lost.max() <= LOST * mesh.diagonal)

    light, made = mesh, clustered(mesh, CELL * error_m, DECIMALS)
    if better(made, light):
        light = made
    while better(made := _thinned(light, max(SMALLEST, len(light.faces) // 2)), light):
        light = made
    return light


def _thinned(mesh: TriangleMesh, goal: int) -> TriangleMesh:
    made = simplified(mesh, goal, DECIMALS)
    return made if len(made.faces) >= 4 else mesh  # a flat sheet vanishes
