"""Any mesh file to triangles by material: DAE, STL, OBJ, PLY, GLB, glTF, MuJoCo's MSH."""

from __future__ import annotations

import codecs
import io
import posixpath
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from assetbuild.errors import StepError, one_line
from assetbuild.findings import Finding, Rule
from assetbuild.lfs import refuse_pointer
from assetbuild.mesh.companions import picture_of_map, relative_name
from assetbuild.mesh.dae import IGNORED, SKIPPED, read_dae
from assetbuild.mesh.gltf import read_gltf
from assetbuild.mesh.material import (
    STRAY,
    MaterialPart,
    Rgba,
    SourceMesh,
    SurfaceMaterial,
    group_by_material,
)
from assetbuild.mesh.obj import Obj, parse_obj
from assetbuild.mesh.triangles import Indices, TriangleMesh, polygon_triangles
from assetbuild.robot.pose import Array

Format = Literal["dae", "stl", "obj", "ply", "glb", "gltf", "msh"]
BY_TRIMESH: tuple[Format, ...] = ("ply", "glb", "gltf")
UpAxis = Literal["ignore", "honour"]

# Rows are the axes of a Z-up frame in the file's own axes (COLLADA 1.4.1, <up_axis>).
TO_Z_UP: Mapping[str, tuple[tuple[int, int, int], ...]] = {
    "X_UP": ((0, -1, 0), (0, 0, -1), (1, 0, 0)),
    "Y_UP": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
}

UP_AXIS = Rule(
    "mesh.up_axis",
    "info",
    "the file names an up axis other than Z, which is ignored, or honoured where the recipe says "
    "so",
    "look at the robot; many files name the wrong axis",
)
VERTEX_COLOURS = Rule(
    "mesh.vertex_colours",
    "info",
    "colours of single vertices were left out",
    "give the mesh a material, or a texture",
)
NO_MTL = Rule(
    "mesh.no_mtl",
    "info",
    "an OBJ names a material library that does not exist",
    "put it beside the OBJ",
)


def read_mesh(
    data: bytes,
    format: Format,
    *,
    up_axis: UpAxis = "ignore",
    companions: Mapping[str, bytes] | None = None,
    subject: str = "mesh",
) -> SourceMesh:
    """The surfaces of a mesh file, checked: finite, indices in range, not empty.

    Its `up_axis` is None where that is Z already.
    up_axis: "ignore" takes the numbers as they are, which is what URDF viewers do and what most
    files with a false Y_UP need; "honour" turns X_UP and Y_UP to Z_UP.
    companions: other files that it names, by `relative_name`: the MTL files of an OBJ, the
    buffers and pictures of a glTF.
    Raises StepError naming `subject` and the defect.
    """
    if not data:
        raise StepError(f"{subject}: the file is empty")
    refuse_pointer(data, subject)
    for name, content in (companions or {}).items():
        refuse_pointer(content, name)
    if format == "obj":
        mesh = _read_obj(data, companions or {}, subject)
    elif format in ("glb", "gltf"):
        mesh = read_gltf(data, format, companions or {}, subject)
    else:
        readers = {"dae": read_dae, "ply": _read_ply, "stl": _read_stl, "msh": _read_msh}
        mesh = readers[format](data, subject)
    if mesh.coloured:
        message = "colours of single vertices or faces are left out: no target has a place for them"
        colours = VERTEX_COLOURS(subject, message, "give the mesh a material, or a texture")
        mesh = replace(mesh, findings=(*mesh.findings, colours))
    mesh = _upright(mesh, up_axis, subject)
    _refuse_unusable(mesh.parts, subject)
    return mesh


def _upright(mesh: SourceMesh, up_axis: UpAxis, subject: str) -> SourceMesh:
    """The mesh with Z up where that is honoured, and what is said of another axis."""
    stated, honoured = mesh.up_axis or "", up_axis == "honour"
    if stated not in TO_Z_UP:
        return replace(mesh, up_axis=None)
    what = "turned to Z" if honoured else "ignored, coordinates are used as they are"
    hint = "" if honoured else "if it lies on its side, name it in `source.honour_up_axis`"
    message = f"the file declares {stated}: {what}"
    finding = UP_AXIS(subject, message, hint, data={"stated": stated, "honoured": honoured})
    mesh = replace(mesh, findings=(*mesh.findings, finding))
    if not honoured:
        return mesh
    turn = np.array(TO_Z_UP[stated], dtype=np.float64)
    parts = tuple(replace(part, mesh=part.mesh.mapped(turn)) for part in mesh.parts)
    return replace(mesh, parts=parts)


