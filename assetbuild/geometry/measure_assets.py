"""What the mesh and picture files of the robot hold, measured once for all comparisons."""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.engine.step import Files, Step
from assetbuild.facts.picture import pixel_digest
from assetbuild.facts.reference import Assets
from assetbuild.facts.surface import measure
from assetbuild.findings import Finding
from assetbuild.mesh.obj import read_triangles
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles


class MeasureAssets(Step):
    """`shapes.json`, `meshes/` -> `assets.json`: surface of every mesh, pixels of every picture."""

    outputs = ("assets.json",)

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads each file of `meshes/` that the robot names."""
        robot = RobotFiles(files.inputs)
        surfaces = []
        for asset in robot.shapes.meshes:
            mesh = read_triangles((robot.mesh_dir / asset.file).read_bytes(), asset.file)
            surfaces.append((asset.name, measure(mesh.corners, mesh.uv, mesh.normals)))
        textures = sorted({m.texture for m in robot.shapes.materials if m.texture})
        read = {file: pixel_digest(robot.mesh_dir / file) for file in textures}
        pixels = tuple((file, digest) for file, digest in read.items() if digest)
        (files.outputs / "assets.json").write_bytes(encode(Assets(tuple(surfaces), pixels)))
        yield from ()
