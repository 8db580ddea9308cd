"""Visual meshes light enough to look at: for the pictures and the 3D view of the report."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import ClassVar

import numpy as np
from pydantic import Field

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.findings import Finding
from assetbuild.mesh.obj import obj_bytes, read_triangles
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.mesh.weld import cleaned
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.shapes import Mesh, MeshAsset, Shapes

SMALLEST = 60
"""Triangles below which no mesh is decimated: a screw stays a screw."""


class Lighten(Step):
    """`shapes.json`, `meshes/` -> the same two, visual meshes decimated to a common budget.

    Nothing of this is physics: collision meshes pass through as they are, and no target reads it.
    Thinning loses the coordinates on a texture, so textured meshes stay whole, or, where they are
    too many, lose the texture with them.
    """

    outputs = ("shapes.json", "meshes/")
    isolated = True
    preload = ("numpy", "scipy.spatial", "fast_simplification")
    limits: ClassVar[Limits] = Limits(wall_s=180.0)

    max_faces: int = Field(30_000, ge=100)
    """Triangles of all visual meshes together, each counted once."""

    def run(self, files: Files) -> Iterable[Finding]:
        """Reads the final shapes; a mesh that cannot be decimated stays as it is."""
        shapes = RobotFiles(files.inputs).shapes
        names = {s.geometry.mesh for s in shapes.of("visual") if isinstance(s.geometry, Mesh)}
        names -= {s.geometry.mesh for s in shapes.of("collision") if isinstance(s.geometry, Mesh)}
        shapes, textured = self._textured(shapes)
        names -= textured
        thinned = sum(asset.faces for asset in shapes.meshes if asset.name in names)
        whole = sum(asset.faces for asset in shapes.meshes if asset.name in textured)
        room = max(self.max_faces - whole, self.max_faces // 4)
        share = min(1.0, room / max(thinned, 1))
        (files.outputs / "meshes").mkdir()
        made: dict[str, MeshAsset] = {}
        for asset in shapes.meshes:
            data = (files.inputs / "meshes" / asset.file).read_bytes()
            goal = max(SMALLEST, int(asset.faces * share))
            if asset.name in names and goal < asset.faces:
                data, asset = _light(data, asset, goal)
            (files.outputs / "meshes" / asset.file).write_bytes(data)
            made[asset.name] = asset
        for material in shapes.materials:
            picture = files.inputs / "meshes" / (material.texture or "")
            if material.texture and picture.is_file():
                (files.outputs / "meshes" / material.texture).write_bytes(picture.read_bytes())
        final = replace(shapes, meshes=tuple(made.values()))
        (files.outputs / "shapes.json").write_bytes(encode(final))
        return ()

    def _textured(self, shapes: Shapes) -> tuple[Shapes, set[str]]:
        """Meshes that keep their texture, and the shapes, plain where those are too many."""
        pictures = {material.name for material in shapes.materials if material.texture}
        found = {
            shape.geometry.mesh
            for shape in shapes.of("visual")
            if isinstance(shape.geometry, Mesh) and shape.material in pictures
        }
        if sum(asset.faces for asset in shapes.meshes if asset.name in found) <= 2 * self.max_faces:
            return shapes, found
        plain = tuple(replace(material, texture=None) for material in shapes.materials)
        return replace(shapes, materials=plain), set()


def _light(data: bytes, asset: MeshAsset, goal: int) -> tuple[bytes, MeshAsset]:
    import fast_simplification

    mesh = cleaned(replace(read_triangles(data, asset.name), normals=None, uv=None))
    if len(mesh.faces) <= goal:
        return obj_bytes(mesh), _described(asset, mesh)
    # At the origin and of unit size, so that no threshold inside depends on the scale.
    lower, upper = mesh.bounds
    size = max(float((upper - lower).max()), 1e-300)
    vertices, faces = fast_simplification.simplify(
        np.ascontiguousarray((mesh.vertices - lower) / size),
        mesh.faces.astype(np.int32),
        target_count=goal,
    )
    points = np.round(np.asarray(vertices, dtype=np.float64) * size + lower, 5)
    light = cleaned(TriangleMesh(points, np.asarray(faces, dtype=np.int64)))
    if len(light.faces) < 4:  # too small for its digits, or a flat sheet that vanished
        return data, asset
    return obj_bytes(light), _described(asset, light)


def _described(asset: MeshAsset, mesh: TriangleMesh) -> MeshAsset:
    return replace(asset, vertices=len(mesh.vertices), faces=len(mesh.faces))
