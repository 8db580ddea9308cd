"""Do the links weigh what a CAD program takes when nobody chose a material?"""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import ConvertedMesh
from assetbuild.robot.codec import decode_file
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Tree
from assetbuild.robot.shapes import SourceShapes

DEFAULT_KG_M3 = 1000.0
"""SolidWorks' density of a part without a material, water's."""
NEAR = 0.005
"""Relative: volume of the exported triangles against the CAD's own."""

DEFAULT_DENSITY = Rule(
    "inertia.default_density",
    "warning",
    "half of the links weigh 1000 kg/m³ times their visual volume, the CAD program's default",
    "`set_mass`",
)


class LintDensity(Step):
    """`links.json`, `shapes.json` and `meshes/<n>.json` of `shapes` -> findings only.

    A link counts when all its visual shapes are closed meshes.
    """

    shapes: tuple[str, ...] = ()
    """Names of the shapes whose meshes `meshes/0.json`, ... are."""
    fewest: int = 2
    """A single link of that density may well be one of plastic."""

    def run(self, files: Files) -> Iterator[Finding]:
        """One finding for the robot, when at least half of its links have that density."""
        robot = RobotFiles(files.inputs)
        volume: dict[str, float | None] = {}
        for index, name in enumerate(self.shapes):
            mesh = decode_file(ConvertedMesh, files.inputs / f"meshes/{index}.json")
            volume[name] = mesh.volume_m3
        densities = _densities(robot.links, robot.source_shapes, volume)
        suspects = tuple(
            link
            for link, density in densities.items()
            if abs(density - DEFAULT_KG_M3) <= NEAR * DEFAULT_KG_M3
        )
        if len(suspects) >= self.fewest and 2 * len(suspects) >= len(densities):
            names = ", ".join(suspects[:6]) + (", ..." if len(suspects) > 6 else "")
            yield DEFAULT_DENSITY(
                "robot",
                f"{len(suspects)} of {len(densities)} links weigh {DEFAULT_KG_M3:g} kg/m³ times "
                f"their visual volume ({names}): the CAD's density without a material?",
                "choose the materials in the CAD, or weigh the parts: `set_mass` scales mass and "
                "inertia together",
                data={"links": suspects, "density_kg_m3": DEFAULT_KG_M3},
            )


def _densities(
    tree: Tree, shapes: SourceShapes, volume: dict[str, float | None]
) -> dict[str, float]:
    """kg/m3 of the links with a mass whose visual volume is known."""
    found = {}
    for body in tree.bodies:
        own = [shape for shape in shapes.of("visual") if shape.link == body.name]
        volumes = [volume.get(shape.name) for shape in own]
        known = [value for value in volumes if value]
        if body.inertial and body.inertial.mass_kg > 0.0 and own and len(known) == len(own):
            found[body.name] = body.inertial.mass_kg / sum(known)
    return found
