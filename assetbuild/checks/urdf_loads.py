"""Do other people's readers take the written URDF: yourdfpy, and urdfdom where it is installed?

urdfdom is the reader of ROS, MoveIt and pinocchio, through which it is asked; it is stricter than
yourdfpy. What the file says is compared with the robot by the reader of facts.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import ClassVar

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, write_figures
from assetbuild.mesh import MESH_MODULES

REFUSED = Rule(
    "urdf.refused",
    "error",
    "yourdfpy refuses the written URDF, or urdfdom, and with it ROS, MoveIt and pinocchio",
    "report it: this is a bug",
    was={
        "urdf.reload.structure": ("urdf.refused",),
        "urdf.reload.unreadable": ("urdf.refused",),
    },
)
OURS = "this is a fault of assetbuild: please report it with the recipe"


class UrdfLoads(Check):
    """One finding for each reader that refuses it, with its own words.

    Figures: the links that yourdfpy finds, and the joints that urdfdom finds.
    """

    isolated: ClassVar = True
    # As convert_mesh of a glTF, which has loaded most of yourdfpy.
    preload: ClassVar = MESH_MODULES  # yourdfpy needs trimesh, which needs most of them
    needs: ClassVar = ("urdf",)
    reads: ClassVar = ()

    robot: str

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `urdf/<robot>.urdf` and its meshes."""
        path = files.inputs / "urdf" / f"{self.robot}.urdf"
        figures: dict[str, object] = {}
        try:
            figures["links"] = _links(path)
        except Exception as error:  # whatever a parser throws is the finding
            yield REFUSED("robot", f"yourdfpy cannot read it: {error}", OURS)
        if find_spec("pinocchio"):
            figures["joints"], said = loaded(path)
            if said:
                yield REFUSED("robot", f"urdfdom does not read the URDF: {said}", OURS)
        write_figures(files, figures)


def _links(path: Path) -> int:
    """How many links yourdfpy places."""
    import yourdfpy

    model = yourdfpy.URDF.load(str(path), build_scene_graph=False).robot
    for link in model.links:
        link.visuals, link.collisions = [], []  # no geometry is built, frames are enough
    placed = yourdfpy.URDF(robot=model, load_meshes=False)
    for link in model.links:
        placed.get_transform(link.name)
    return len(model.links)


def loaded(path: Path) -> tuple[int | None, str]:
    """The joints that move, or None and what urdfdom says, which it writes to stderr."""
    import pinocchio

    with tempfile.TemporaryFile() as log:
        stderr = os.dup(2)
        os.dup2(log.fileno(), 2)
        try:
            return int(pinocchio.buildModelFromUrdf(str(path)).njoints) - 1, ""
        except (ValueError, RuntimeError) as error:
            log.seek(0)
            lines = log.read().decode("utf-8", "replace").splitlines()
            words = [line.removeprefix("Error:").strip() for line in lines if "Error:" in line]
            return None, "; ".join(words) or str(error)
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
