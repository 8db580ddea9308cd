"""Does yourdfpy, which shares no code with us, place the links of the written URDF as we do?"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.mesh import MESH_MODULES
from assetbuild.plugin_types import Check, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Tree
from assetbuild.robot.tree import forward_kinematics, held_by_world, sample_positions

DIFFERS = Rule(
    "urdf.kinematics.*",
    "error",
    "yourdfpy cannot read the written URDF, or places its links elsewhere",
    "report it with the recipe: this is a bug",
    was={
        "urdf.reload.kinematics": ("urdf.kinematics.place",),
        "urdf.reload.structure": ("urdf.kinematics.unreadable",),
        "urdf.reload.unreadable": ("urdf.kinematics.unreadable",),
    },
)


class UrdfKinematics(Check):
    """It loads and moves alike at random positions.

    Figure: the largest difference of any entry of a link's 4 x 4 pose in the root link; metres
    and direction cosines.
    """

    shares = True
    isolated: ClassVar = True
    preload: ClassVar = MESH_MODULES  # yourdfpy needs trimesh, which needs most of them
    imports: ClassVar = ("yourdfpy",)
    needs: ClassVar = ("urdf",)
    reads: ClassVar = ("links.json",)

    robot: str
    samples: int = 10
    tolerance: float = 1e-9

    def run(self, files: Files) -> Iterator[Finding]:
        """What is not there at all is found by the reader of facts."""
        links = held_by_world(RobotFiles(files.inputs).links)
        figures: dict[str, object] = {"samples": self.samples, "links": len(links.bodies)}
        limits = {"kinematics_error": self.tolerance}
        try:
            worst, where = _farthest(links, files.inputs / f"urdf/{self.robot}.urdf", self.samples)
        except Exception as error:  # whatever a parser throws is the finding
            write_figures(files, figures)
            yield DIFFERS.named("unreadable")("robot", f"yourdfpy cannot read it: {error}")
            return
        write_figures(files, figures | {"kinematics_error": worst}, limits)
        if not worst <= self.tolerance:
            message = f"yourdfpy places it {worst:.3g} off (at most {self.tolerance:g})"
            yield DIFFERS.named("place")(f"link {where}", message, data={"error": worst})


def _farthest(links: Tree, path: Path, samples: int) -> tuple[float, str]:
    """The largest error of a pose, and its link."""
    import yourdfpy

    model = yourdfpy.URDF.load(str(path), build_scene_graph=False).robot
    for link in model.links:
        link.visuals, link.collisions = [], []  # no geometry is built, frames are enough
    for joint in model.joints:
        joint.mimic = None  # every joint moves by its own entry, as in our kinematics
    moving = yourdfpy.URDF(robot=model, load_meshes=False)
    worst, where = 0.0, links.root
    for positions in sample_positions(links, samples, seed=0):
        moving.update_cfg(positions)
        for name, X_root_link in forward_kinematics(links, positions).items():
            theirs = moving.get_transform(name, links.root)
            error = float(np.abs(theirs - X_root_link.matrix()).max())
            if not error <= worst:
                worst, where = error, name
    return worst, where
