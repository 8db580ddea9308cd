"""Collision methods, one plug-in a file: source shapes in, convex pieces out.

A method is a step: fields are its parameters, `fit` is its work, the rest is here.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import StepError
from assetbuild.findings import Finding
from assetbuild.kinds import ConvertedMesh, Piece, Pieces
from assetbuild.mesh.hull import convex_hull, polygon_count, refuse_flat
from assetbuild.mesh.obj import obj_bytes, read_triangles
from assetbuild.mesh.primitives import Primitive, tessellate
from assetbuild.mesh.solid import ConvexPiece, measure_cover
from assetbuild.mesh.triangles import TriangleMesh, merged
from assetbuild.mesh.volume import is_closed
from assetbuild.mesh.weld import cleaned
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.model import Box, Capsule, Cylinder, Mesh, Sphere
from assetbuild.robot.pose import IDENTITY, Pose, Quat, Vec3

MISSING = 0.5
"""Share of the volume without collision that no tolerance explains: a method went wrong."""


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


class CollisionMethod(Step):
    """Base of all methods: reads and checks the sources, verifies and writes the pieces."""

    outputs = ("pieces/", "pieces.json")
    isolated = True
    limits: ClassVar[Limits] = Limits(wall_s=120.0, memory_mb=4096)
    scope: ClassVar[Literal["shape", "link"]] = "shape"
    """Once per source shape, shared by all links that use it; or once per link."""
    hull_tools: ClassVar[tuple[str, ...]] = ("numpy", "scipy")
    """What the reading, hulls and measures here depend on; subclasses add their library."""

    sources: tuple[PlacedSource, ...] = Field(min_length=1)
    subject: str = "collision"
    """What findings and errors call it. Part of the key: name no link to share the result."""

    def fit(self, mesh: TriangleMesh) -> Iterable[ConvexPiece]:
        """Convex pieces for the welded mesh of all sources, in the output frame.

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

    def run(self, files: Files) -> Iterable[Finding]:
        """Fit; raises StepError for sources that no method can work with."""
        known = self.exact()
        if known is not None:
            write_pieces(files.outputs, known)
            return
        mesh = self._mesh(files)
        raw = list(self.fit(mesh))
        pieces = [piece for piece in map(self._verified, raw) if piece is not None]
        if not pieces:
            raise StepError(
                f"{self.subject}: {self.step_name()} found no piece with a volume",
                hint="use another method, `hull` for example",
            )
        write_pieces(files.outputs, pieces)
        if len(pieces) < len(raw):
            yield self._flat_pieces(len(raw) - len(pieces), len(raw))
        yield from self._gap(mesh, pieces)

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

    def _verified(self, piece: ConvexPiece) -> ConvexPiece | None:
        """A hull piece hulled again by qhull and capped; None when it is flat."""
        if piece.hull is None:
            return piece
        try:
            points = piece.hull.vertices
            return ConvexPiece(convex_hull(points, max_vertices=self.vertex_cap))
        except StepError:
            return None

    def _flat_pieces(self, flat: int, made: int) -> Finding:
        return Finding(
            rule="collision.flat_piece",
            severity="warning",
            subject=self.subject,
            message=f"{flat} of {made} pieces are flat and left out",
            data={"flat": flat, "pieces": made},
        )

    def _gap(self, mesh: TriangleMesh, pieces: Sequence[ConvexPiece]) -> Iterator[Finding]:
        cover = measure_cover(mesh, pieces)
        hulls = [piece.hull for piece in pieces if piece.hull is not None]
        closed = is_closed(mesh)
        outside = 1e3 * cover.max_outside_m
        yield Finding(
            rule="collision.gap",
            severity="info",
            subject=self.subject,
            message=f"{self.step_name()}: {len(pieces)} pieces, up to {outside:.2g} mm outside, "
            f"{100 * cover.under:.1f} % of the volume missing, {100 * cover.over:.1f} % too much"
            + ("" if closed else " (the mesh is open: its inside is a majority of three rays)"),
            data={
                "pieces": len(pieces),
                "max_outside_mm": round(outside, 3),
                "max_missing": round(cover.under, 4),
                "over": round(cover.over, 4),
                "iou": round(cover.iou, 4),
                "closed": closed,
                "max_vertices": max((len(h.vertices) for h in hulls), default=0),
                "max_polygons": max((polygon_count(h) for h in hulls), default=0),
            },
        )
        if cover.under > MISSING:
            yield Finding(
                rule="collision.missing",
                severity="warning",
                subject=self.subject,
                message=f"{100 * cover.under:.0f} % of the volume has no collision",
                hint="the result may be hollow: use `hull`, or more pieces",
                data={"max_missing": round(cover.under, 4)},
            )


def write_pieces(folder: Path, pieces: Sequence[ConvexPiece]) -> None:
    """Write `pieces/<n>.obj` for the hulls, and `pieces.json` (`Pieces`)."""
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
