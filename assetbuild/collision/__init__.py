"""Collision methods, one plug-in a file: source shapes in, convex pieces out.

A method is a step: fields are its parameters, `fit` is its work, the rest is here: reading and
checking the sources, reuse of equal shapes, measuring, and what is said about tolerances.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import StepError
from assetbuild.findings import Finding
from assetbuild.kinds import ConvertedMesh, Piece, Pieces
from assetbuild.mesh.cover import Probe, Quality, Reference, blocked_by, measure, outside_in
from assetbuild.mesh.hull import convex_hull, refuse_flat
from assetbuild.mesh.native import NativeError, NativeLimits
from assetbuild.mesh.obj import obj_bytes, read_triangles
from assetbuild.mesh.primitives import Primitive, tessellate
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import TriangleMesh, merged
from assetbuild.mesh.weld import cleaned
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.model import Box, Capsule, Cylinder, Mesh, Sphere
from assetbuild.robot.pose import IDENTITY, Pose, Quat, Vec3, quat_of, vec3

PRELOAD = (
    "numpy",
    "scipy.spatial",
    "scipy.stats",
    "scipy.optimize",
    "scipy.sparse.csgraph",
    "embreex.rtcore_scene",
    "manifold3d",
    "vhacdx",
    "coacd",
)
"""The same for all methods: they share one process that has paid for these imports."""
MISSING = 0.5
"""Share of the volume without collision that no tolerance explains: a method went wrong."""
AS_GOOD_IOU = 0.01
"""A reused result may be worse by this much, the error of sampled volumes."""
AS_GOOD = 0.01
"""Of the diagonal: the same for distances."""


class PrimitiveSource(BaseModel):
    """A primitive as plain data, tagged so that equal numbers of another kind differ."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    type: Literal["Box", "Sphere", "Cylinder", "Capsule"]
    size: Vec3 | None = None
    radius: float | None = Field(None, gt=0)
    length: float | None = Field(None, ge=0)

    @model_validator(mode="after")
    def _complete(self) -> PrimitiveSource:
        needed = {"Box": {"size"}, "Sphere": {"radius"}}.get(self.type, {"radius", "length"})
        given = {name for name in ("size", "radius", "length") if getattr(self, name) is not None}
        if given != needed:
            raise ValueError(f"a {self.type} has {sorted(needed)}, not {sorted(given)}")
        return self

    @property
    def geometry(self) -> Primitive:
        """The primitive of the robot model."""
        if self.size is not None:
            return Box(self.size)
        radius, length = self.radius or 0.0, self.length or 0.0
        if self.type == "Sphere":
            return Sphere(radius)
        return Cylinder(radius, length) if self.type == "Cylinder" else Capsule(radius, length)


class PlacedSource(BaseModel):
    """One source shape: a mesh (its input folder) or a primitive, with its pose.

    xyz, quat: of the shape in the output frame, m and wxyz.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    folder: str | None = None
    primitive: PrimitiveSource | None = None
    xyz: Vec3 = (0.0, 0.0, 0.0)
    quat: Quat = (1.0, 0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _one(self) -> PlacedSource:
        if (self.folder is None) == (self.primitive is None):
            raise ValueError("a source is either a mesh folder or a primitive")
        return self

    @classmethod
    def of_mesh(cls, folder: str, pose: Pose | None = None) -> PlacedSource:
        """The converted mesh in the input folder `folder`; no pose = the output frame."""
        at = pose or IDENTITY
        return cls(folder=folder, xyz=at.xyz, quat=at.quat)

    @classmethod
    def of_primitive(cls, geometry: Primitive, pose: Pose | None = None) -> PlacedSource:
        """A primitive of the source; no pose = the output frame."""
        at = pose or IDENTITY
        values = {name: getattr(geometry, name) for name in geometry.__dataclass_fields__}
        plain = PrimitiveSource.model_validate({"type": type(geometry).__name__, **values})
        return cls(primitive=plain, xyz=at.xyz, quat=at.quat)

    @property
    def pose(self) -> Pose:
        """X_frame_shape."""
        return Pose(self.xyz, self.quat)


class ProbeSource(BaseModel):
    """A place that pieces must leave open, or follow closely. start, end: output frame, m."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    start: Vec3
    end: Vec3
    radius: float = Field(0.0, ge=0)
    max_outside: float | None = Field(None, ge=0)
    """m; None: nothing may enter."""

    @property
    def probe(self) -> Probe:
        """As the metrics take it."""
        return Probe(self.start, self.end, self.radius)


