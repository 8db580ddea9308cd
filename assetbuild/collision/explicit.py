"""The user's own pieces: primitives and convex mesh files, in the frame of the link."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Literal

from pydantic import Field, model_validator

from assetbuild.collision import CollisionMethod, PlacedSource, write_pieces
from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.mesh.cover import Reference, measure
from assetbuild.mesh.hull import convex_hull, refuse_flat
from assetbuild.mesh.primitives import BY_NAME, resized
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import TriangleMesh, cleaned, signed_volume
from assetbuild.recipe_types import Model, NonNegative, Positive, Real, Turns
from assetbuild.robot.pose import Pose, quat_of_rpy

CONVEX = 0.99
"""Volume / volume of the hull: below it a mesh is reported as not convex."""

NOT_CONVEX = Rule(
    "collision.not_convex",
    "warning",
    "a mesh of `explicit` is open or not convex; its hull collides, and the finding states which "
    "share of the hull a closed one fills",
    "close it, or cut it into convex pieces",
)


class ExplicitPiece(Model):
    """A piece of collision geometry of the user's own, in the frame of the link."""

    type: Literal["box", "sphere", "capsule", "cylinder", "mesh"] = Field(description="its kind")
    file: str | None = Field(
        None,
        min_length=1,
        description="of a mesh: one convex piece, its path from the recipe's folder",
    )
    scale: tuple[Real, Real, Real] | None = Field(
        None, description="of a mesh, per axis; 0.001 for a file in mm"
    )
    size: tuple[Positive, Positive, Positive] | None = Field(None, description="edges of a box, m")
    radius: Positive | None = Field(None, description="m")
    length: NonNegative | None = Field(
        None, description="of a cylinder; of a capsule without its caps, m"
    )
    xyz: tuple[Real, Real, Real] = Field(
        (0.0, 0.0, 0.0), description="its centre, of a mesh its origin, m"
    )
    rpy: Turns = Field((0.0, 0.0, 0.0), description="its turn, rad, as in URDF; axis z")

    @model_validator(mode="after")
    def _complete(self) -> ExplicitPiece:
        needed = _NEEDED.get(self.type, {"radius", "length"})
        given = {name for name in _SIZES if getattr(self, name) is not None}
        if given != needed:
            raise ValueError(f"a {self.type} has {' and '.join(sorted(needed))}, nothing else")
        if self.scale is not None and (self.file is None or 0.0 in self.scale):
            raise ValueError("`scale` belongs to a mesh, and is not 0")
        return self


_SIZES = ("size", "radius", "length", "file")
_NEEDED = {"box": {"size"}, "sphere": {"radius"}, "mesh": {"file"}}


class Explicit(CollisionMethod):
    """What the recipe lists, as it is; measured against the link's geometry if it has any.

    Simulators collide the hull of a mesh, so that is what is measured and written; a mesh that is
    not its own hull leaves a finding.
    """

    scope = "link"

    sources: tuple[PlacedSource, ...] = ()
    pieces: tuple[ExplicitPiece, ...] = Field(
        min_length=1, max_length=1024, description="the geometry itself, in the frame of the link"
    )

    def run(self, files: Files) -> Iterable[Finding]:
        """A link without geometry has nothing to be measured against.

        Raises StepError for a mesh that spans no volume.
        """
        made = []
        for number, piece in enumerate(self.pieces, start=1):
            pose = Pose(piece.xyz, quat_of_rpy(*piece.rpy))
            if piece.file is None:
                round_ = [size for size in (piece.radius, piece.length) if size is not None]
                kind = BY_NAME[piece.type.capitalize()]
                made.append(ConvexPiece(resized(kind, piece.size or round_), pose))
                continue
            source = PlacedSource(piece.file, pose=pose)
            mesh = cleaned(self.source_mesh(source, files.inputs))
            refuse_flat(mesh.vertices, f"{self.subject}: piece {number}")
            hull = convex_hull(mesh.vertices)
            yield from self._not_convex(number, mesh, hull)
            made.append(ConvexPiece(hull))
        if not self.sources:
            write_pieces(files.outputs, made, None)
            return
        reference = Reference(self.mesh_of(files))
        yield from self.proven(files, reference, made, measure(reference, made), "explicit")

    def _not_convex(self, number: int, mesh: TriangleMesh, hull: TriangleMesh) -> Iterator[Finding]:
        """What a simulator will not do with this piece as it is."""
        share = abs(signed_volume(mesh)) / signed_volume(hull) if mesh.is_closed else 0.0
        if share < CONVEX:
            fault = f"not convex: it fills {100 * share:.0f} % of its hull" if share else "open"
            yield NOT_CONVEX(
                self.subject,
                f"piece {number} is {fault}; the hull is what collides",
                hint="cut it into convex pieces, one file each, or give the link `method: auto`",
                data={"piece": number, "share_of_hull": round(share, 4)},
            )
