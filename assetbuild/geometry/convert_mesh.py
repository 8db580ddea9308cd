"""One mesh file -> a mesh per material and its pictures; metres, scale applied, measured."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.mesh.arrays import PARTS, write_meshes
from assetbuild.mesh.material import ConvertedMesh, MaterialPart
from assetbuild.mesh.picture import has_holes, picture_name, png_of
from assetbuild.mesh.read import BY_TRIMESH, NO_MTL, VERTEX_COLOURS, Format, UpAxis, read_mesh
from assetbuild.mesh.triangles import (
    TriangleMesh,
    area,
    corner_normals,
    drop_collapsed,
    merged,
    signed_volume,
    unit_vectors,
    weld,
)
from assetbuild.robot.codec import encode
from assetbuild.robot.pose import Array, Vec3, vec3

T = TypeVar("T", np.float64, np.int64)

NO_AREA = 1e-14
"""m2: MuJoCo refuses a mesh whose surface is smaller."""
NORMAL_DECIMALS = 6
"""A millionth of a radian is beyond any eye, and equal directions stay equal bytes."""

TEXTURE = Rule(
    "mesh.texture",
    "warning",
    "a texture is missing from the source, is not a picture, or has no texture coordinates; the "
    "part is drawn in one colour",
    "add the picture, or unwrap the mesh",
)
TEXTURE_ALPHA = Rule(
    "mesh.texture_alpha",
    "info",
    "transparent parts of a texture are shown opaque",
    "cut the holes into the mesh",
)
UNUSED_UV = Rule(
    "mesh.uv", "info", "texture coordinates that no texture uses were left out", "nothing"
)
LOOKS = {rule.id for rule in (TEXTURE, TEXTURE_ALPHA, UNUSED_UV, NO_MTL, VERTEX_COLOURS)}
"""What is said of these is of no interest where nothing is drawn."""
LINES_ONLY = Rule(
    "mesh.no_area",
    "warning",
    "parts of a mesh are lines without area, and were left out",
    "delete them in the source",
)
COLLAPSED_FACES = Rule(
    "mesh.collapsed_faces", "info", "triangles without area were dropped", "nothing"
)
INSIDE_OUT = Rule(
    "mesh.inside_out",
    "warning",
    "the normals of a closed part point inwards",
    "turn its faces in the source",
)


class ConvertMesh(Step):
    """Reads `mesh`, and the files that it names as `companions/<number>`."""

    shares = True
    usual_s = 0.3
    outputs = ("parts/", "mesh.json")
    isolated = True
    all_told = True
    preload = ("numpy", "collada", "lxml.etree", "PIL.Image")
    limits: ClassVar[Limits] = Limits(wall_s=120.0, memory_mb=4096)

    format: Format
    """The file's format, by its suffix: never guessed from the content."""
    scale: Vec3 = (1.0, 1.0, 1.0)
    """Per axis, baked into the vertices; a mirroring scale keeps outward normals."""
    up_axis: UpAxis = "ignore"
    """What a stated Y_UP or X_UP does: nothing, or turn the mesh to Z."""
    companions: tuple[str, ...] = ()
    """Names, as `mesh/companions.py` spells them, of the inputs `companions/0`, `.../1`, ..."""
    keep_uv: bool = False
    """Keep texture coordinates without a texture: the description brings one."""
    drawn: bool = True
    """Whether it is the mesh of a visual shape; of others nobody sees the looks."""

    def modules(self) -> tuple[str, ...]:
        """Few robots have meshes that trimesh reads, which takes half a second to import."""
        return (*self.preload, "trimesh") if self.format in BY_TRIMESH else self.preload

    def run(self, files: Files) -> Iterable[Finding]:
        """Convert; raises StepError for a mesh that is broken, empty or not finite."""
        found = self._converted(files)
        return (finding for finding in found if self.drawn or finding.rule not in LOOKS)

    def _converted(self, files: Files) -> Iterator[Finding]:
        companions = {
            name: (files.inputs / "companions" / str(number)).read_bytes()
            for number, name in enumerate(self.companions)
        }
        source = read_mesh(
            (files.inputs / "mesh").read_bytes(),
            self.format,
            up_axis=self.up_axis,
            companions=companions,
        )
        yield from source.findings
        painted = _Painted({**companions, **source.pictures}, files.outputs / "parts")
        textured = [painted.part(part) for part in source.parts]
        parts = [MaterialPart(p.material, self._prepared(p)) for p in textured]
        yield from _left_out(source.parts, parts)
        parts = [
            replace(p, mesh=with_four_corners(p.mesh)) for p in parts if area(p.mesh) > NO_AREA
        ]
        if not parts:
            raise StepError("mesh: no triangle has an area")
        turned = source.up_axis is not None and self.up_axis == "honour"
        write_converted(files.outputs, parts, source.up_axis, turned=turned)
        yield from painted.lost.values()
        yield from painted.holes
        yield from _inside_out(parts)

    def _prepared(self, part: MaterialPart) -> TriangleMesh:
        """Scaled and welded; texture coordinates only where a texture uses them."""
        used = self.keep_uv or part.material.texture
        mesh = part.mesh if used else replace(part.mesh, uv=None)
        try:
            welded = weld(mesh.scaled(self.scale))
        except ValueError as error:
            raise StepError(f"mesh: {error} (scale {self.scale})") from error
        kept = drop_collapsed(welded)
        mesh = kept if kept is welded else weld(kept)
        if mesh.normals is not None:
            mesh = replace(mesh, normals=_tidy_normals(mesh, mesh.normals))
        return mesh


