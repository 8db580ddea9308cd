"""Does MuJoCo read every mesh that is seen as it was built?

The MJCF itself is compared without them: a new gain writes another MJCF and the same meshes, which
take longer to read than all the rest.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Self

from assetbuild.engine.step import Files
from assetbuild.errors import one_line
from assetbuild.facts.compare import differences, equality_findings
from assetbuild.facts.mjcf_model import MESHES
from assetbuild.facts.mjcf_parts import Meshes, pose_of
from assetbuild.facts.reader import UNREADABLE
from assetbuild.facts.reference import Assets
from assetbuild.facts.table import Table
from assetbuild.findings import Finding
from assetbuild.plugin_types import RecipeView, write_figures
from assetbuild.robot.codec import decode_file
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.shapes import Mesh
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import caught_warnings, mj


class MjcfMeshes(mujoco.WithMujoco):
    """Compiles the files of `meshes/` that visual shapes have; figures: their number."""

    reads: ClassVar[tuple[str, ...]] = ("shapes.json", "assets.json", "meshes/")

    @classmethod
    def configure(cls, recipe: RecipeView) -> Self | None:
        """None where no MJCF is written."""
        return super().configure(recipe) if "mjcf" in recipe.value("targets") else None

    def run(self, files: Files) -> Iterator[Finding]:
        """Findings as those of the MJCF, with the first shape that has the mesh."""
        robot = RobotFiles(files.inputs)
        shapes = {
            shape.geometry.mesh: shape.name
            for shape in reversed(robot.shapes.of("visual"))
            if isinstance(shape.geometry, Mesh)
        }
        expected, found = Table(), Table()
        for name, surface in decode_file(Assets, files.inputs / "assets.json").surfaces:
            if name in shapes:
                expected.put("shape", shapes[name], surface.facts())
        spec = mj.MjSpec()
        for asset in robot.shapes.meshes:
            if asset.name in shapes:
                inertia = mj.mjtMeshInertia.mjMESH_INERTIA_SHELL  # as the MJCF has it
                file = str(robot.mesh_dir / asset.file)
                spec.add_mesh(name=asset.name, file=file, inertia=inertia)
                spec.worldbody.add_geom(
                    type=mj.mjtGeom.mjGEOM_MESH, meshname=asset.name, contype=0, conaffinity=0
                )
        write_figures(files, {"meshes": len(shapes)})
        try:
            with caught_warnings():
                model = spec.compile()
        except ValueError as error:
            yield UNREADABLE("robot", f"MuJoCo refuses a mesh: {one_line(error)}")
            return
        meshes = Meshes(model)
        for geom in range(model.ngeom):
            mesh = int(model.geom_dataid[geom])
            surface = meshes.of(mesh).moved(pose_of(model.geom_pos[geom], model.geom_quat[geom]))
            found.put("shape", shapes[str(model.mesh(mesh).name)], surface.facts())
        yield from equality_findings(
            differences(expected, found, MESHES), "mjcf", "the MJCF", found.places
        )
