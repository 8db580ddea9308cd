"""Visual meshes light enough to look at, for the 3D view of the report."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.findings import Finding
from assetbuild.mesh import MESH_MODULES
from assetbuild.mesh.obj import obj_bytes, read_triangles
from assetbuild.mesh.simplify import clustered, simplified
from assetbuild.mesh.triangles import TriangleMesh, area, cleaned

SMALLEST = 400
"""Triangles up to which a mesh is left as it is: a screw stays a screw."""
OWN, WHOLE = 0.005, 0.0012
"""Side of the cells within which vertices become one, as a share of the mesh's own diagonal and of
the largest mesh's: 0.8 mm on a trunk of 0.6 m, a pixel of the view. The larger counts."""
AREA = (0.95, 1.05)
"""Area after / before. Where decimation eats thin parts and small components, it falls."""
DECIMALS = 5
"""Of a metre, to which vertices are rounded."""


class Lighten(Step):
    """Converted meshes -> `light/`: those that lost triangles, each named after its full file.

    Vertices that nearly touch become one; where the meshes then have more than `max_faces`
    triangles, all lose some in proportion, but for those that would lose area with them. The view
    shows colours and no textures, so their coordinates are lost as well.
    Nothing of this is physics, and no target reads it.
    """

    usual_s = 1.0
    outputs = ("light/",)
    isolated = True
    preload = MESH_MODULES
    limits: ClassVar[Limits] = Limits(wall_s=600.0)

    max_faces: int = Field(40_000, ge=100)
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
        large = {name: mesh for name, mesh in plain.items() if len(mesh.faces) > SMALLEST}
        whole = max((mesh.diagonal for mesh in large.values()), default=0.0)
        joined = {
            name: clustered(mesh, max(OWN * mesh.diagonal, WHOLE * whole), DECIMALS)
            for name, mesh in large.items()
        }
        share = self.max_faces / max(sum(len(mesh.faces) for mesh in joined.values()), 1)
        light = {name: _light(mesh, joined[name], share) for name, mesh in large.items()}
        return {name: mesh for name, mesh in light.items() if mesh is not plain[name]}


def _light(mesh: TriangleMesh, joined: TriangleMesh, share: float) -> TriangleMesh:
    """A share of the triangles of the mesh with joined vertices, if the area stays; else that mesh;
    else the full one."""
    goal = max(SMALLEST, int(len(joined.faces) * share))
    whole = area(mesh)
    for made in (simplified(joined, goal, DECIMALS), joined):
        kept = len(made.faces) >= 4 and AREA[0] <= area(made) / whole <= AREA[1]
        if kept and len(made.faces) < len(mesh.faces):
            return made
    return mesh
