"""COLLADA through pycollada: every surface of the scene, where its nodes put it."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any
from urllib.parse import unquote

import numpy as np

from assetbuild.errors import StepError, Where
from assetbuild.findings import Finding, Rule
from assetbuild.mesh.companions import relative_name
from assetbuild.mesh.material import (
    MaterialPart,
    SurfaceMaterial,
    colours_finding,
    group_by_material,
)
from assetbuild.mesh.triangles import Indices, TriangleMesh
from assetbuild.robot.pose import Array

SKIPPED = Rule(
    "mesh.skipped",
    ("info", "warning"),
    "lines, points or empty parts were left out (a warning for skins)",
    "nothing",
)
UNIT = Rule("mesh.unit", "info", "the unit of the file was applied", "nothing")
IGNORED = Rule(
    "mesh.ignored",
    "warning",
    "parts of the file that are not geometry could not be read",
    "check the colours",
)

# Any below: pycollada has no type hints.


@dataclass(frozen=True, eq=False)
class Dae:
    """A COLLADA file. Parts are in the file's own axes, metres, nodes applied.

    up_axis: as the file says, "Y_UP" when it says nothing (the standard's default), or None
    when there is no asset to say it.
    """

    parts: tuple[MaterialPart, ...]
    up_axis: str | None
    findings: tuple[Finding, ...]


def read_dae(data: bytes, subject: str) -> Dae:
    """All triangles and polygons of a COLLADA file, by material.

    Raises StepError with the line of a cut-off or broken file, for a geometry that cannot be
    read, and for NaN in positions (which pycollada would turn into zeros).
    """
    document = _with_broken_samplers(_load(data, subject), subject)
    document = _without_lost_materials(document, subject)
    _refuse_lost_geometry(document, subject)
    skipped: dict[str, int] = {}
    placed: list[tuple[SurfaceMaterial, TriangleMesh]] = []
    positions: dict[str, Array] = {}
    coloured = False
    for geometry, materials, matrix in _instances(document, skipped):
        for primitive in geometry.primitives:
            kind = type(primitive).__name__
            if kind == "LineSet":
                skipped["lines"] = skipped.get("lines", 0) + 1
                continue
            coloured = coloured or bool(primitive.sources.get("COLOR"))
            mesh = _triangles(primitive, positions, subject)
            if len(mesh.faces):
                material = _material(materials.get(primitive.material))
                placed.append((material, _moved(mesh, matrix, subject)))
    unit = document.assetInfo.unitmeter if document.assetInfo is not None else None
    if unit is not None and unit != 1.0:
        scale = (float(unit),) * 3
        placed = [(material, mesh.scaled(scale)) for material, mesh in placed]
    cameras = len(document.cameras)
    if cameras:
        skipped["cameras"] = cameras
    return Dae(
        group_by_material(placed),
        document.assetInfo.upaxis if document.assetInfo is not None else None,
        (
            *_skipped_finding(skipped, subject),
            *_unit_finding(unit, subject),
            *colours_finding(coloured, subject),
            *_ignored_finding(document, subject),
        ),
    )


def _load(data: bytes, subject: str) -> Any:
    import collada
    from collada.common import DaeError

    if data[:2] == b"PK":
        raise StepError(f"{subject}: a zip archive, not COLLADA text", hint="unpack it first")
    plain = data.replace(b"\0", b"")  # UTF-16 would hide the words
    if b"<!ENTITY" in plain or b"<!DOCTYPE" in plain:
        raise StepError(f"{subject}: declares XML entities, which no exporter does")
    try:
        document = collada.Collada(io.BytesIO(data), ignore=[DaeError])
    except (DaeError, ValueError, KeyError, AttributeError, TypeError, IndexError) as error:
        _refuse_broken_xml(data, subject)
        raise StepError(f"{subject}: not readable as COLLADA: {_one_line(error)}") from error
    if document.scene is None:
        raise StepError(f"{subject}: the file has no scene, so nothing says where its parts are")
    return document


def _with_broken_samplers(document: Any, subject: str) -> Any:
    """The file with samplers mended whose picture the material itself names.

    `<texture texture="...">` should name a sampler; where it names a picture and the sampler
    leads nowhere, what is meant is certain. pycollada would leave out the material.
    """
    from lxml import etree

    if not document.errors:
        return document
    root = document.xmlnode.getroot()
    pictures = {image.id for image in document.images}
    broken = False
    for profile in root.iter(document.tag("profile_COMMON")):
        params = {param.get("sid"): param for param in profile.findall(document.tag("newparam"))}
        named = {texture.get("texture") for texture in profile.iter(document.tag("texture"))}
        for param in params.values():
            source = param.find(f"{document.tag('sampler2D')}/{document.tag('source')}")
            if source is None or (source.text or "").strip() in params or len(named) != 1:
                continue
            for other in params.values():
                start = other.find(f"{document.tag('surface')}/{document.tag('init_from')}")
                if start is not None and (start.text or "").strip() in named & pictures:
                    source.text = other.get("sid")
                    broken = True
    if not broken:
        return document
    whole = _load(etree.tostring(root), subject)
    whole.errors = document.errors
    return whole


def _without_lost_materials(document: Any, subject: str) -> Any:
    """The file without uses of materials that it does not hold, or that are broken themselves.

    pycollada leaves out a whole geometry when one of its materials is missing; its triangles
    matter more than their colour, whose loss `mesh.ignored` tells.
    """
    from lxml import etree

    known = {material.id for material in document.materials}
    root = document.xmlnode.getroot()
    uses = list(root.iter(document.tag("instance_material")))
    lost = [use for use in uses if use.get("target", "").removeprefix("#") not in known]
    if not lost:
        return document
    for use in lost:
        use.getparent().remove(use)
    whole = _load(etree.tostring(root), subject)
    whole.errors = document.errors
    return whole


def _refuse_broken_xml(data: bytes, subject: str) -> None:
    """Raise with the line where the XML stops being XML."""
    from lxml import etree

    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True)
    try:
        etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        line = error.position[0] or data.count(b"\n") + 1
        raise StepError(
            f"broken XML: {_one_line(error.msg)}",
            where=Where(subject, line),
            hint="is the file cut off?",
        ) from error


def _refuse_lost_geometry(document: Any, subject: str) -> None:
    """pycollada goes on after a geometry that it cannot read; then a part would be missing."""
    stated = len(document.xmlnode.getroot().findall(f".//{document.tag('geometry')}"))
    lost = [e for e in document.errors if "eometry" in str(e)]
    if stated > len(document.geometries) or lost:
        first = (lost or document.errors or ["unknown reason"])[0]
        raise StepError(f"{subject}: a geometry is not readable: {_one_line(first)}")


def _instances(
    document: Any, skipped: dict[str, int]
) -> Iterator[tuple[Any, Mapping[str, Any], Array]]:
    """(geometry, materials by symbol, matrix (4, 4)) of every instance, in document order."""
    stack = [(node, np.eye(4)) for node in reversed(document.scene.nodes)]
    while stack:
        node, matrix = stack.pop()
        geometry = getattr(node, "geometry", None)
        if geometry is not None:
            yield geometry, {m.symbol: m.target for m in node.materials}, matrix
            continue
        kind = type(node).__name__
        if kind == "ControllerNode":
            skipped["skins"] = skipped.get("skins", 0) + 1
        target = getattr(node, "node", node)  # an instance_node points to a library node
        for transform in getattr(target, "transforms", ()):
            # A look-at places a camera; as a node above a mesh it has a matrix like the others.
            matrix = matrix @ _stated(transform.matrix)
        stack.extend((child, matrix) for child in reversed(getattr(target, "children", ())))


def _stated(values: Any) -> Array:
    """float32 numbers as the decimal numbers that the text says, as far as float32 tells."""
    return np.asarray(np.asarray(values, dtype=np.float32).astype(str), dtype=np.float64)


def _triangles(primitive: Any, positions: dict[str, Array], subject: str) -> TriangleMesh:
    """One primitive's triangles in the frame of its geometry; polygons are cut into fans."""
    if hasattr(primitive, "triangleset"):
        primitive = primitive.triangleset()
    if primitive.vertex is None or primitive.vertex_index is None or not len(primitive.index):
        return TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    vertices = _positions(primitive, positions, subject)
    faces = _index(primitive.vertex_index, len(vertices), "position", subject)
    uv = normals = None
    if primitive.texcoordset:
        table = np.asarray(primitive.texcoordset[0], dtype=np.float64)[:, :2]
        uv = table[_index(primitive.texcoord_indexset[0], len(table), "texture", subject)]
    if primitive.normal is not None:
        table = np.asarray(primitive.normal, dtype=np.float64)
        normals = table[_index(primitive.normal_index, len(table), "normal", subject)]
    return TriangleMesh(vertices, faces, uv, normals)


def _positions(primitive: Any, cache: dict[str, Array], subject: str) -> Array:
    """(n, 3) float64 from the text itself: pycollada rounds to float32 and turns NaN into 0."""
    source = primitive.sources["VERTEX"][0][4]
    if source.id in cache:
        return cache[source.id]
    rounded = np.asarray(source.data, dtype=np.float64)
    text = next((n.text for n in source.xmlnode if n.tag.endswith("float_array")), None) or ""
    values = np.fromstring(text, dtype=np.float64, sep=" ") if text.strip() else np.zeros(0)
    out = values.reshape(rounded.shape) if values.size == rounded.size else rounded
    if not np.isfinite(out).all():
        row = int(np.argmin(np.isfinite(out).all(axis=1)))
        raise StepError(f"{subject}: vertex {row} of `{source.id}` is not a finite number")
    if out.shape[1] != 3:
        raise StepError(f"{subject}: positions of `{source.id}` have {out.shape[1]} components")
    cache[source.id] = out
    return out


def _index(values: Any, size: int, what: str, subject: str) -> Indices:
    index = np.asarray(values, dtype=np.int64)
    bad = (index < 0) | (index >= size)
    if bad.any():
        raise StepError(f"{subject}: {what} index {int(index[bad][0])}, there are {size}")
    return index


def _moved(mesh: TriangleMesh, matrix: Array, subject: str) -> TriangleMesh:
    try:
        return mesh.mapped(matrix[:3, :3], matrix[:3, 3])
    except ValueError as error:
        raise StepError(f"{subject}: a node scales its geometry to zero") from error


def _material(material: Any) -> SurfaceMaterial:
    """Name, diffuse colour or picture. Transparency is left out: exporters disagree on it."""
    if material is None:
        return SurfaceMaterial()
    from collada.material import Map

    out = SurfaceMaterial(name=material.name or material.id or None)
    diffuse = material.effect.diffuse if material.effect is not None else None
    if isinstance(diffuse, Map):
        image = getattr(getattr(diffuse.sampler, "surface", None), "image", None)
        stated = unquote((image.path or "").strip()) if image is not None else ""
        return replace(out, texture=relative_name(stated) or stated or None)
    if diffuse is None:
        return out
    r, g, b, a = (*(float(v) for v in _stated(diffuse)), 1.0)[:4]
    return replace(out, rgba=(r, g, b, a))


def _skipped_finding(skipped: Mapping[str, int], subject: str) -> Iterator[Finding]:
    if skipped:
        names = ", ".join(f"{count} {name}" for name, count in sorted(skipped.items()))
        yield SKIPPED(
            subject,
            f"not surfaces, left out: {names}",
            severity="warning" if "skins" in skipped else "info",
            data=dict(sorted(skipped.items())),
        )


def _unit_finding(unit: float | None, subject: str) -> Iterator[Finding]:
    if unit is not None and unit != 1.0:
        yield UNIT(
            subject,
            f"the file's unit is {unit:g} m; it is applied, as viewers do",
            data={"unit_m": float(unit)},
        )


def _ignored_finding(document: Any, subject: str) -> Iterator[Finding]:
    if document.errors:
        yield IGNORED(
            subject,
            f"parts of the file were not understood: {_one_line(document.errors[0])}",
            hint="shapes are complete; a colour, camera or texture may be missing",
            data={"count": len(document.errors)},
        )


def _one_line(error: object) -> str:
    return " ".join(str(error).split())[:200]
