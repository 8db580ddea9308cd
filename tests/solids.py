"""Solids as meshes, and collision methods run on them."""

from __future__ import annotations

from pathlib import Path

from robot_files import run_step

from assetbuild.collision import CollisionMethod, PlacedSource
from assetbuild.findings import Finding
from assetbuild.geometry.convert_mesh import write_converted
from assetbuild.mesh.arrays import read_meshes
from assetbuild.mesh.cover import union_of
from assetbuild.mesh.material import MaterialPart, SurfaceMaterial
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import TriangleMesh, cleaned
from assetbuild.plugin_types import Pieces
from assetbuild.robot.codec import decode
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box

MESH = (PlacedSource("shapes/0"),)
"""The sources of a method: the mesh that `fit` gives it."""
UNIT = tessellate(Box((1.0, 1.0, 1.0)))
Sized = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Size and centre, m."""


def solid(*boxes: Sized) -> TriangleMesh:
    """The union of boxes."""
    return cleaned(union_of([ConvexPiece(Box(size), Pose(at)) for size, at in boxes])[1])


L_SHAPE = solid(((2, 1, 1), (1, 0.5, 0.5)), ((1, 2, 1), (0.5, 1, 0.5)))
"""An L of 2 x 2 x 1 m with arms 1 m wide: volume 3 m3, its hull 3.5 m3."""


def converted(folder: Path, mesh: TriangleMesh) -> None:
    """The mesh as the step that converts meshes leaves it."""
    folder.mkdir(parents=True, exist_ok=True)
    write_converted(folder, [MaterialPart(SurfaceMaterial(), mesh)])


def fit(
    tmp_path: Path, method: CollisionMethod, *meshes: TriangleMesh, run: str = "out"
) -> tuple[tuple[ConvexPiece, ...], list[TriangleMesh], dict[str, Finding], dict[str, bytes]]:
    """(pieces, their hull meshes, findings by rule, all bytes)."""
    for number, mesh in enumerate(meshes):
        converted(tmp_path / f"in/shapes/{number}", mesh)
    outputs = tmp_path / run
    findings = {f.rule: f for f in run_step(method, tmp_path / "in", outputs)}
    record = decode(Pieces, (outputs / "pieces.json").read_bytes())
    hulls = list(read_meshes(outputs / "pieces.npz").values())
    files = {str(p.relative_to(outputs)): p.read_bytes() for p in outputs.rglob("*.*")}
    return record.pieces, hulls, findings, files
