"""Collision methods, one plug-in a file: source shapes in, convex pieces out.

A method is a step: fields are its parameters, `fit` is its work, the rest is here: reading and
checking the sources, reuse of equal shapes, measuring, and what is said about tolerances.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field
from pydantic.fields import FieldInfo

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.mesh import MESH_MODULES
from assetbuild.mesh.arrays import PARTS, read_meshes, write_meshes
from assetbuild.mesh.cover import Quality, Reference, measure
from assetbuild.mesh.decomposition import VHacdOptions, vhacd_parts
from assetbuild.mesh.hull import capped, convex_hull, refuse_flat
from assetbuild.mesh.native import NativeError, NativeLimits
from assetbuild.mesh.primitives import BY_NAME, resized, tessellate
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import TriangleMesh, cleaned, merged
from assetbuild.mesh.verdict import Probe, blocked_by, verdict
from assetbuild.plugin_types import Piece, Pieces
from assetbuild.recipe_types import Length, Positive, Share
from assetbuild.robot.codec import decode_file, encode
from assetbuild.robot.pose import IDENTITY, Pose, Vec3, quat_of, vec3
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Mesh, Primitive, Sphere, sizes_of

AS_GOOD = 0.01
"""A reused result may be worse by this much, the error of sampled volumes, and its distances by
this share of the diagonal."""

MaxHulls = Annotated[int, Field(ge=1, le=1024, description="most pieces")]
MaxVertices = Annotated[
    int, Field(ge=4, le=256, description="most vertices of a piece; PhysX on a GPU takes 64")
]
MaxPolygons = Annotated[
    int | None,
    Field(ge=16, le=1024, description="most polygons of a piece; PhysX on a GPU takes 64"),
]
LIBRARY_FAILED = Rule(
    "collision.library_failed",
    "warning",
    "V-HACD or CoACD crashed, or exceeded its time or memory limit; the next method was used",
    "raise the limit, or repair the mesh",
)


@dataclass(frozen=True)
class PlacedSource:
    """One source shape: a mesh (its input folder) or a primitive, with its pose.

    kind: the class of a primitive by name, so that equal sizes of another kind differ; sizes: its
    own, as `sizes_of` lists them, m. pose: of the shape in the output frame.
    """

    folder: str | None = None
    kind: str | None = None
    sizes: tuple[float, ...] = ()
    pose: Pose = IDENTITY

    @classmethod
    def of_primitive(cls, geometry: Primitive, pose: Pose = IDENTITY) -> PlacedSource:
        """A primitive of the source."""
        return cls(kind=type(geometry).__name__, sizes=sizes_of(geometry), pose=pose)

    @property
    def primitive(self) -> Primitive | None:
        """The primitive of the robot model, if it is one."""
        return None if self.kind is None else resized(BY_NAME[self.kind], self.sizes)


@dataclass(frozen=True)
class Likeness:
    """Another mesh has the same shape: p = signs * p_other + shift, per axis."""

    signs: Vec3
    shift: Vec3


class CollisionMethod(Step):
    """Base of all methods: reads and checks the sources, verifies, measures, writes the pieces.

    With `like`, the pieces of an equal shape (`like/pieces.json`, `like/pieces.npz`) are tried
    first, and taken when they fit this mesh as well as they fit theirs.
    """

    shares = True
    usual_s = 1.0
    group: ClassVar[str] = "collision"
    outputs = ("pieces.npz", "pieces.json", "quality.json")
    isolated = True
    preload = MESH_MODULES
    limits: ClassVar[Limits] = Limits(wall_s=7200.0, memory_mb=4096)
    keeps: ClassVar[tuple[type[Primitive], ...]] = (Box, Sphere, Cylinder, Capsule)
    """Primitives of the source that stay, as they are convex and exact already."""
    scope: ClassVar[Literal["shape", "shapes", "link"]] = "shape"
    """Works on each source shape, shared by all links that use it; on all shapes of a link
    together (a single one is shared, too); or in the frame of the link, whatever its shapes."""

    sources: tuple[PlacedSource, ...] = Field(min_length=1)
    subject: str = "collision"
    """What findings and errors call it. Part of the key: name no link to share the result."""
    max_outside: Length | None = Field(
        None, le=1, description="most that collision sticks out of the mesh, `5 mm` or m"
    )
    max_missing: Share | None = Field(
        None, le=1, description="most of the mesh's volume without collision, `2 %`"
    )
    max_overcover: Share | None = Field(
        None, description="most collision volume outside the mesh, share of its volume, `20 %`"
    )
    probes: tuple[Probe, ...] = ()
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
        if len(self.sources) > 1 or not isinstance(source.primitive, self.keeps):
            return None
        return (ConvexPiece(source.primitive, source.pose),)

    @classmethod
    def keys(cls) -> dict[str, FieldInfo]:
        """The fields that a rule of the recipe may state, by name: those with a description."""
        return {name: info for name, info in cls.model_fields.items() if info.description}

    @classmethod
    def preset(cls, name: str) -> Mapping[str, float]:
        """What `collision.preset` states where a rule does not; `auto` alone has any."""
        return {}

    def run(self, files: Files) -> Iterable[Finding]:
        """Fit; raises StepError for sources that no method can work with."""
        exact = self.exact()
        if exact is not None:
            write_pieces(files.outputs, exact, None)
            return
        reference = Reference(self.mesh_of(files))
        made = self._reused(reference, files.inputs / "like")
        if made is None:
            fitted = self.fit(reference)
            pieces = self.verified(fitted.pieces)
            flat = len(fitted.pieces) - len(pieces)
            yield from fitted.findings
            if not pieces:
                raise StepError(
                    f"{self.subject}: {self.step_name()} found no piece with a volume",
                    hint="use another method, `hull` for example",
                )
            known = None if flat else fitted.quality
            made = pieces, measure(reference, pieces, flat=flat, known=known), fitted.how
        yield from self.proven(files, reference, *made)

    def proven(
        self,
        files: Files,
        reference: Reference,
        pieces: Sequence[ConvexPiece],
        quality: Quality,
        how: str,
    ) -> Iterator[Finding]:
        """Write the pieces, and say how they fit. how: the method in words."""
        write_pieces(files.outputs, pieces, quality)
        tolerances = self.excesses(quality)
        presets = [self.preset(name) for name in ("locomotion", "manipulation")]
        yield from verdict(
            self.subject,
            reference,
            pieces,
            quality,
            how=how,
            tolerances=tolerances,
            places=self.probes,
            max_hulls=getattr(self, "max_hulls", None),
            usual={k for k, (_, most) in tolerances.items() for p in presets if p.get(k) == most},
        )

    def mesh_of(self, files: Files) -> TriangleMesh:
        """All sources welded into one mesh in the output frame, checked."""
        placed = [self.source_mesh(source, files.inputs) for source in self.sources]
        mesh = cleaned(merged(placed))
        if len(mesh.faces) < 4:
            raise StepError(
                f"{self.subject}: {len(mesh.faces)} triangles enclose no volume",
                hint="give the link a `primitive`, other shapes (`from`) or `method: none`",
            )
        refuse_flat(mesh.vertices, self.subject)
        return mesh

    def source_mesh(self, source: PlacedSource, inputs: Path) -> TriangleMesh:
        """One source in the output frame, as it is."""
        if source.primitive is not None:
            return tessellate(source.primitive).placed(source.pose)
        meshes = read_meshes(inputs / (source.folder or "") / PARTS)
        return merged([*meshes.values()]).placed(source.pose)

    def verified(self, pieces: Iterable[ConvexPiece]) -> list[ConvexPiece]:
        """The pieces, hulls among them hulled again by qhull and capped; flat ones are left out."""
        made = []
        for piece in pieces:
            hull = piece.solid
            with suppress(StepError):
                if isinstance(hull, TriangleMesh):
                    piece = self.within_caps(convex_hull(hull.vertices))
                made.append(piece)
        return made

    def within_caps(self, hull: TriangleMesh) -> ConvexPiece:
        """A piece of no more vertices and polygons than the fields allow. Raises StepError."""
        limits = (getattr(self, name, None) for name in ("max_vertices", "max_polygons"))
        return ConvexPiece(capped(hull, *limits))

    # --- reuse --------------------------------------------------------------------------------

    def _reused(
        self, reference: Reference, folder: Path
    ) -> tuple[list[ConvexPiece], Quality, str] | None:
        """The other mesh's pieces where they fit as well here, else None."""
        if self.like is None:
            return None
        before = json.loads((folder / "quality.json").read_bytes())
        pieces = [carried(piece, self.like) for piece in read_pieces(folder)]
        if before is None or any(
            blocked_by(p, place) for place in self.closed_places for p in pieces
        ):
            return None
        quality = measure(reference, pieces, flat=before["flat"])
        as_good = (
            quality.iou >= before["iou"] - AS_GOOD
            and quality.missing <= before["missing"] + AS_GOOD
            and quality.max_outside_m <= before["max_outside_m"] + AS_GOOD * reference.diagonal
            and quality.p99_m <= before["p99_m"] + AS_GOOD * reference.diagonal
        )
        return (pieces, quality, "reused from an equal shape") if as_good else None

    def excesses(self, quality: Quality) -> dict[str, tuple[float, float]]:
        """Key of each stated tolerance -> (found, allowed), both in its unit."""
        stated = {
            "max_outside": (quality.max_outside_m, self.max_outside),
            "max_missing": (quality.missing, self.max_missing),
            "max_overcover": (quality.over, self.max_overcover),
        }
        return {key: (value, most) for key, (value, most) in stated.items() if most is not None}

    @property
    def closed_places(self) -> tuple[Probe, ...]:
        """Where no piece may be."""
        return tuple(place for place in self.probes if place.max_outside is None)


