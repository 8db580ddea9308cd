"""Look over the bodies that will be simulated: wrong mass properties and limits are errors."""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.body.inertia_rules import inertia_findings
from assetbuild.body.limit_rule import crossed_limits
from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.inertia import InertiaBounds


class LintBodies(Step):
    """`tree.json`, `shapes.json` -> findings only, by the same rules as `lint_links`."""

    bounds: InertiaBounds = InertiaBounds()

    def run(self, files: Files) -> Iterator[Finding]:
        """Findings in tree order."""
        robot = RobotFiles(files.inputs)
        yield from inertia_findings(robot.tree, robot.source_shapes, self.bounds, "error")
        for joint in robot.tree.moving_joints:
            yield from crossed_limits(joint, "error")
