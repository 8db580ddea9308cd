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
from assetbuild.mesh.obj import obj_bytes, read_triangles
from assetbuild.mesh.quality import NearestSurface, surface_samples
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.mesh.weld import cleaned
from assetbuild.robot.pose import Array

SMALLEST = 400
"""Triangles up to which a mesh is left as it is: a screw stays a screw."""
OWN, WHOLE = 0.0025, 0.0006
"""Error that is allowed, as a share of the mesh's own diagonal and of the largest mesh's: 0.4 mm
on a trunk of 0.6 m, less than a pixel of the view. The larger of the two counts."""
SAMPLES = 2500
"""Points of both surfaces between which the error is measured."""
HALVINGS = 3
"""A mesh keeps an eighth of its triangles, or more."""
FEW, SURELY = 250, 0.05
"""Where more than 5 % of so few points err, more than 1 % of all do."""


class Lighten(Step):
    """Converted meshes -> `light/`: those that lost triangles, each named after its full file.

    Each mesh keeps its shape: 99 % of both surfaces lie within an error that the view does not
    show. Only a robot that has more than `max_faces` triangles then loses more of them, all meshes
    in proportion. The view shows colours and no textures, so their coordinates are lost as well.
    Nothing of this is physics, and no target reads it.
    """

    usual_s = 3.0
    outputs = ("light/",)
    isolated = True
    preload = ("numpy", "scipy.spatial", "fast_simplification")
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
            light = {n: _simplified(m, int(len(m.faces) * share)) or m for n, m in light.items()}
        return {name: mesh for name, mesh in light.items() if mesh is not plain[name]}


def _light(mesh: TriangleMesh, error_m: float) -> TriangleMesh:
    """Halve the triangles up to three times, and return the smallest mesh that keeps its shape.

    Each is made from the one before, until even a few of its points lie too far off. The smallest
    whose points all lie near enough is taken; `mesh` itself where none does.
    """
    surface = NearestSurface(mesh)
    points = surface_samples(mesh, SAMPLES, 1)[0]
    halved = [mesh]
    for _ in range(HALVINGS):
        made = _simplified(halved[-1], max(SMALLEST, len(halved[-1].faces) // 2))
        if made is None or len(made.faces) >= len(halved[-1].faces):
            break
        few = surface.distance(surface_samples(made, FEW, 0)[0])
        if np.count_nonzero(few > error_m) > SURELY * FEW:
            break
        halved.append(made)
    for made in halved[:0:-1]:
        theirs = surface_samples(made, SAMPLES, 0)[0]
        if _p99(surface, theirs) <= error_m and _p99(NearestSurface(made), points) <= error_m:
            return made
    return mesh


def _p99(surface: NearestSurface, points: Array) -> float:
    return float(np.quantile(surface.distance(points), 0.99))


def _simplified(mesh: TriangleMesh, goal: int) -> TriangleMesh | None:
    import fast_simplification

    if goal >= len(mesh.faces):
        return None
    # At the origin and of unit size, so that no threshold inside depends on the scale.
    lower, upper = mesh.bounds
    size = max(float((upper - lower).max()), 1e-300)
    vertices, faces = fast_simplification.simplify(
        np.ascontiguousarray((mesh.vertices - lower) / size),
        mesh.faces.astype(np.int32),
        target_count=goal,
        agg=3.0,
    )
    points = np.round(np.asarray(vertices, dtype=np.float64) * size + lower, 5)
    light = cleaned(TriangleMesh(points, np.asarray(faces, dtype=np.int64)))
    return light if len(light.faces) >= 4 else None  # None: a flat sheet that vanished
