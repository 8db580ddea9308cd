"""`flip_axis: {joint}`: the joint counts the other way round."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import ClassVar, Literal

from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.errors import RecipeError
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import Edited, JointEdit
from assetbuild.robot.model import MOVING, Joint, Limits, Mimic, Tree
from assetbuild.robot.shapes import SourceShapes

FLIP_AXIS = Rule(
    "edit.flip_axis", "info", "a joint counts in the opposite direction", "reverse its targets too"
)


class FlipAxis(JointEdit):
    """`limits: mirror`: the same robot in another sign convention; limits and mimics turn too.

    `limits: keep`: the axis itself is wrong in the source, its limits are right.
    """

    follows_names: ClassVar[bool] = False

    limits_: Literal["mirror", "keep"] = Field(
        "mirror",
        alias="limits",
        description="mirror: lower and upper change places and sign; keep: as they are",
    )

    def edit(self, tree: Tree, shapes: SourceShapes, files: Files) -> Edited:
        """See `Edit`."""
        done = super().edit(tree, shapes, files)
        if self.limits_ == "keep":
            return done
        joints = tuple(self._coupled(joint) for joint in done.tree.joints)
        return replace(done, tree=replace(done.tree, joints=joints))

    def change(self, joint: Joint) -> tuple[Joint, Finding]:
        """See `JointEdit`."""
        if joint.kind not in MOVING:
            raise RecipeError(f"flip_axis: joint `{joint.name}` is {joint.kind} and has no axis")
        x, y, z = joint.axis
        axis = (0.0 - x, 0.0 - y, 0.0 - z)  # 0.0 - 0.0 is no negative zero
        old = joint.limits
        new = old
        if self.limits_ == "mirror":
            new = replace(old, lower=_negative(old.upper), upper=_negative(old.lower))
        finding = FLIP_AXIS(
            f"joint {joint.name}",
            f"axis {_axis_text(joint.axis)} -> {_axis_text(axis)}, "
            f"limits {_range(old)} -> {_range(new)}",
            data={
                "before": joint.axis,
                "after": axis,
                "before_limits": (old.lower, old.upper),
                "after_limits": (new.lower, new.upper),
            },
        )
        return replace(joint, axis=axis, limits=new), finding

    def _coupled(self, joint: Joint) -> Joint:
        """q = offset + multiplier * q(other), with the signs of both as they are now."""
        if joint.mimic is None:
            return joint
        sign = -1.0 if re.fullmatch(self.joint, joint.name) else 1.0
        other = -1.0 if re.fullmatch(self.joint, joint.mimic.joint) else 1.0
        multiplier = sign * other * joint.mimic.multiplier
        offset = sign * joint.mimic.offset + 0.0
        return replace(joint, mimic=Mimic(joint.mimic.joint, multiplier, offset))


def _negative(value: float | None) -> float | None:
    return None if value is None else 0.0 - value


def _axis_text(axis: tuple[float, float, float]) -> str:
    return "(" + ", ".join(f"{value:g}" for value in axis) + ")"


def _range(limits: Limits) -> str:
    ends = ("-" if v is None else f"{v:.6g}" for v in (limits.lower, limits.upper))
    return "[" + ", ".join(ends) + "]"
