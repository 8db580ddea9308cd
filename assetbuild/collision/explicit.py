"""The user's own pieces: boxes, balls, capsules and cylinders in the frame of the link."""

from __future__ import annotations

from collections.abc import Iterable

from pydantic import Field

from assetbuild.collision import CollisionMethod, Fitted, PlacedSource, write_pieces
from assetbuild.engine.step import Files
from assetbuild.findings import Finding
from assetbuild.mesh.cover import Reference
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.recipe.collision import ExplicitPiece
from assetbuild.robot.model import Box, Capsule, Cylinder, Sphere
from assetbuild.robot.pose import Pose, quat_of_rpy


class Explicit(CollisionMethod):
    """What the recipe lists, as it is; measured against the link's geometry if it has any."""

    scope = "link"
    tools = CollisionMethod.hull_tools

    sources: tuple[PlacedSource, ...] = ()
    pieces: tuple[ExplicitPiece, ...] = Field(min_length=1)
    """In the frame of the link."""

    def run(self, files: Files) -> Iterable[Finding]:
        """As every method; a link without geometry has nothing to be measured against."""
        if not self.sources:
            write_pieces(files.outputs, self._made(), None)
            return ()
        return super().run(files)

    def exact(self) -> None:
        """The recipe's pieces replace the source's primitive, too."""

    def fit(self, reference: Reference) -> Fitted:
        """The recipe's pieces."""
        return Fitted(self._made(), how="explicit")

    def _made(self) -> tuple[ConvexPiece, ...]:
        return tuple(
            ConvexPiece(None, _geometry(piece), Pose(piece.xyz, quat_of_rpy(*piece.rpy)))
            for piece in self.pieces
        )


def _geometry(piece: ExplicitPiece) -> Box | Sphere | Capsule | Cylinder:
    if piece.size is not None:
        return Box(piece.size)
    radius, length = piece.radius or 0.0, piece.length or 0.0
    if piece.type == "sphere":
        return Sphere(radius)
    return Capsule(radius, length) if piece.type == "capsule" else Cylinder(radius, length)