class Likeness(BaseModel):
    """Another mesh has the same shape: p = signs * p_other + shift, per axis."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    signs: Vec3
    shift: Vec3


class CollisionMethod(Step):
    """Base of all methods: reads and checks the sources, verifies, measures, writes the pieces.

    With `like`, the pieces of an equal shape (`like/pieces.json`, `like/pieces/`) are tried
    first, and taken when they fit this mesh as well as they fit theirs.
    """

    version = "2"
    outputs = ("pieces/", "pieces.json", "quality.json")
    isolated = True
    preload = PRELOAD
    limits: ClassVar[Limits] = Limits(wall_s=7200.0, memory_mb=4096)
    scope: ClassVar[Literal["shape", "link"]] = "shape"
    """Once per source shape, shared by all links that use it; or once per link."""
    hull_tools: ClassVar[tuple[str, ...]] = ("numpy", "scipy", "manifold3d", "embreex")
    """What the reading, hulls and measures here depend on; subclasses add their library."""

    sources: tuple[PlacedSource, ...] = Field(min_length=1)
    subject: str = "collision"
    """What findings and errors call it. Part of the key: name no link to share the result."""
    max_outside: float | None = Field(None, ge=0)
    """m; how far pieces may stick out of the mesh. None = any."""
    max_missing: float | None = Field(None, ge=0, le=1)
    """Share of the mesh's volume that may have no collision. None = any."""
    max_overcover: float | None = Field(None, ge=0)
    """Collision outside the mesh / the mesh's volume. None = any."""
    probes: tuple[ProbeSource, ...] = ()
    """Places to keep open, and places with a `max_outside` of their own."""
    like: Likeness | None = None

    def fit(self, reference: Reference) -> Fitted:
        """Convex pieces for the mesh, in the output frame, and what there is to say.

        Hulls may come as any points with faces: they are hulled again, outward, and capped.
        """
        raise NotImplementedError

    def exact(self) -> tuple[ConvexPiece, ...] | None:
        """The answer when none needs to be searched: a single primitive is convex as it is."""
        source = self.sources[0]
        if len(self.sources) > 1 or source.primitive is None:
            return None
        return (ConvexPiece(None, source.primitive.geometry, source.pose),)

    @property
    def vertex_cap(self) -> int | None:
        """Most vertices of one hull; None = as many as there are."""
        return getattr(self, "max_vertices", None)

    @property
    def polygon_cap(self) -> int | None:
        """Most polygons of one hull; None = as many as there are."""
        return getattr(self, "max_polygons", None)

    @property
    def native_limits(self) -> NativeLimits:
        """Of one run of a native library: the fields `cpu_limit` and `memory_limit_mb`."""
        default = NativeLimits()
        return NativeLimits(
            getattr(self, "cpu_limit", None) or default.cpu_s,
            getattr(self, "memory_limit_mb", None) or default.memory_mb,
        )

    def run(self, files: Files) -> Iterable[Finding]:
        """Fit; raises StepError for sources that no method can work with."""
        known = self.exact()
        if known is not None:
            write_pieces(files.outputs, known, None)
            return
        reference = Reference(self._mesh(files))
        made = self._reused(reference, files.inputs / "like")
        if made is None:
            fitted = self.fit(reference)
            pieces = [piece for piece in map(self.verified, fitted.pieces) if piece is not None]
            flat = len(fitted.pieces) - len(pieces)
            yield from fitted.findings
            if not pieces:
                raise StepError(
                    f"{self.subject}: {self.step_name()} found no piece with a volume",
                    hint="use another method, `hull` for example",
                )
            made = pieces, measure(reference, pieces, flat=flat), fitted.how
        pieces, quality, how = made
        write_pieces(files.outputs, pieces, quality)
        yield from self._findings(reference, pieces, quality, how)

    def _mesh(self, files: Files) -> TriangleMesh:
        """All sources welded into one mesh in the output frame, checked."""
        placed = [self._source_mesh(source, files.inputs) for source in self.sources]
        mesh = cleaned(merged(placed))
        if len(mesh.faces) < 4:
            raise StepError(f"{self.subject}: {len(mesh.faces)} triangles enclose no volume")
        refuse_flat(mesh.vertices, self.subject)
        return mesh

    def _source_mesh(self, source: PlacedSource, inputs: Path) -> TriangleMesh:
        if source.primitive is not None:
            return tessellate(source.primitive.geometry).placed(source.pose)
        folder = inputs / (source.folder or "")
        record = decode(ConvertedMesh, (folder / "mesh.json").read_bytes())
        files = [folder / "parts" / part.file for part in record.parts]
        mesh = merged([read_triangles(file.read_bytes(), self.subject) for file in files])
        if not np.isfinite(mesh.vertices).all():
            raise StepError(f"{self.subject}: not all vertices are finite numbers")
        return mesh.placed(source.pose)

    def verified(self, piece: ConvexPiece) -> ConvexPiece | None:
        """A hull piece hulled again by qhull and capped; None when it is flat."""
        if piece.hull is None:
            return piece
        try:
            points = piece.hull.vertices
            return ConvexPiece(
                convex_hull(points, max_vertices=self.vertex_cap, max_polygons=self.polygon_cap)
            )
        except StepError:
            return None

    def hull_after(self, reference: Reference, library: str, failure: NativeError) -> Fitted:
        """The last rung: one hull, and a finding with the cause."""
        return Fitted(
            (ConvexPiece(reference.hull),), (self.fell(library, failure, "hull"),), "hull"
        )

    def fell(self, library: str, failure: NativeError, instead: str) -> Finding:
        """What is said when a library gave no result."""
        hints = {
            "time": "raise `cpu_limit`, or give the link another method",
            "memory": "raise `memory_limit_mb`, or give the link another method",
        }
        return Finding(
            rule="collision.library_failed",
            severity="warning",
            subject=self.subject,
            message=f"{library}: {failure}; `{instead}` was used instead",
            hint=hints.get(failure.cause, "give the link another method, or repair its mesh"),
            data={"library": library, "cause": failure.cause, "instead": instead},
        )

    # --- reuse --------------------------------------------------------------------------------

    def _reused(
        self, reference: Reference, folder: Path
    ) -> tuple[list[ConvexPiece], Quality, str] | None:
        """The other mesh's pieces where they fit as well here, else None."""
        if self.like is None:
            return None
        before = json.loads((folder / "quality.json").read_bytes())
        pieces = [
            carried(piece, folder / "pieces", self.like)
            for piece in decode(Pieces, (folder / "pieces.json").read_bytes()).pieces
        ]
        if before is None or any(blocked_by(p, s.probe) for s in self._closed for p in pieces):
            return None
        quality = measure(reference, pieces, flat=before["flat"])
        as_good = (
            quality.iou >= before["iou"] - AS_GOOD_IOU
            and quality.missing <= before["missing"] + AS_GOOD_IOU
            and quality.max_outside_m <= before["max_outside_m"] + AS_GOOD * reference.diagonal
            and quality.p99_m <= before["p99_m"] + AS_GOOD * reference.diagonal
        )
        return (pieces, quality, "reused from an equal shape") if as_good else None

    # --- findings -----------------------------------------------------------------------------

    @property
    def _closed(self) -> tuple[ProbeSource, ...]:
        return tuple(probe for probe in self.probes if probe.max_outside is None)

    def _findings(
        self, reference: Reference, pieces: Sequence[ConvexPiece], quality: Quality, how: str
    ) -> Iterator[Finding]:
        if quality.flat:
            yield self._flat_pieces(quality)
        yield self._gap(reference, quality, how)
        if quality.missing > MISSING:
            yield self._mostly_missing(quality)
        yield from self._missed(quality)
        yield from self._places(reference, pieces)

    def _flat_pieces(self, quality: Quality) -> Finding:
        made = quality.flat + quality.pieces
        return Finding(
            rule="collision.flat_piece",
            severity="warning",
            subject=self.subject,
            message=f"{quality.flat} of {made} pieces are flat and left out",
            data={"flat": quality.flat, "pieces": made},
        )

    def _gap(self, reference: Reference, quality: Quality, how: str) -> Finding:
        outside = 1e3 * quality.max_outside_m
        open_note = " (the mesh is open: its inside is a majority of three rays)"
        if reference.hollow:
            open_note = " (the mesh has no inside: compared with its convex hull)"
        return Finding(
            rule="collision.gap",
            severity="info",
            subject=self.subject,
            message=f"{how}: {quality.pieces} pieces, up to {outside:.2g} mm outside, "
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
                "see_through": round(quality.see_through, 3),
                "max_vertices": quality.vertices,
                "max_polygons": quality.polygons,
            },
        )

    def _mostly_missing(self, quality: Quality) -> Finding:
        return Finding(
            rule="collision.missing",
            severity="warning",
            subject=self.subject,
            message=f"{100 * quality.missing:.0f} % of the volume has no collision",
            hint="the result may be hollow: use `hull`, or more pieces",
            data={"max_missing": round(quality.missing, 4)},
        )

    def excesses(self, quality: Quality) -> dict[str, tuple[float, float]]:
        """Key of each stated tolerance -> (found, allowed), both in its unit."""
        stated = {
            "max_outside": (quality.max_outside_m, self.max_outside),
            "max_missing": (quality.missing, self.max_missing),
            "max_overcover": (quality.over, self.max_overcover),
        }
        return {key: (found, most) for key, (found, most) in stated.items() if most is not None}

    def _missed(self, quality: Quality) -> Iterator[Finding]:
        """One finding for all tolerances that are not met: by how much, and what to change."""
        over = {k: v for k, v in self.excesses(quality).items() if v[0] > v[1]}
        if not over:
            return
        units = {"max_outside": (1e3, " mm")}
        said = []
        for key, (found, most) in over.items():
            factor, unit = units.get(key, (100.0, " %"))
            said.append(
                f"`{key}` is {factor * found:.3g}{unit} instead of {factor * most:.3g}{unit}"
            )
        yield Finding(
            rule="collision.tolerance",
            severity="warning",
            subject=self.subject,
            message="; ".join(said),
            hint=self._advice(set(over), quality),
            data={
                f"{key}_{side}": round(value, 6)
                for key, pair in over.items()
                for side, value in zip(("found", "allowed"), pair, strict=True)
            },
        )

    def _advice(self, over: set[str], quality: Quality) -> str:
        most = getattr(self, "max_hulls", None)
        if most is not None and quality.pieces >= most:
            return f"raise `max_hulls` (now {most}), or the tolerance"
        if not quality.closed:
            return "the mesh is open: close it, raise the tolerance, or use `primitive`"
        if over == {"max_missing"}:
            return "raise `max_missing`, or use `hull`, which covers everything"
        return "raise the tolerance, or give the link another method"

    def _places(self, reference: Reference, pieces: Sequence[ConvexPiece]) -> Iterator[Finding]:
        for number, place in enumerate(self.probes):
            if place.max_outside is None:
                count = sum(blocked_by(piece, place.probe) for piece in pieces)
                if count:
                    yield Finding(
                        rule="collision.closed",
                        severity="error",
                        subject=self.subject,
                        message=f"`keep_open` {number + 1} is closed by {count} pieces",
                        hint="raise `max_hulls`, lower `max_outside`, or make the probe smaller",
                        data={"probe": number + 1, "pieces": count},
                    )
                continue
            found = outside_in(reference, pieces, place.probe)
            if found > place.max_outside:
                yield Finding(
                    rule="collision.region",
                    severity="warning",
                    subject=self.subject,
                    message=f"collision sticks out by {1e3 * found:.3g} mm instead of "
                    f"{1e3 * place.max_outside:.3g} mm in a region",
                    hint="raise `max_hulls`, or the region's `max_outside`",
                    data={"found_m": round(found, 6), "allowed_m": place.max_outside},
                )


