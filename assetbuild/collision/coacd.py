"""Convex decomposition by CoACD: tight on clean manifold meshes, slow on all others."""

from __future__ import annotations

from dataclasses import replace

from pydantic import Field

from assetbuild.collision import (
    Fitted,
    LibraryMethod,
    MaxPolygons,
    MaxVertices,
)
from assetbuild.findings import Finding, Rule
from assetbuild.mesh.cover import Reference
from assetbuild.mesh.decomposition import CoAcdOptions, VHacdOptions, coacd_parts
from assetbuild.mesh.native import NativeError
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.recipe_types import Positive

MORE_HULLS = Rule(
    "collision.more_hulls",
    "warning",
    "the library made more pieces than it was asked for",
    "another method, or more `max_hulls`",
)


class CoAcd(LibraryMethod):
    """Pieces of each source shape. It covers too much rather than too little."""

    usual_s = 8.0

    max_hulls: int | None = Field(
        None,
        ge=1,
        le=1024,
        description="most pieces; parts that do not touch each other can exceed it",
    )
    max_vertices: MaxVertices = 64
    max_polygons: MaxPolygons = None
    coacd: CoAcdOptions = Field(CoAcdOptions(), description="parameters of CoACD")
    cpu_limit: Positive = Field(
        120.0, le=1800, description="CPU seconds of one run of a native library"
    )

    def fit(self, reference: Reference) -> Fitted:
        """CoACD's parts; V-HACD's when it fails, and then one hull."""
        try:
            parts = coacd_parts(
                reference.mesh,
                self.coacd,
                max_hulls=self.max_hulls,
                max_vertices=self.max_vertices,
                limits=self.native_limits,
            )
        except NativeError as failure:
            most = self.max_hulls or 32
            next_best = self.vhacd_or_hull(reference, VHacdOptions(), most, self.max_vertices)
            failed = self.fell("CoACD", failure, "vhacd")
            return replace(next_best, findings=(failed, *next_best.findings))
        findings: list[Finding] = []
        if self.max_hulls is not None and len(parts) > self.max_hulls:
            message = f"{len(parts)} pieces, {self.max_hulls} were asked for: parts that do not "
            message += "touch are not joined"
            hint = "raise `max_hulls`, or use `vhacd`, which keeps to it"
            data = {"pieces": len(parts), "max_hulls": self.max_hulls}
            findings = [MORE_HULLS(self.subject, message, hint, data=data)]
        return Fitted(tuple(map(ConvexPiece, parts)), tuple(findings), "CoACD")