def _left_out(before: Sequence[MaterialPart], after: Sequence[MaterialPart]) -> Iterator[Finding]:
    """What of the file's parts was left out when they were prepared, or will be."""
    faces, kept = (sum(len(part.mesh.faces) for part in parts) for parts in (before, after))
    if kept < faces:
        yield COLLAPSED_FACES(
            "mesh",
            f"{faces - kept} of {faces} triangles use one point twice and are left out",
            data={"dropped": faces - kept, "faces": faces},
        )
    pairs = zip(before, after, strict=True)
    dropped = sum(old.mesh.uv is not None and new.mesh.uv is None for old, new in pairs)
    if dropped:
        yield UNUSED_UV(
            "mesh",
            f"texture coordinates without a texture are left out (parts: {dropped})",
            data={"parts": dropped},
        )
    thin = [p for p in after if len(p.mesh.faces) and area(p.mesh) <= NO_AREA]
    if thin:
        faces = sum(len(part.mesh.faces) for part in thin)
        yield LINES_ONLY(
            "mesh",
            f"{len(thin)} of {len(after)} parts are lines without any area "
            f"({faces} triangles): too small to see, left out",
            hint="delete them in the source",
            data={"parts": len(thin), "faces": faces},
        )


def _inside_out(parts: Sequence[MaterialPart]) -> Iterator[Finding]:
    for number, part in enumerate(parts):
        mesh = part.mesh
        if mesh.is_closed and signed_volume(mesh) < 0.0:
            yield INSIDE_OUT(
                "mesh",
                f"part {number} is closed, but its faces point inwards",
                hint="turn its normals in the source; viewers may show it black or hollow",
                data={"part": number, "volume_m3": signed_volume(mesh)},
            )