class LibraryMethod(CollisionMethod):
    """A method that runs V-HACD or CoACD in a process of its own, within limits."""

    cpu_limit: Positive = Field(
        60.0, le=1800, description="CPU seconds of one run of a native library"
    )
    memory_limit_mb: int = Field(
        3072, ge=64, le=4096, description="memory of one run of a native library, MB"
    )

    @property
    def native_limits(self) -> NativeLimits:
        """Limits of one run."""
        return NativeLimits(self.cpu_limit, self.memory_limit_mb)

    def vhacd_or_hull(
        self, reference: Reference, options: VHacdOptions, max_hulls: int, max_vertices: int
    ) -> Fitted:
        """V-HACD's parts; where it fails, one hull and a finding."""
        try:
            made = vhacd_parts(reference.mesh, options, max_hulls, max_vertices, self.native_limits)
        except NativeError as failure:
            failed = self.fell("V-HACD", failure, "hull")
            return Fitted((ConvexPiece(reference.hull),), (failed,), "hull")
        return Fitted(tuple(map(ConvexPiece, made)), (), "V-HACD")

    def fell(self, library: str, failure: NativeError, instead: str) -> Finding:
        """What is said when a library gave no result."""
        hints = {
            "time": "raise `cpu_limit`, or give the link another method",
            "memory": "raise `memory_limit_mb`, or give the link another method",
        }
        return LIBRARY_FAILED(
            self.subject,
            f"{library}: {failure}; `{instead}` was used instead",
            hint=hints.get(failure.cause, "give the link another method, or repair its mesh"),
            data={"library": library, "cause": failure.cause, "instead": instead},
        )


