"""The fewest convex pieces that meet the tolerances, tried from cheap to dear.

    convex already, or one hull is good enough -> one hull
    cuts by planes (`mesh/cut`), a fraction of a second -> some hulls
    many pieces, or just not good enough, and a clean manifold -> CoACD, which finds creases
    still just not good enough -> V-HACD, which follows thin shells

A decomposition runs once, finer than wanted; its parts are merged pair by pair, which is a family
of results from many pieces to one. The smallest member that meets the tolerances is taken. That
is one run where a search over piece counts would make six, and at equal counts the merged parts
follow real links more closely than V-HACD's own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field

from assetbuild.collision import (
    Fitted,
    LibraryMethod,
    MaxHulls,
    MaxPolygons,
    MaxVertices,
)
from assetbuild.findings import Finding
from assetbuild.mesh.cover import Quality, Reference, rough
from assetbuild.mesh.cut import cut_parts, tips
from assetbuild.mesh.decomposition import (
    CoAcdOptions,
    Patience,
    VHacdOptions,
    coacd_parts,
    vhacd_parts,
)
from assetbuild.mesh.fit import box_axes
from assetbuild.mesh.merge import grown_to, hulls_of, merge_steps
from assetbuild.mesh.native import NativeError
from assetbuild.mesh.rays import widest_hole
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import TriangleMesh, signed_volume, solid_moments
from assetbuild.mesh.verdict import blocked_by
from assetbuild.robot.pose import Array

CONVEX = 0.98
"""Volume / volume of the hull: above it a mesh needs no decomposition."""
CUTS = 2
"""Parts that cuts make for each of `max_hulls`."""
FEW = 8
"""Pieces with which cuts are content; where they need more, CoACD may need half as many."""
FAR = 0.25
"""Badness of cuts above which a dense mesh without a hole goes to no library: V-HACD met what cuts
had missed by 0.09, but of 14 links of the G1 none that they had missed by more, in three times the
CPU time of all."""
CLEAN_FACES = 2_000
"""Faces of a solid; with so few, no library takes more than a few seconds."""
TILTED = 0.9
"""Smallest box / box along x, y and z of a mesh that is also cut across the axes of the former. A
pipe tilted by 3 degrees has 0.83."""
FINE = 64
"""Parts of V-HACD's decomposition, or twice `max_hulls`."""
COACD_FACES = 12_000
"""Above it CoACD's check for self-intersection takes up to 20 s, and its search minutes."""
THIN = 0.5
"""Volume / volume of the hull: below it walls are thin, and CoACD needs more pieces than `auto`
may take: of eight such clean links one ended within COACD_LOOKS."""
COACD_LOOKS = 100
"""Most work of CoACD, see `Patience`: about 10 CPU s. Of 18 clean links 8 need no more, and most of
them half of V-HACD's pieces or fewer; 9 of the other 10 had not ended after 16 CPU s."""
CORNERS = 6_000
"""About so many vertices of a mesh, at most, pull V-HACD's parts back onto its surface."""
TIGHT = 0.02
"""CoACD's threshold / diagonal where the tolerance is wider."""
SCALED = 1e-3
"""A capped piece is scaled when it lost more than this of its size."""
SURELY = 0.1
"""A candidate that is worse by this much badness is out, whatever the sampling error."""
UNSURE = 0.3
"""A candidate that looks this bad by few samples, see `ENOUGH_INSIDE`, may still meet all
tolerances by all of them."""
BLOCKED = 10.0
"""Badness of a piece in a place to be kept open: worse than any tolerance missed by 1000 %."""


PRESETS: Mapping[str, Mapping[str, float]] = {
    # What a foot or a shin needs to know of the rest of the robot: few pieces, no gross error.
    "locomotion": {
        "max_outside": 0.02,
        "max_missing": 0.05,
        "max_overcover": 0.6,
        "max_hulls": 8,
        "max_vertices": 64,
    },
    "manipulation": {
        "max_outside": 0.005,
        "max_missing": 0.02,
        "max_overcover": 0.2,
        "max_hulls": 32,
        "max_vertices": 64,
    },
}
"""Tolerances of `auto` in SI; a rule's own keys win."""


@dataclass(frozen=True)
class _Candidate:
    """pieces, and how far they miss the tolerances: 0 = met, 1 = one of them by 100 %."""

    pieces: tuple[ConvexPiece, ...]
    quality: Quality
    badness: float
    how: str


@dataclass(frozen=True)
class _View:
    """A mesh turned so that the columns of axes (3, 3) lie along x, y and z: how it is cut."""

    reference: Reference
    axes: Array

    def back(self, parts: Sequence[TriangleMesh]) -> list[TriangleMesh]:
        """Parts of the turned mesh in the mesh's frame."""
        return [part.mapped(self.axes) for part in parts]


