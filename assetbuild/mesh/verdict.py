"""What is said about collision geometry: its figures, missed tolerances, places it closes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass

import numpy as np

from assetbuild.findings import Finding, Rule
from assetbuild.mesh.cover import SAMPLES, Quality, Reference, outside, union_of
from assetbuild.mesh.quality import NearestSurface, surface_samples
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.robot.pose import Array, Vec3

MISSING = 0.5
"""Share of the volume without collision that no tolerance explains: a method went wrong."""


GROSS: Mapping[str, float] = {"max_missing": 2.0, "max_outside": 4.0}
"""Factor by which a preset's tolerance may be missed before it is a warning."""
Tolerances = Mapping[str, tuple[float, float]]
"""Key of each stated tolerance -> (found, allowed), both in its unit."""

GAP = Rule(
    "collision.gap",
    "info",
    "how collision fits the mesh: how far it sticks out, which share is missing or too much, "
    "distances, number of pieces",
    "another method or tolerance",
)
TOLERANCE = Rule(
    "collision.tolerance",
    ("warning", "info"),
    "a tolerance that the recipe states is not met, or one of its preset by far (twice the missing "
    "volume, four times the distance outside); what misses a preset by less is information",
    "more `max_hulls`, or a wider tolerance",
)
CLOSED = Rule(
    "collision.closed",
    "error",
    "a piece intrudes into a place that `keep_open` names",
    "more `max_hulls`, or a smaller probe",
)
REGION = Rule(
    "collision.region",
    "warning",
    "collision sticks out more than a region allows",
    "more `max_hulls`, or a wider `max_outside` there",
)
MOSTLY_MISSING = Rule(
    "collision.missing", "warning", "most of the mesh has no collision", "another method"
)
FLAT_PIECE = Rule(
    "collision.flat_piece", "warning", "pieces without volume were left out", "another method"
)


SEGMENT = 25
"""Points along the axis of a probe."""


@dataclass(frozen=True)
class Probe:
    """A capsule, or a ball when both ends are one, in the frame of the mesh: a place. m.

    max_outside: how far pieces may stick out of the mesh there; None: none may enter.
    """

    start: Vec3
    end: Vec3
    radius: float = 0.0
    max_outside: float | None = None

    def distance(self, points: Array) -> Array:
        """(n,) signed distances of points (n, 3) to the probe, m."""
        start, along = np.asarray(self.start), np.subtract(self.end, self.start)
        length = float(along @ along)
        share = np.clip((points - start) @ along / length, 0.0, 1.0) if length else np.zeros(1)
        nearest = start + np.multiply.outer(share, along)
        return np.asarray(np.linalg.norm(points - nearest, axis=1) - self.radius)

    def axis(self) -> Array:
        """(SEGMENT, 3) points from end to end."""
        return np.linspace(self.start, self.end, SEGMENT)


def verdict(
    subject: str,
    reference: Reference,
    pieces: Sequence[ConvexPiece],
    quality: Quality,
    *,
    how: str,
    tolerances: Tolerances,
    places: Sequence[Probe],
    max_hulls: int | None,
    usual: Set[str],
) -> Iterator[Finding]:
    """All findings about the pieces of one mesh.

    how: the method in words; usual: those of the tolerances that a preset states, not the recipe.
    """
    if flat := quality.flat:
        made = flat + quality.pieces
        message = f"{flat} of {made} pieces are flat and left out"
        yield FLAT_PIECE(subject, message, data={"flat": flat, "pieces": made})
    yield _gap(subject, reference, quality, how)
    if quality.missing > MISSING:
        message = f"{100 * quality.missing:.0f} % of the volume has no collision"
        hint = "the result may be hollow: use `hull`, or more pieces"
        missing = round(quality.missing, 4)
        yield MOSTLY_MISSING(subject, message, hint, data={"max_missing": missing})
    yield from _missed(subject, quality, tolerances, max_hulls, usual)
    yield from _places(subject, reference, pieces, places)


