"""`split_joint: {joint}`: a joint of several coordinates becomes a row of joints with one each."""

from __future__ import annotations

import re
from collections.abc import Iterator

from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.errors import RecipeError
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import Edit, Edited
from assetbuild.recipe_types import Pattern
from assetbuild.robot.chains import ROWS, between, split
from assetbuild.robot.model import Joint, Tree
from assetbuild.robot.shapes import SourceShapes

SPLIT_JOINT = Rule(
    "edit.split_joint",
    ("info", "warning"),
    "a planar, ball or floating joint became joints of one coordinate each with massless links "
    "between them (warning: in one pose two of the angles turn about one axis)",
    "give the massless links a mass by `share_mass` where USD is written",
)


class SplitJoint(Edit):
    """For USD and drives: planar to x, y and yaw; ball to x, y and z; floating to all six.

    A planar joint of a mobile base becomes two slides and a hinge, which actuators can drive. The
    hinges of a ball turn about x first, then y, then z; those of a floating joint are yaw, pitch
    and roll. The new joints are called `<joint>_x`, the links between them `<joint>_x_link`.
    """

    joint: Pattern = Field(description="planar, ball or floating joints, by whole name")

    def edit(self, tree: Tree, shapes: SourceShapes, files: Files) -> Edited:
        """See `Edit`."""
        chosen = [joint for joint in tree.joints if re.fullmatch(self.joint, joint.name)]
        for joint in chosen:
            if joint.kind not in ROWS:
                message = f"split_joint: joint `{joint.name}` is {joint.kind}: it cannot be split"
                raise RecipeError(message, hint="only planar, ball and floating joints can")
        done = split(tree, frozenset(joint.name for joint in chosen))
        taken = [*(body.name for body in done.bodies), *(joint.name for joint in done.joints)]
        twice = [name for name in taken if taken.count(name) > 1 and name not in tree.by_body]
        if twice:
            message = f"split_joint: `{twice[0]}` is the name of a link or joint already"
            raise RecipeError(message, hint="rename it first")
        return Edited(done, shapes, tuple(_findings(chosen)))


def _findings(chosen: list[Joint]) -> Iterator[Finding]:
    for joint in chosen:
        parts = ", ".join(f"`{joint.name}_{suffix}`" for suffix, _ in ROWS[joint.kind])
        message = f"the {joint.kind} joint became {parts}, one after the other"
        if joint.damping or joint.friction:
            message += "; its damping and friction are left out, state them in `actuators`"
        singular = joint.kind != "planar"
        if singular:
            message += "; with the second angle at 90 degrees the others turn about one axis"
        yield SPLIT_JOINT(
            f"joint {joint.name}",
            message,
            severity="warning" if singular else "info",
            data={"kind": joint.kind, "links": between(joint)},
        )
