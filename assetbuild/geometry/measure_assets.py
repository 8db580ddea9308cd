"""What the mesh and picture files of the robot hold, measured once for all comparisons."""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.engine.digest import digest_file
from assetbuild.engine.step import Files, Step
from assetbuild.facts.reference import Assets
from assetbuild.facts.surface import measure, pixel_digest
from assetbuild.findings import Finding
from assetbuild.mesh import MESH_MODULES
from assetbuild.mesh.arrays import read_meshes, write_meshes
from assetbuild.mesh.hull import hull_or_points
from assetbuild.mesh.obj import read_triangles
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles


class ReadMeshes(Step):
    """`shapes.json`, `meshes/` -> `triangles.npz`: the meshes of a bundle, as its OBJ files say."""

    outputs = ("triangles.npz",)
    isolated = True

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads each file of `meshes/` that the robot names."""
        robot = RobotFiles(files.inputs)
        meshes = {
            asset.name: read_triangles((robot.mesh_dir / asset.file).read_bytes(), asset.file)
            for asset in robot.shapes.meshes
        }
        write_meshes(files.outputs / "triangles.npz", meshes)
        yield from ()


class MeasureAssets(Step):
    """`shapes.json`, `meshes/`, `triangles.npz` -> `assets.json`, `hulls.npz`.

    The surface of every mesh and the pixels of every picture; the hulls of the meshes.
    """

    shares = True
    usual_s = 0.4
    outputs = ("assets.json", "hulls.npz")
    isolated = True
    preload = MESH_MODULES

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the meshes, and each file of `meshes/` that the robot names."""
        robot = RobotFiles(files.inputs)
        meshes = read_meshes(robot.triangles, surface=True)
        surfaces = [(name, measure(mesh.corners, mesh.uv)) for name, mesh in meshes.items()]
        digests = [(a.name, digest_file(robot.mesh_dir / a.file)) for a in robot.shapes.meshes]
        textures = sorted({m.texture for m in robot.shapes.materials if m.texture})
        pixels = [(t, shown) for t in textures if (shown := pixel_digest(robot.mesh_dir / t))]
        assets = Assets(tuple(surfaces), tuple(pixels), tuple(digests))
        (files.outputs / "assets.json").write_bytes(encode(assets))
        hulls = {name: hull_or_points(mesh.vertices) for name, mesh in meshes.items()}
        write_meshes(files.outputs / "hulls.npz", hulls)
        yield from ()