def _refuse_unusable(parts: tuple[MaterialPart, ...], subject: str) -> None:
    if not any(len(part.mesh.faces) for part in parts):
        raise StepError(f"{subject}: no triangles", hint="is it an empty scene or a point cloud?")
    for part in parts:
        mesh = part.mesh
        least, most = int(mesh.faces.min(initial=0)), int(mesh.faces.max(initial=-1))
        if least < 0 or most >= len(mesh.vertices):
            worst = least if least < 0 else most
            raise StepError(
                f"{subject}: a face uses vertex {worst}, there are {len(mesh.vertices)}"
            )
        finite = np.asarray(np.isfinite(mesh.vertices).all(axis=1))
        if not finite.all() and (used := mesh.faces[~finite[mesh.faces]]).size:
            raise StepError(f"{subject}: vertex {int(used.min())} is not a finite number")


def _read_obj(data: bytes, companions: Mapping[str, bytes], subject: str) -> SourceMesh:
    obj = parse_obj(data, subject)
    materials: dict[str, SurfaceMaterial] = {}
    missing = []
    for stated in obj.libraries:
        name = relative_name(stated) or stated
        if name in companions:
            materials.update(_materials_of(companions[name], posixpath.dirname(name)))
        else:
            missing.append(stated)
    placed = [
        (materials.get(name or "", SurfaceMaterial(name=name)), mesh) for name, mesh in obj.parts
    ]
    findings = tuple(_obj_findings(sorted(missing), obj, subject))
    return SourceMesh(group_by_material(placed), findings, coloured=obj.has_colours)


def _obj_findings(missing: list[str], obj: Obj, subject: str) -> Iterator[Finding]:
    if missing:
        yield NO_MTL(
            subject,
            f"colours are not read: `{missing[0]}` is not among the inputs",
            hint="put it into the source; with an MJCF, which MuJoCo reads without it, ignore this",
            data={"libraries": tuple(missing)},
        )
    if obj.skipped:
        counts = dict(sorted(obj.skipped.items()))
        names = ", ".join(f"{count} `{key}`" for key, count in counts.items())
        yield SKIPPED(subject, f"not surfaces, left out: {names}", data=counts)
    for kind in obj.lost:
        yield IGNORED(
            subject,
            f"faces name a `{kind}` that the file does not have: no `{kind}` is read for them",
            hint="shapes are complete; textures or shading may be missing",
            data={"kind": kind},
        )


def _materials_of(data: bytes, folder: str) -> dict[str, SurfaceMaterial]:
    """Materials of an MTL file: diffuse colour, `d` or `Tr` as alpha, `map_Kd` as texture.

    folder: of the library, from that of the mesh; its pictures are named from there.
    """
    out: dict[str, SurfaceMaterial] = {}
    name, rgb, alpha, texture = "", None, 1.0, None
    for line in [*data.decode("utf-8", "replace").splitlines(), "newmtl "]:
        key, _, rest = line.strip().partition(" ")
        words = rest.split()
        try:
            if key == "newmtl":
                if name:
                    out[name] = SurfaceMaterial(name, _colour(rgb, alpha, texture), texture)
                name, rgb, alpha, texture = rest.strip(), None, 1.0, None
            elif key == "Kd":
                rgb = (float(words[0]), float(words[1]), float(words[2]))
            elif key in ("d", "Tr"):
                alpha = float(words[-1]) if key == "d" else 1.0 - float(words[-1])
            elif key == "map_Kd":
                stated = posixpath.join(folder, picture_of_map(rest))
                texture = relative_name(stated) or stated
        except (ValueError, IndexError):
            continue  # a broken colour leaves the material without one, as if it stated none
    return out


def _colour(
    rgb: tuple[float, float, float] | None, alpha: float, texture: str | None
) -> Rgba | None:
    """Kd with alpha. It tints the texture, but for black, which exporters write and do not mean."""
    if texture and (rgb is None or rgb == (0.0, 0.0, 0.0)):
        rgb = (1.0, 1.0, 1.0)
    return None if rgb is None else (*rgb, alpha)


