"""What the source says of a surface, and triangles grouped by it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from assetbuild.findings import Finding, Rule
from assetbuild.mesh.triangles import TriangleMesh, merged
from assetbuild.robot.pose import Vec3

Rgba = tuple[float, float, float, float]

STRAY = Rule(
    "mesh.stray_bytes",
    "info",
    "bytes that do not belong to the format, or are no text, were left out",
    "save the file again",
)


@dataclass(frozen=True, slots=True)
class SurfaceMaterial:
    """Name, colour in 0..1 and texture reference as the file states them; None = it does not."""

    name: str | None = None
    rgba: Rgba | None = None
    texture: str | None = None


@dataclass(frozen=True, eq=False, slots=True)
class MaterialPart:
    """All triangles of one material."""

    material: SurfaceMaterial
    mesh: TriangleMesh


@dataclass(frozen=True)
class ConvertedMesh:
    """`mesh.json` beside `parts/`: what `convert_mesh` and `decimate_mesh` write.

    materials: of the meshes in `PARTS`, in their order; a texture is a PNG in `parts/`, named by
    its content, and its colours are multiplied by rgba (None: white). Metres, scale applied,
    outward normals. lower, upper: bounds. volume_m3: None when open. up_axis: what the file says
    when that is not Z; turned: was the mesh turned accordingly?
    """

    materials: tuple[SurfaceMaterial, ...]
    faces: int
    lower: Vec3
    upper: Vec3
    volume_m3: float | None = None
    up_axis: str | None = None
    turned: bool = False


@dataclass(frozen=True, eq=False)
class SourceMesh:
    """What a mesh file holds: parts by material, order of first appearance; metres.

    pictures: those that lie inside the file, as PNG, by the name that materials use.
    coloured: do single vertices or faces have colours, for which no target has a place?
    up_axis: as the file says, in COLLADA's words; None when it does not.
    """

    parts: tuple[MaterialPart, ...]
    findings: tuple[Finding, ...] = ()
    pictures: Mapping[str, bytes] = field(default_factory=dict)
    up_axis: str | None = None
    coloured: bool = False


def group_by_material(
    placed: Iterable[tuple[SurfaceMaterial, TriangleMesh]],
) -> tuple[MaterialPart, ...]:
    """One part per material, in order of first appearance; triangles keep their order.

    Materials without colour and texture are one part: nobody can tell them apart.
    """
    groups: dict[SurfaceMaterial, list[TriangleMesh]] = {}
    names: dict[SurfaceMaterial, SurfaceMaterial] = {}
    for material, mesh in placed:
        look = material if material.rgba or material.texture else SurfaceMaterial()
        groups.setdefault(look, []).append(mesh)
        names.setdefault(look, material)
    return tuple(
        MaterialPart(names[look], merged(meshes, surface=True)) for look, meshes in groups.items()
    )
