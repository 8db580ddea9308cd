"""Visual meshes light enough to look at, for the 3D view of the report."""

from __future__ import annotations

from collections.abc import Mapping

from assetbuild.mesh.simplify import clustered, simplified
from assetbuild.mesh.triangles import TriangleMesh, area, cleaned

MOST = 40_000
"""Triangles of all visual meshes together, each counted once."""
SMALLEST = 400
"""Triangles up to which a mesh is left as it is: a screw stays a screw."""
OWN, WHOLE = 0.005, 0.0012
"""Side of the cells within which vertices become one, as a share of the mesh's own diagonal and of
the largest mesh's: 0.8 mm on a trunk of 0.6 m, a pixel of the view. The larger counts."""
AREA = (0.95, 1.05)
"""Area after / before. Where decimation eats thin parts and small components, it falls."""
DECIMALS = 5
"""Of a metre, to which vertices are rounded."""


def lightened(meshes: Mapping[str, TriangleMesh], max_faces: int = MOST) -> dict[str, TriangleMesh]:
    """The meshes that became smaller, by name.

    Vertices that nearly touch become one; where the meshes then have more than `max_faces`
    triangles together, all lose some in proportion, but for those that would lose area with them.
    The view shows colours and no textures. Nothing of this is physics, and no target reads it.
    """
    plain = {name: cleaned(mesh) for name, mesh in meshes.items()}
    large = {name: mesh for name, mesh in plain.items() if len(mesh.faces) > SMALLEST}
    whole = max((mesh.diagonal for mesh in large.values()), default=0.0)
    joined = {
        name: clustered(mesh, max(OWN * mesh.diagonal, WHOLE * whole), DECIMALS)
        for name, mesh in large.items()
    }
    share = max_faces / max(sum(len(mesh.faces) for mesh in joined.values()), 1)
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
