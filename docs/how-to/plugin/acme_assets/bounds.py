"""The box around a mesh, along the axes of its frame."""

from __future__ import annotations

from pydantic import Field

from assetbuild.collision import CollisionMethod, Fitted
from assetbuild.mesh.cover import Reference
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.recipe_types import Length
from assetbuild.robot.pose import Pose, vec3
from assetbuild.robot.shapes import Box


class Bounds(CollisionMethod):
    """One box of each source shape."""

    grow: Length = Field(0.0, description="m: added on every side, `2 mm` or m")

    def fit(self, reference: Reference) -> Fitted:
        """Middle and size of the bounds."""
        lower, upper = reference.mesh.bounds
        box = Box(vec3(upper - lower + 2.0 * self.grow))
        return Fitted((ConvexPiece(box, Pose(vec3((lower + upper) / 2.0))),), how="bounds")