class _Painted:
    """Materials whose textures are PNG files in `folder`, named by their content.

    lost: what is said of each texture that is not there. holes: of those with transparent parts.
    """

    def __init__(self, pictures: Mapping[str, bytes], folder: Path) -> None:
        folder.mkdir()
        self._pictures, self._folder = pictures, folder
        self._files: dict[str, str | None] = {}
        self.lost: dict[str, Finding] = {}
        self.holes: list[Finding] = []

    def part(self, part: MaterialPart) -> MaterialPart:
        """The part with its texture by file name, or without one."""
        texture = part.material.texture
        if texture is None:
            return part
        if part.mesh.uv is None:
            self._lose(texture, "has no texture coordinates to lie on", "unwrap the mesh")
            return replace(part, material=replace(part.material, texture=None))
        if texture not in self._files:
            self._files[texture] = self._written(texture)
        return replace(part, material=replace(part.material, texture=self._files[texture]))

    def _lose(self, texture: str, why: str, hint: str) -> None:
        message = f"the texture `{texture}` {why}: its part is drawn in one colour"
        self.lost[texture] = TEXTURE("mesh", message, hint, data={"texture": texture})

    def _written(self, texture: str) -> str | None:
        if texture not in self._pictures:
            hint = "paths start at the folder of the file that names the texture"
            self._lose(texture, "is not in the source", hint)
            return None
        try:
            png = png_of(self._pictures[texture], texture)
        except ValueError as error:
            self._lose(texture, f"is not readable as a picture ({error})", "save it as PNG or JPEG")
            return None
        if has_holes(png):
            message = (
                f"the texture `{texture}` has transparent parts: MJCF and USD show them opaque"
            )
            hint = "cut the holes into the mesh if they matter"
            self.holes.append(TEXTURE_ALPHA("mesh", message, hint, data={"texture": texture}))
        name = picture_name(texture, png)
        (self._folder / name).write_bytes(png)
        return name


def write_converted(
    folder: Path,
    parts: Sequence[MaterialPart],
    up_axis: str | None = None,
    *,
    turned: bool = False,
) -> None:
    """Write `PARTS` and `mesh.json` (a `ConvertedMesh`) into `folder`."""
    (folder / "parts").mkdir(exist_ok=True)
    write_meshes(folder / PARTS, {str(n): part.mesh for n, part in enumerate(parts)})
    whole = merged([part.mesh for part in parts])
    whole = whole if len(parts) == 1 else weld(whole)
    lower, upper = whole.bounds
    record = ConvertedMesh(
        materials=tuple(part.material for part in parts),
        faces=len(whole.faces),
        lower=vec3(lower),
        upper=vec3(upper),
        volume_m3=signed_volume(whole) if whole.is_closed else None,  # when all parts together are
        up_axis=up_axis,
        turned=turned,
    )
    (folder / "mesh.json").write_bytes(encode(record))


def _tidy_normals(mesh: TriangleMesh, stated: Array) -> Array:
    """Unit normals per corner, rounded; where the file gives none, that of the face."""
    normals = unit_vectors(np.nan_to_num(stated))
    missing = ~normals.any(axis=2)
    if missing.any():
        normals[missing] = corner_normals(mesh)[missing]
        normals[~normals.any(axis=2)] = (0.0, 0.0, 1.0)  # a needle without area: any direction
    return np.round(normals, NORMAL_DECIMALS) + 0.0


def with_four_corners(mesh: TriangleMesh) -> TriangleMesh:
    """The same surface; where it has but three vertices, one more in its middle.

    The edges stay, so that a closed mesh of several parts stays closed.
    mesh: welded, without collapsed faces. Texture coordinates and normals are averaged alike.
    """
    if len(mesh.vertices) != 3 or not len(mesh.faces):
        return mesh
    return TriangleMesh(
        np.vstack([mesh.vertices, mesh.vertices.mean(axis=0)]),
        _thirds(mesh.faces, np.full(len(mesh.faces), 3)),
        None if mesh.uv is None else _thirds(mesh.uv, mesh.uv.mean(axis=1)),
        None
        if mesh.normals is None
        else _thirds(mesh.normals, unit_vectors(mesh.normals.mean(axis=1))),
    )


def _thirds(corners: NDArray[T], middle: NDArray[T]) -> NDArray[T]:
    """(3 m, 3, ...): from each edge of (m, 3, ...) corners to the (m, ...) middle."""
    ends = np.roll(corners, -1, axis=1)
    thirds = [np.stack([corners[:, i], ends[:, i], middle], axis=1) for i in range(3)]
    return np.concatenate(thirds)