def _read_ply(data: bytes, subject: str) -> SourceMesh:
    import trimesh

    try:
        read: dict[str, Any] = trimesh.exchange.ply.load_ply(io.BytesIO(data))  # Any: untyped
        # Triangles, or polygons of one size where the file has no others.
        polygons = np.asarray(read.get("faces", ()), dtype=np.int64)
        vertices = np.asarray(read.get("vertices", ()), dtype=np.float64).reshape(-1, 3)
    except Exception as error:  # trimesh's reader raises many kinds on broken files
        raise StepError(
            f"{subject}: not readable as PLY: {type(error).__name__}: {one_line(error)}"
        ) from error
    if polygons.ndim == 2 and polygons.shape[1] > 3 and polygons.size:
        if polygons.min() < 0 or polygons.max() >= len(vertices):
            raise StepError(
                f"{subject}: a face uses vertex {polygons.max()}, there are {len(vertices)}"
            )
        corners = polygons.reshape(-1)
        counts = np.full(len(polygons), polygons.shape[1])
        polygons = corners[polygon_triangles(counts, vertices[corners])]
    coloured = read.get("vertex_colors") is not None or read.get("face_colors") is not None
    return _bare(vertices, polygons.reshape(-1, 3), coloured=coloured)


def _bare(vertices: Array, faces: Indices | None = None, **said: Any) -> SourceMesh:
    """A mesh without a material; without faces each three vertices are one."""
    if faces is None:
        faces = np.arange(len(vertices), dtype=np.int64).reshape(-1, 3)
    return SourceMesh((MaterialPart(SurfaceMaterial(), TriangleMesh(vertices, faces)),), **said)


def _read_msh(data: bytes, subject: str) -> SourceMesh:
    """MuJoCo's own format; its normals follow from the winding, and no texture uses its `uv`.

    Four int32: the counts of vertices, normals, texture coordinates and faces; then float32 (3, 3
    and 2 of each), then int32 (3 of each face).
    """
    counts = np.frombuffer(data[:16], "<i4").astype(np.int64) if len(data) >= 16 else np.zeros(4)
    sizes = 4 * counts * (3, 3, 2, 3)
    if counts.min() < 0 or 16 + sizes.sum() != len(data) or not counts[3]:
        raise StepError(f"{subject}: not readable as MSH: its counts do not match its size")
    vertices = np.frombuffer(data, "<f4", 3 * counts[0], 16).astype(np.float64)
    faces = np.frombuffer(data, "<i4", 3 * counts[3], len(data) - sizes[3]).astype(np.int64)
    return _bare(vertices.reshape(-1, 3), faces.reshape(-1, 3))


# --- STL --------------------------------------------------------------------------------------

HEADER = 80
RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])

NUMBER = rb"\s+([-+.\dni]\S*)"
CORNER = re.compile(rb"\bvertex" + 3 * NUMBER)
"""A corner of a text STL in lower case; `nan` and `inf` are refused later, with all the others."""


def _read_stl(data: bytes, subject: str) -> SourceMesh:
    """The triangles of an STL file, not welded; its normals follow from the winding.

    76 of 410 real binary files begin with `solid`: 84 + 50 n == size decides. Up to 49 bytes more
    hold no further triangle and are left out, with a finding.
    Raises StepError when the face count and the size disagree, or the text is not STL.
    """
    count = int.from_bytes(data[HEADER : HEADER + 4], "little") if len(data) >= HEADER + 4 else -1
    expected = HEADER + 4 + RECORD.itemsize * count
    stray = len(data) - expected
    if count >= 0 and 0 <= stray < RECORD.itemsize:
        corners = np.frombuffer(data, dtype=RECORD, offset=HEADER + 4, count=count)["corners"]
        message = f"{stray} bytes after the last of {count} triangles are left out"
        findings = (STRAY(subject, message, hint="save the file again"),) if stray else ()
        return _bare(corners.astype(np.float64).reshape(-1, 3), findings=findings)
    begin = data[:512].removeprefix(codecs.BOM_UTF8).lstrip().lower()
    if begin.startswith(b"solid") and b"facet" in data[:4096].lower():
        return _read_text(data, subject)
    if count < 0:
        raise StepError(f"{subject}: {len(data)} bytes are too few for an STL file")
    raise StepError(
        f"{subject}: the header promises {count} faces, which is {expected} bytes, "
        f"the file has {len(data)}",
        hint="the file is cut off, or it is not an STL file"
        if stray < 0
        else "the count is wrong, or something else follows: save the file again",
    )


def _read_text(data: bytes, subject: str) -> SourceMesh:
    data = data.lower()
    if b"endsolid" not in data[-512:]:
        line = data.count(b"\n") + 1
        raise StepError(f"{subject}: cut off at line {line}: no `endsolid`")
    try:
        corners = [tuple(map(float, corner)) for corner in CORNER.findall(data)]
    except ValueError as error:
        raise StepError(f"{subject}: not a text STL: {error}") from error
    if 3 * data.count(b"endfacet") != len(corners):
        raise StepError(f"{subject}: {data.count(b'endfacet')} facets, {len(corners)} corners")
    return _bare(np.array(corners, dtype=np.float64).reshape(-1, 3))
