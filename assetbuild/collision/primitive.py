"""One box, sphere, capsule or cylinder per link: fastest to simulate, exact to differentiate."""

from __future__ import annotations

from typing import Literal

from assetbuild.collision import CollisionMethod, Fitted
from assetbuild.mesh.cover import Reference
from assetbuild.mesh.fit import KINDS, best_primitive
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.robot.model import Box, Capsule, Cylinder, Sphere

SHAPES = {"box": Box, "sphere": Sphere, "capsule": Capsule, "cylinder": Cylinder}


class FitPrimitive(CollisionMethod):
    """One primitive for all shapes of a link, by a two-sided score: over + 2 missing volume."""

    scope = "link"
    tools = CollisionMethod.hull_tools

    shape: Literal["box", "sphere", "capsule", "cylinder"] | None = None
    """Which; None = the one with the best score, the simpler one when two are as good."""

    def exact(self) -> tuple[ConvexPiece, ...] | None:
        """A source that is a single primitive of the asked shape stays exactly as it is."""
        known = super().exact()
        if known is None or self.shape is None:
            return known
        return known if isinstance(known[0].primitive, SHAPES[self.shape]) else None

    def fit(self, reference: Reference) -> Fitted:
        """Enclosing and least-squares fits of each candidate kind; the best of all."""
        kinds = KINDS if self.shape is None else (SHAPES[self.shape],)
        primitive, pose = best_primitive(reference.mesh, kinds)
        return Fitted((ConvexPiece(None, primitive, pose),), how="primitive")
