"""Look over the bodies that will be simulated: wrong mass properties and limits are errors."""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.body.inertia_rules import inertia_findings
from assetbuild.body.limit_rule import crossed_limits
from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding, Rule
from assetbuild.robot.codec import decode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.inertia import InertiaBounds
from assetbuild.robot.model import Tree
from assetbuild.robot.split_joints import made_links

EMPTY = Rule(
    "robot.empty",
    "warning",
    "nothing of the robot moves and nothing of it has a shape, so it is not ready",
    "give it joints or shapes; is this the right file?",
    blocks=True,
)


class LintBodies(Step):
    """`tree.json`, `shapes.json` -> findings only, by the same rules as `lint_links`.

    `source_links.json`, where it is there, tells the links that `split_joint` has made.
    """

    bounds: InertiaBounds = InertiaBounds()

    def run(self, files: Files) -> Iterator[Finding]:
        """Findings in tree order."""
        robot = RobotFiles(files.inputs)
        made, source = frozenset[str](), files.inputs / "source_links.json"
        if source.exists():
            made = made_links(decode(Tree, source.read_bytes()))
        yield from inertia_findings(robot.tree, robot.source_shapes, self.bounds, "error", made)
        for joint in robot.tree.moving_joints:
            yield from crossed_limits(joint, "error")
        moves = any(joint.kind != "fixed" for joint in robot.tree.joints)
        if not moves and not robot.source_shapes.shapes:
            message = "no joint moves and no link has a shape: there is nothing to simulate"
            yield EMPTY("robot", message, "give it joints or shapes; is this the right file?")