class Auto(LibraryMethod):
    """The fewest pieces of each source shape that meet the tolerances, else the best there are."""

    usual_s = 2.5

    max_hulls: MaxHulls = 32
    max_vertices: MaxVertices = 64
    max_polygons: MaxPolygons = 64
    vhacd: VHacdOptions = Field(VHacdOptions(), description="parameters of V-HACD")
    coacd: CoAcdOptions | None = Field(
        None, description="parameters of CoACD; without it the threshold follows `max_outside`"
    )

    @classmethod
    def preset(cls, name: str) -> Mapping[str, float]:
        """See `PRESETS`."""
        return PRESETS[name]

    def fit(self, reference: Reference) -> Fitted:
        """The ladder; a library that fails is a finding, and the next rung is taken."""
        one = self._one_hull(reference)
        if one.badness == 0.0 or (reference.convexity > CONVEX and one.badness < BLOCKED):
            how = "convex: one hull" if one.badness else "one hull is enough"
            return Fitted(one.pieces, (), how, one.quality)
        cuts, view = self._cut(reference)
        best = min(one, cuts or one, key=_rank)
        by_few = best.badness == 0.0 and len(best.pieces) <= FEW
        dear = cuts is not None and FAR < best.badness < BLOCKED and not self._may_help(reference)
        findings: list[Finding] = []
        rungs = (("CoACD", self._by_coacd, "vhacd"), ("V-HACD", self._by_vhacd, "hull"))
        for library, rung, instead in () if by_few or dear else rungs:
            try:
                best = min(best, rung(reference, view) or best, key=_rank)
            except NativeError as failure:
                if failure.cause != "stopped":
                    findings.append(self.fell(library, failure, instead))
            if best.badness == 0.0:
                break
        return Fitted(best.pieces, tuple(findings), best.how, best.quality)

    def _may_help(self, reference: Reference) -> bool:
        """Whether a library may meet what cuts miss by far: it keeps a hole that they close, and a
        clean mesh of few faces costs it seconds."""
        if reference.exact is not None and len(reference.mesh.faces) <= CLEAN_FACES:
            return True
        return widest_hole(reference.mesh) > np.pi * (self.max_outside or 0.0) ** 2

    def _one_hull(self, reference: Reference) -> _Candidate:
        """Capped, with its volume given back or not: a hull that covers too much needs it not."""
        bare = super().within_caps(reference.hull)
        restored = self._judged(reference, [_restored(bare, reference.hull)], "hull")
        if restored.badness == 0.0 or restored.pieces[0] is bare:
            return restored
        return min(restored, self._judged(reference, [bare], "hull", restored.badness), key=_rank)

    def _cut(self, reference: Reference) -> tuple[_Candidate | None, _View]:
        """The better of the cuts across x, y and z and, in a tilted mesh, of those across its own
        axes; and the view that libraries, whose cuts go across x, y and z too, take of the mesh."""
        drawn = _View(reference, np.eye(3))
        cuts = self._by_cuts(reference, drawn)
        if cuts is not None and _fewest(cuts) <= (0.0, 2):  # fewer would be one hull, which failed
            return cuts, drawn
        axes, share = box_axes(reference)
        if share > TILTED:
            return cuts, drawn
        straight = _View(Reference(reference.mesh.mapped(axes.T)), axes)
        tilted_cuts = self._by_cuts(reference, straight)
        better = tilted_cuts is not None and (cuts is None or _fewest(tilted_cuts) < _fewest(cuts))
        return (tilted_cuts, straight) if better else (cuts, drawn)

    def _by_cuts(self, reference: Reference, view: _View) -> _Candidate | None:
        count = min(CUTS * self.max_hulls, 1024)
        parts = hulls_of(cut_parts(view.reference.mesh, *view.reference.filling, count))
        tipped = hulls_of([tips(part.vertices) for part in view.back(parts)])
        return self._smallest(reference, tipped, "cuts")

    def _by_coacd(self, reference: Reference, view: _View) -> _Candidate | None:
        """Try CoACD on meshes that it need not remesh, which inflates them and takes minutes."""
        too_large = len(reference.mesh.faces) > COACD_FACES
        if reference.exact is None or too_large or reference.convexity < THIN:
            return None
        wanted = min(self.max_outside or np.inf, TIGHT * reference.diagonal)
        # Neither joined nor thinned out by CoACD: that takes as long again, and is done below.
        options = self.coacd or CoAcdOptions.model_validate(
            {"threshold_m": wanted, "merge": False, "decimate": False}
        )
        parts = coacd_parts(
            view.reference.mesh,
            options,
            max_hulls=None,
            max_vertices=256,
            limits=self.native_limits,
            patience=Patience(COACD_LOOKS),
        )
        hulls = hulls_of([part.vertices for part in view.back(parts)])
        return self._smallest(reference, hulls, "CoACD")

    def _by_vhacd(self, reference: Reference, view: _View) -> _Candidate | None:
        most = max(FINE, min(2 * self.max_hulls, 1024))
        mesh = view.reference.mesh
        parts = vhacd_parts(mesh, self.vhacd, most, self.max_vertices, self.native_limits)
        lower, upper = mesh.bounds
        voxel = float(np.prod(upper - lower) / self.vhacd.resolution) ** (1.0 / 3.0)
        some = reference.mesh.vertices[:: len(reference.mesh.vertices) // CORNERS + 1]
        surface = np.concatenate([some, reference.samples])
        return self._smallest(reference, grown_to(view.back(parts), surface, voxel), "V-HACD")

    def _smallest(
        self, reference: Reference, parts: Sequence[TriangleMesh], how: str
    ) -> _Candidate | None:
        """The member of the merged family with the fewest pieces that meets the tolerances.

        Found by bisection from two on, since fewer pieces fit worse and one hull has failed: with
        few samples, then from there up with all. When none meets them, the one that misses least
        of the halves of `max_hulls`.
        """
        if not parts:
            return None
        family = {len(points): points for points in merge_steps(parts)}
        most = min(self.max_hulls, max(family))

        known: dict[int, list[ConvexPiece]] = {}  # members share most of their parts

        def member(count: int, worst: float = np.inf, *, coarse: bool = False) -> _Candidate:
            for points in family[count]:
                if id(points) not in known:
                    bare = TriangleMesh(points, np.zeros((0, 3), dtype=np.int64))
                    known[id(points)] = self.verified([ConvexPiece(bare)])
            pieces = [piece for points in family[count] for piece in known[id(points)]]
            return self._judged(reference, pieces, how, worst, coarse=coarse)

        best = member(most)
        if best.badness > 0.0:
            smaller = [member(count, best.badness) for count in (most // 2, most // 4) if count]
            return min([best, *smaller], key=_rank)
        low, high = min(2, most), most
        while low < high:
            middle = (low + high) // 2
            if member(middle, coarse=True).badness <= UNSURE:
                high = middle
            else:
                low = middle + 1
        for count in range(low, most):
            if (candidate := member(count)).badness == 0.0:
                return candidate
        return best

    def within_caps(self, hull: TriangleMesh) -> ConvexPiece:
        """Cap it as everywhere; a piece that the caps made smaller gets its volume back."""
        return _restored(super().within_caps(hull), hull)

    def _judged(
        self,
        reference: Reference,
        pieces: Sequence[ConvexPiece],
        how: str,
        worst: float = np.inf,
        *,
        coarse: bool = False,
    ) -> _Candidate:
        """How well pieces meet the tolerances. Of those worse than `worst`, the badness may be
        too low: they are not measured further."""
        if not pieces:
            return _Candidate((), _NOTHING, np.inf, how)
        most_over = (1.0 + SURELY + worst) * (self.max_overcover or np.inf)
        quality = rough(reference, pieces, coarse=coarse, most_over=most_over)
        badness = sum(
            max(0.0, value / most - 1.0) if most else float(value > 0.0)
            for value, most in self.excesses(quality).values()
        )
        badness += BLOCKED * sum(blocked_by(p, c) for c in self.closed_places for p in pieces)
        return _Candidate(tuple(pieces), quality, badness, how)


def _restored(capped: ConvexPiece, whole: TriangleMesh) -> ConvexPiece:
    """The capped piece scaled about its centre to the volume of the whole hull.

    A capped hull lies inside the full one and would miss 4 to 6 % of a round link; scaled, it
    misses and covers too much by about 2 % each.
    """
    hull = capped.solid
    if hull is whole or not isinstance(hull, TriangleMesh):
        return capped
    factor = (signed_volume(whole) / signed_volume(hull)) ** (1.0 / 3.0)
    if factor < 1.0 + SCALED:
        return capped
    _, middle, _ = solid_moments(hull)
    return ConvexPiece(replace(hull, vertices=middle + factor * (hull.vertices - middle)))


def _rank(candidate: _Candidate) -> tuple[float, float, int]:
    """Least badness first (to a hundredth), then the best cover, then the fewest pieces."""
    return (
        round(candidate.badness, 2),
        -round(candidate.quality.iou, 2),
        len(candidate.pieces),
    )


def _fewest(candidate: _Candidate) -> tuple[float, int]:
    """Least badness first (to a hundredth), then the fewest pieces."""
    return round(candidate.badness, 2), len(candidate.pieces)


_NOTHING = Quality(False, False, 0.0, 0.0, 1.0, 0.0, 0)
