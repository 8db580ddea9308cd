"""Boxes, spheres, capsules and cylinders: fastest to simulate, exact to differentiate."""

from __future__ import annotations

from typing import Literal, get_args

from pydantic import Field

from assetbuild.collision import (
    Fitted,
    LibraryMethod,
)
from assetbuild.findings import Finding
from assetbuild.mesh.cover import Reference
from assetbuild.mesh.decomposition import VHacdOptions
from assetbuild.mesh.fit import KINDS, best_primitive
from assetbuild.mesh.fit_many import fit_parts
from assetbuild.mesh.hull import convex_hull
from assetbuild.mesh.merge import grown_to, merge_steps
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Primitive

PrimitiveName = Literal["box", "sphere", "capsule", "cylinder"]
WORTH = 0.01
"""A further primitive must better the score, about 1 - IoU, by this."""
PARTS = 32
"""Parts of the decomposition that the primitives are fitted to, before they are merged."""


class FitPrimitive(LibraryMethod):
    """Few primitives for all shapes of a link, by a two-sided score of what is over and missing."""

    usual_s = 2.0
    scope = "shapes"

    shape: PrimitiveName | tuple[PrimitiveName, ...] | None = Field(
        None, description="which, or a list to choose from; without it the best of all"
    )
    max_hulls: int = Field(
        1, ge=1, le=64, description="most primitives; fewer where one more is hardly better"
    )
    vhacd: VHacdOptions = Field(
        VHacdOptions(resolution=100_000),
        description="how the mesh is cut into parts when there may be several primitives",
    )

    def exact(self) -> tuple[ConvexPiece, ...] | None:
        """A source that is a single primitive of the asked shape stays exactly as it is."""
        known = super().exact()
        return known if known and isinstance(known[0].solid, self._kinds) else None

    def fit(self, reference: Reference) -> Fitted:
        """One primitive by itself; several by parts, as many as are worth it."""
        findings: tuple[Finding, ...] = ()
        if self.max_hulls == 1:
            fits = [best_primitive(reference, self._kinds)]
        else:
            fits, findings = self._several(reference)
        pieces = tuple(ConvexPiece(primitive, pose) for primitive, pose in fits)
        return Fitted(pieces, findings, "primitives")

    @property
    def _kinds(self) -> tuple[type[Primitive], ...]:
        """The asked ones, from simple to costly."""
        shape = self.shape or get_args(PrimitiveName)
        asked = (shape,) if isinstance(shape, str) else shape
        return tuple(kind for kind in KINDS if kind.__name__.lower() in asked)

    def _several(
        self, reference: Reference
    ) -> tuple[list[tuple[Primitive, Pose]], tuple[Finding, ...]]:
        most = max(PARTS, self.max_hulls)
        cut = self.vhacd_or_hull(reference, self.vhacd, most, 64)
        parts = grown_to([piece.surface() for piece in cut.pieces], reference.samples, 0.0)
        family = {len(points): points for points in merge_steps(parts)}
        best, best_score = fit_parts(reference, [reference.hull], self._kinds)
        for count in range(2, min(self.max_hulls, max(family)) + 1):
            hulls = [convex_hull(points) for points in family[count]]
            fits, score = fit_parts(reference, hulls, self._kinds)
            if score < best_score - WORTH * (count - len(best)):
                best, best_score = fits, score
        return best, cut.findings