def _gap(subject: str, reference: Reference, quality: Quality, how: str) -> Finding:
    outside = 1e3 * quality.max_outside_m
    open_note = " (not watertight; the inside is estimated by ray casting)"
    if reference.hollow:
        open_note = " (the mesh encloses no volume; it is compared with its convex hull)"
    return GAP(
        subject,
        f"{how} (pieces: {quality.pieces}): up to {outside:.2g} mm outside, "
        f"{100 * quality.missing:.1f} % of the volume missing, {100 * quality.over:.1f} % too "
        f"much" + ("" if quality.closed else open_note),
        data={
            "method": how,
            "pieces": quality.pieces,
            "max_outside_mm": round(outside, 3),
            "max_missing": round(quality.missing, 4),
            "over": round(quality.over, 4),
            "iou": round(quality.iou, 4),
            "volumes_exact": quality.exact,
            "closed": quality.closed,
            "mean_mm": round(1e3 * quality.mean_m, 3),
            "p99_mm": round(1e3 * quality.p99_m, 3),
            "max_mm": round(1e3 * quality.max_m, 3),
            "max_vertices": quality.vertices,
            "max_polygons": quality.polygons,
        },
    )


def _missed(
    subject: str,
    quality: Quality,
    tolerances: Tolerances,
    max_hulls: int | None,
    usual: Set[str],
) -> Iterator[Finding]:
    """One finding for all tolerances that are not met: by how much, and what to change.

    A preset is a wish that not every mesh can meet: missing it is information, up to a factor.
    """
    over = {k: v for k, v in tolerances.items() if v[0] > v[1]}
    if not over:
        return
    units = {"max_outside": (1e3, " mm")}
    messages = []
    for key, (reached, most) in over.items():
        factor, unit = units.get(key, (100.0, " %"))
        messages.append(
            f"`{key}` is {factor * reached:.3g}{unit}, above the limit of {factor * most:.3g}{unit}"
        )
    mild = all(
        key in usual and reached <= GROSS.get(key, math.inf) * most
        for key, (reached, most) in over.items()
    )
    yield TOLERANCE(
        subject,
        "; ".join(messages),
        severity="info" if mild else "warning",
        hint=_advice(set(over), quality, max_hulls),
        data={
            f"{key}_{side}": round(value, 6)
            for key, pair in over.items()
            for side, value in zip(("found", "allowed"), pair, strict=True)
        },
    )


def _advice(over: set[str], quality: Quality, most: int | None) -> str:
    if most is not None and quality.pieces >= most:
        return f"raise `max_hulls` (now {most}), or the tolerance"
    if not quality.closed:
        return "the mesh is open: close it, raise the tolerance, or use `primitive`"
    if over == {"max_missing"}:
        return "raise `max_missing`, or use `hull`, which covers everything"
    return "raise the tolerance, or give the link another method"


def _places(
    subject: str,
    reference: Reference,
    pieces: Sequence[ConvexPiece],
    places: Sequence[Probe],
) -> Iterator[Finding]:
    for number, place in enumerate(places):
        if place.max_outside is None:
            count = sum(blocked_by(piece, place) for piece in pieces)
            if count:
                yield CLOSED(
                    subject,
                    f"`keep_open` {number + 1} is closed by {count} pieces",
                    hint="raise `max_hulls`, lower `max_outside`, or make the probe smaller",
                    data={"probe": number + 1, "pieces": count},
                )
            continue
        distance = outside_in(reference, pieces, place)
        if distance > place.max_outside:
            yield REGION(
                subject,
                f"collision sticks out by {1e3 * distance:.3g} mm in a region, above the limit of "
                f"{1e3 * place.max_outside:.3g} mm",
                hint="raise `max_hulls`, or the region's `max_outside`",
                data={"found_m": round(distance, 6), "allowed_m": place.max_outside},
            )


def outside_in(reference: Reference, pieces: Sequence[ConvexPiece], probe: Probe) -> float:
    """How far pieces stick out of the mesh within a region, m."""
    _, skin = union_of(pieces)
    points = np.concatenate([surface_samples(skin, 4 * SAMPLES, 2)[0], skin.vertices])
    return outside(reference, points[probe.distance(points) <= 0.0])


def blocked_by(piece: ConvexPiece, probe: Probe) -> bool:
    """Whether a piece enters the probe.

    The distance between the axis and the piece is bounded from both sides by points on either;
    what touches within a hundredth of the radius counts as free.
    """
    radius = probe.radius * 0.99
    least = float(piece.distance(probe.axis()).min())  # outside of a hull a lower bound
    if least <= 0.0 or least >= radius:
        return least <= 0.0
    return bool((NearestSurface(piece.surface()).distance(probe.axis()) < radius).any())
