"""How collision geometry is made: methods, tolerances, and the parameters of the libraries."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from assetbuild.quantities import Length, Model, NonNegative, Positive, Real, Share

Preset = Literal["locomotion", "manipulation"]
Point = tuple[Real, Real, Real]


class Region(Model):
    """A place in the frame of the link: a ball, or a capsule from one point to another."""

    from_: Point = Field(alias="from", description="x, y, z in the frame of the link, m")
    to: Point | None = Field(None, description="the other end, m; without it a ball at `from`")
    radius: Length = Field(0.0, description="about the line, `2 mm` or m; 0: the line itself")

    @property
    def ends(self) -> tuple[Point, Point]:
        """Both ends of its axis, m."""
        return self.from_, self.to or self.from_


class ToleranceRegion(Region):
    """A place where collision must follow the mesh more closely."""

    max_outside: Length = Field(description="most that collision may stick out there, `1 mm` or m")


class VHacdOptions(Model):
    """V-HACD's own parameters."""

    resolution: int = Field(
        400_000, ge=1_000, le=50_000_000, description="voxels; time grows with them"
    )
    fill: Literal["flood", "surface", "raycast"] = Field(
        "flood", description="what is inside; `raycast` leaves many real links hollow"
    )
    min_volume_error: NonNegative = Field(
        1.0, le=100, description="percent of a part's volume below which it is not cut further"
    )
    max_depth: int = Field(10, ge=2, le=64, description="most cuts in a row")
    shrink_wrap: bool = Field(True, description="pull the voxel hulls onto the mesh")
    min_edge: int = Field(2, ge=1, le=100, description="smallest edge of a part, voxels")
    best_plane: bool = Field(False, description="search for cutting planes (experimental)")


class CoAcdOptions(Model):
    """CoACD's own parameters; the defaults are our fast ones, 3 to 5 times quicker than its own."""

    threshold: Positive = Field(
        0.05, ge=0.01, le=1, description="concavity that a piece may keep, share of the mesh's size"
    )
    threshold_m: Length | None = Field(
        None, gt=0, description="the same in metres, `5 mm`; used instead of `threshold`"
    )
    preprocess: Literal["auto", "on", "off"] = Field(
        "auto", description="remesh first; it inflates and closes gaps; auto: meshes not manifold"
    )
    preprocess_resolution: int = Field(
        50, ge=20, le=100, description="of the remesh; high values can hollow out open meshes"
    )
    resolution: int = Field(1000, ge=1000, le=10_000, description="samples of the concavity")
    mcts_nodes: int = Field(10, ge=10, le=40, description="cuts tried per axis")
    mcts_iterations: int = Field(60, ge=60, le=2000, description="iterations of the tree search")
    mcts_depth: int = Field(2, ge=2, le=7, description="cuts that the search looks ahead")
    pca: bool = Field(False, description="cut along the principal axes")
    merge: bool = Field(True, description="join pieces afterwards")
    decimate: bool = Field(
        True, description="reduce pieces to `max_vertices`, which is ignored without"
    )
    extrude: bool = Field(False, description="let neighbouring pieces overlap")
    extrude_margin: Positive = Field(0.01, description="of `extrude`, share of the mesh's size")
    approximation: Literal["ch", "box"] = Field("ch", description="convex hulls or boxes")
    seed: int = Field(0, ge=0, le=2**31 - 1, description="of the random search")


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
    xyz: Point = Field((0.0, 0.0, 0.0), description="its centre, of a mesh its origin, m")
    rpy: Point = Field((0.0, 0.0, 0.0), description="its turn, rad, as in URDF; axis z")

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


PrimitiveName = Literal["box", "sphere", "capsule", "cylinder"]


class CollisionRule(Model):
    """How the collision geometry of a link is made, and how well it must fit."""

    method: str = Field("auto", description="auto, keep, none or a plug-in of assetbuild.collision")
    shape: PrimitiveName | tuple[PrimitiveName, ...] | None = Field(
        None,
        min_length=1,
        description="of `primitive`: which, or a list to choose from; without it the best of all",
    )
    from_: Literal["auto", "collision", "visual"] = Field(
        "auto", alias="from", description="the link's geometry to use; auto: collision, else visual"
    )
    preset: Preset | None = Field(
        None, description="tolerances of `auto` that are not stated; without it `collision.preset`"
    )
    max_outside: Length | None = Field(
        None, description="most that collision sticks out of the mesh, `5 mm` or m"
    )
    max_missing: Share | None = Field(
        None, le=1, description="most of the mesh's volume without collision, `2 %`"
    )
    max_overcover: Share | None = Field(
        None, description="most collision volume outside the mesh, share of its volume, `20 %`"
    )
    max_hulls: int | None = Field(None, ge=1, le=1024, description="most pieces, where it applies")
    max_vertices: int | None = Field(
        None, ge=4, le=256, description="most vertices of a piece; PhysX on a GPU takes 64"
    )
    max_polygons: int | None = Field(
        None, ge=16, le=1024, description="most polygons of a piece; PhysX on a GPU takes 64"
    )
    keep_open: tuple[Region, ...] = Field(
        (), max_length=64, description="places that no piece may enter: gaps, holes, handles"
    )
    regions: tuple[ToleranceRegion, ...] = Field(
        (), max_length=64, description="places with a tighter `max_outside`"
    )
    vhacd: VHacdOptions | None = Field(None, description="parameters of V-HACD")
    coacd: CoAcdOptions | None = Field(None, description="parameters of CoACD")
    margin: Share | None = Field(
        None,
        le=0.5,
        description="of `spheres`: how far one may stick out, share of the mesh's size",
    )
    pieces: tuple[ExplicitPiece, ...] | None = Field(
        None, min_length=1, max_length=1024, description="of `explicit`: the geometry itself"
    )
    cpu_limit: Positive | None = Field(
        None, le=1800, description="CPU seconds of one run of a native library"
    )
    memory_limit_mb: int | None = Field(
        None, ge=64, le=4096, description="memory of one run of a native library, MB"
    )


PRESETS: dict[Preset, dict[str, float]] = {
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
