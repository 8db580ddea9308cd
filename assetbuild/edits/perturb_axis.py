"""`perturb_axis: {joint, eps}`: a joint axis that is no longer exactly a body axis."""

from __future__ import annotations

import math
from dataclasses import replace

from pydantic import Field

from assetbuild.errors import RecipeError
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import JointEdit
from assetbuild.robot.model import MOVING, Joint
from assetbuild.robot.pose import Vec3

PERTURB_AXIS = Rule(
    "edit.perturb_axis",
    "info",
    "a joint axis was turned slightly off the axes of its body",
    "nothing",
)


class PerturbAxis(JointEdit):
    """Axes are turned a little, for runtimes to which one along x, y or z is a special case.

    Only axes that are parallel to one are turned; the others stay as they are.
    """

    eps: float = Field(1e-6, gt=1e-8, le=1e-3, description="rad by which the axis is turned")

    def change(self, joint: Joint) -> tuple[Joint, Finding]:
        """See `JointEdit`."""
        if joint.kind not in MOVING:
            raise RecipeError(f"perturb_axis: joint `{joint.name}` is {joint.kind}: it has no axis")
        axis = self._axis(joint.axis)
        finding = PERTURB_AXIS(
            f"joint {joint.name}",
            f"axis turned by {self.eps:g} rad"
            if axis != joint.axis
            else "axis left as it is: parallel to no axis of its body",
            data={"before": joint.axis, "after": axis},
        )
        return replace(joint, axis=axis), finding

    def _axis(self, axis: Vec3) -> Vec3:
        """Turned towards the next body axis; exactly unit length to first order in eps."""
        along = max(range(3), key=lambda i: abs(axis[i]))
        if abs(axis[along]) < 1.0 - 1e-12:
            return axis
        turned = [0.0, 0.0, 0.0]
        turned[along] = math.copysign(math.cos(self.eps), axis[along])
        turned[(along + 1) % 3] = math.sin(self.eps)
        x, y, z = turned
        return x, y, z
