"""Are left and right of the robot mirror images of each other?"""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from assetbuild.engine.step import Files
from assetbuild.findings import Finding
from assetbuild.plugin_types import Check, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.mirror import Tolerances, mirror_findings
from assetbuild.robot.twins import twins


class Mirror(Check):
    """Findings `mirror.<what>`; figures: the pairs, and which axis of the root points sideways."""

    shares = True
    reads = ("tree.json", "control.json")

    sections: ClassVar = {"validate.mirror": "allowed"}

    allowed: Tolerances = Tolerances()

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the bodies, their joints, the table and the initial keyframe."""
        robot = RobotFiles(files.inputs)
        symmetry = twins(robot.tree, robot.control, self.allowed.place)
        figures: dict[str, object] = {
            "twins": len(symmetry.pairs),
            "pairs": [[a.name, b.name] for a, b in symmetry.pairs],
        }
        if symmetry.pairs:
            figures["sideways"] = "xyz"[symmetry.axis]
        write_figures(files, figures)
        yield from mirror_findings(symmetry, self.allowed)
