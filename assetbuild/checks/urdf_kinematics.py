"""Does yourdfpy, which shares no code with us, read the same kinematics from the written URDF?"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Tree
from assetbuild.robot.tree import forward_kinematics, held_by_world, sample_positions

DIFFERS = Rule(
    "urdf.kinematics.*",
    "error",
    "yourdfpy cannot read the written URDF, or places its links elsewhere",
    "report it: this is a bug",
    was={
        "urdf.reload.kinematics": ("urdf.kinematics.place",),
        "urdf.reload.structure": ("urdf.kinematics.structure",),
        "urdf.reload.unreadable": ("urdf.kinematics.unreadable",),
    },
)


class UrdfKinematics(Check):
    """It loads, has the robot's links and joints, and moves alike at random positions.

    Figure: the largest difference of any entry of a link's 4 x 4 pose in the root link; metres
    and direction cosines.
    """

    isolated: ClassVar = True
    preload: ClassVar = (
        "numpy",
        "collada",
        "lxml.etree",
        "PIL.Image",
        "trimesh",
    )  # as convert_mesh of a glTF
    needs: ClassVar = ("urdf",)
    reads: ClassVar = ("links.json",)

    robot: str
    samples: int = 10
    tolerance: float = 1e-9

    def run(self, files: Files) -> Iterator[Finding]:
        """Writes figures.json even when something is off."""
        import yourdfpy

        links = held_by_world(RobotFiles(files.inputs).links)
        path = files.inputs / "urdf" / f"{self.robot}.urdf"
        figures: dict[str, object] = {"samples": self.samples}
        findings: list[Finding] = []
        try:
            model = yourdfpy.URDF.load(str(path), build_scene_graph=False).robot
        except Exception as error:  # whatever a parser throws is the finding
            findings.append(_off("unreadable", "robot", f"yourdfpy cannot read it: {error}"))
        else:
            figures |= {"links": len(model.links), "joints": len(model.joints)}
            findings += _structure(links, model)
            if not findings:
                findings += self._kinematics(links, model, figures)
        write_figures(files, figures, {"kinematics_error": self.tolerance})
        yield from findings

    def _kinematics(
        self,
        links: Tree,
        model: Any,
        figures: dict[str, object],  # Any: yourdfpy has no types
    ) -> Iterator[Finding]:
        import yourdfpy

        for link in model.links:
            link.visuals, link.collisions = [], []  # no geometry is built, frames are enough
        for joint in model.joints:
            joint.mimic = None  # every joint moves by its own entry, as in our kinematics
        moving = yourdfpy.URDF(robot=model, load_meshes=False)
        worst, where = 0.0, links.root
        for positions in sample_positions(links, self.samples, seed=0):
            if positions:
                moving.update_cfg(positions)
            for name, X_root_link in forward_kinematics(links, positions).items():
                theirs = np.eye(4) if name == links.root else moving.get_transform(name)
                error = float(np.abs(theirs - X_root_link.matrix()).max())
                if not error <= worst:
                    worst, where = error, name
        figures["kinematics_error"] = worst
        if not worst <= self.tolerance:
            message = f"yourdfpy places it {worst:.3g} off (at most {self.tolerance:g})"
            yield _off("place", f"link {where}", message, error=worst)


def _structure(links: Tree, model: Any) -> Iterator[Finding]:  # Any: yourdfpy has no types
    """Whether both trees have the same links and joints, or their poses cannot be compared."""
    wanted = {f"link {body.name}" for body in links.bodies}
    wanted |= {f"joint {j.name}: {j.kind}, {j.parent}, {j.child}" for j in links.joints}
    found = {f"link {link.name}" for link in model.links}
    found |= {f"joint {j.name}: {j.type}, {j.parent}, {j.child}" for j in model.joints}
    for what in sorted(wanted ^ found):
        side = "the robot" if what in wanted else "yourdfpy"
        yield _off("structure", what.partition(":")[0], f"only {side} has `{what}`")


def _off(kind: str, subject: str, message: str, **data: float) -> Finding:
    hint = "this is a fault of assetbuild: please report it with the recipe"
    return DIFFERS.named(kind)(subject, message, hint, data=data)
