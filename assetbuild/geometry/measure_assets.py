"""What the mesh and picture files of the robot hold, measured once for all comparisons."""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.engine.digest import digest_bytes
from assetbuild.engine.step import Files, Step
from assetbuild.facts.reference import Assets
from assetbuild.facts.surface import measure, pixel_digest
from assetbuild.findings import Finding
from assetbuild.mesh import MESH_MODULES
from assetbuild.mesh.hull import hull_or_points
from assetbuild.mesh.hulls import write_meshes
from assetbuild.mesh.obj import read_triangles
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles


class MeasureAssets(Step):
    """`shapes.json`, `meshes/` -> `assets.json`, `triangles.npz`, `hulls.npz`.

    The surface of every mesh and the pixels of every picture; the meshes themselves and their
    hulls, each kind in one file.
    """

    usual_s = 0.4
    outputs = ("assets.json", "triangles.npz", "hulls.npz")
    isolated = True
    preload = MESH_MODULES

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads each file of `meshes/` that the robot names."""
        robot = RobotFiles(files.inputs)
        surfaces, meshes, digests = [], [], []
        for asset in robot.shapes.meshes:
            data = (robot.mesh_dir / asset.file).read_bytes()
            mesh = read_triangles(data, asset.file)
            surfaces.append((asset.name, measure(mesh.corners, mesh.uv)))
            meshes.append(mesh)
            digests.append((asset.name, digest_bytes(data)))
        textures = sorted({m.texture for m in robot.shapes.materials if m.texture})
        pixels = [(t, shown) for t in textures if (shown := pixel_digest(robot.mesh_dir / t))]
        assets = Assets(tuple(surfaces), tuple(pixels), tuple(digests))
        (files.outputs / "assets.json").write_bytes(encode(assets))
        write_meshes(files.outputs / "triangles.npz", meshes)
        hulls = [hull_or_points(mesh.vertices) for mesh in meshes]
        write_meshes(files.outputs / "hulls.npz", hulls)
        yield from ()
