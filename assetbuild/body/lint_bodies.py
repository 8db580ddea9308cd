"""Look over the bodies that will be simulated: wrong mass properties and limits are errors."""

from __future__ import annotations

from collections.abc import Iterator

from pydantic import Field

from assetbuild.body.inertia_rules import Bounds, inertia_findings
from assetbuild.body.limit_rule import crossed_limits
from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding
from assetbuild.robot.codec import decode
from assetbuild.robot.model import SourceShapes, Tree


class LintBodies(Step):
    """`tree.json`, `shapes.json` -> findings only, by the same rules as `lint_links`."""

    version = "6"

    bounds: Bounds = Field(default_factory=Bounds)

    def run(self, files: Files) -> Iterator[Finding]:
        """Findings in tree order."""
        tree = decode(Tree, (files.inputs / "tree.json").read_bytes())
        shapes = decode(SourceShapes, (files.inputs / "shapes.json").read_bytes())
        yield from inertia_findings(tree, shapes, self.bounds, "error")
        for joint in tree.moving_joints:
            yield from crossed_limits(joint, "error")