@dataclass(frozen=True)
class Fitted:
    """What a method found. how: the method in words, for the report. quality: as `rough` found it
    with all samples.
    """

    pieces: tuple[ConvexPiece, ...]
    findings: tuple[Finding, ...] = ()
    how: str = ""
    quality: Quality | None = None


def carried(piece: ConvexPiece, like: Likeness) -> ConvexPiece:
    """A piece of the other mesh, moved (and mirrored) to this one."""
    signs, shift = np.asarray(like.signs), np.asarray(like.shift)
    if isinstance(piece.solid, TriangleMesh):
        return ConvexPiece(convex_hull(piece.solid.vertices * signs + shift))
    pose = piece.X_frame_piece
    # A primitive is its own mirror image: reflecting both sides of the turn keeps it a rotation.
    rotation = np.diag(signs) @ pose.rotation @ np.diag(signs)
    moved = Pose(vec3(np.asarray(pose.xyz) * signs + shift), quat_of(rotation))
    return ConvexPiece(piece.solid, moved)


def write_pieces(folder: Path, pieces: Sequence[ConvexPiece], quality: Quality | None) -> None:
    """Write `pieces.npz` for the hulls, `pieces.json` (`Pieces`) and `quality.json`.

    quality: None for the source's own primitive, which is what it is.
    """
    hulls = {str(n): p.solid for n, p in enumerate(pieces) if isinstance(p.solid, TriangleMesh)}
    records = [
        Piece(Mesh(str(n)) if isinstance(p.solid, TriangleMesh) else p.solid, p.X_frame_piece)
        for n, p in enumerate(pieces)
    ]
    write_meshes(folder / "pieces.npz", hulls)
    (folder / "pieces.json").write_bytes(encode(Pieces(tuple(records))))
    figures = None if quality is None else asdict(quality)
    text = json.dumps(figures, sort_keys=True, indent=1)
    (folder / "quality.json").write_text(text + "\n", encoding="utf-8")


def read_pieces(folder: Path) -> list[ConvexPiece]:
    """What `write_pieces` wrote."""
    hulls = read_meshes(folder / "pieces.npz")
    pieces = []
    for piece in decode_file(Pieces, folder / "pieces.json").pieces:
        geometry = piece.geometry
        solid = hulls[geometry.mesh] if isinstance(geometry, Mesh) else geometry
        pieces.append(ConvexPiece(solid, piece.X_frame_piece))
    return pieces