@dataclass(frozen=True)
class Fitted:
    """What a method found. how: the method in words, for the report."""

    pieces: tuple[ConvexPiece, ...]
    findings: tuple[Finding, ...] = ()
    how: str = ""


def hulls(parts: Iterable[TriangleMesh]) -> tuple[ConvexPiece, ...]:
    """Convex parts as pieces."""
    return tuple(ConvexPiece(part) for part in parts)


def carried(piece: Piece, folder: Path, like: Likeness) -> ConvexPiece:
    """A stored piece of the other mesh, moved (and mirrored) to this one."""
    signs, shift = np.asarray(like.signs), np.asarray(like.shift)
    geometry = piece.geometry
    if isinstance(geometry, Mesh):
        hull = read_triangles((folder / geometry.mesh).read_bytes())
        return ConvexPiece(convex_hull(hull.vertices * signs + shift))
    pose = piece.X_frame_piece
    # A primitive is its own mirror image: reflecting both sides of the turn keeps it a rotation.
    rotation = np.diag(signs) @ pose.rotation @ np.diag(signs)
    return ConvexPiece(
        None, geometry, Pose(vec3(np.asarray(pose.xyz) * signs + shift), quat_of(rotation))
    )


def write_pieces(folder: Path, pieces: Sequence[ConvexPiece], quality: Quality | None) -> None:
    """Write `pieces/<n>.obj` for the hulls, `pieces.json` (`Pieces`) and `quality.json`.

    quality: None for the source's own primitive, which is what it is.
    """
    (folder / "pieces").mkdir(exist_ok=True)
    records = []
    for number, piece in enumerate(pieces):
        if piece.hull is None:
            if piece.primitive is None:
                raise ValueError("a piece is a hull or a primitive")
            records.append(Piece(piece.primitive, piece.X_frame_piece))
            continue
        name = f"{number}.obj"
        (folder / "pieces" / name).write_bytes(obj_bytes(piece.hull))
        hull = piece.hull
        records.append(Piece(Mesh(name), IDENTITY, len(hull.vertices), len(hull.faces)))
    (folder / "pieces.json").write_bytes(encode(Pieces(tuple(records))))
    figures = None if quality is None else asdict(quality)
    text = json.dumps(figures, sort_keys=True, indent=1)
    (folder / "quality.json").write_text(text + "\n", encoding="utf-8")
