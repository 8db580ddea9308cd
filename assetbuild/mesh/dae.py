"""COLLADA through pycollada: every surface of the scene, where its nodes put it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any
from urllib.parse import unquote

import numpy as np

from assetbuild.errors import StepError, one_line
from assetbuild.findings import Finding, Rule, Severity
from assetbuild.mesh.companions import relative_name
from assetbuild.mesh.dae_text import load
from assetbuild.mesh.material import SourceMesh, SurfaceMaterial, group_by_material
from assetbuild.mesh.triangles import Indices, TriangleMesh, polygon_triangles
from assetbuild.robot.pose import Array

SKIPPED = Rule(
    "mesh.skipped",
    ("info", "warning"),
    "lines, points or empty parts were left out (a warning for skins and for what is absent)",
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

MISSED = {"skins", "splines or hulls", "instances of geometry that the file lacks"}
"""What somebody may miss who looks at the robot."""


def read_dae(data: bytes, subject: str) -> SourceMesh:
    """All triangles and polygons of a COLLADA file, by material, in its own axes, nodes applied.

    Raises StepError with the line of a cut-off or broken file, for a geometry that cannot be
    read, and for NaN in positions (which pycollada would turn into zeros).
    """
    document, findings, skipped = load(data, subject)
    placed: list[tuple[SurfaceMaterial, TriangleMesh]] = []
    positions: dict[int, Array] = {}
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
    if not placed and "skins" in skipped:
        raise StepError(
            f"{subject}: all its surfaces are skins on a skeleton that does not hold them where "
            "they lie, which readers show in different places",
            hint="apply the armature before the mesh is exported",
        )
    unit = document.assetInfo.unitmeter if document.assetInfo is not None else None
    if unit is not None and unit != 1.0:
        scale = (float(unit),) * 3
        placed = [(material, mesh.scaled(scale)) for material, mesh in placed]
    if document.cameras:
        skipped["cameras"] = len(document.cameras)
    return SourceMesh(
        group_by_material(placed),
        (*findings, *_findings(document, skipped, unit, subject)),
        # The standard's default, Y_UP, when the asset does not say.
        up_axis=document.assetInfo.upaxis if document.assetInfo is not None else None,
        coloured=coloured,
    )


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
            skin = node.controller
            # Readers agree on a skin that stands where its skeleton holds it: all joints at rest.
            if np.allclose(getattr(skin, "bind_shape_matrix", 0.0), matrix, atol=1e-6):
                yield skin.geometry, {m.symbol: m.target for m in node.materials}, matrix
            else:
                skipped["skins"] = skipped.get("skins", 0) + 1
        target = getattr(node, "node", node)  # an instance_node points to a library node
        for transform in getattr(target, "transforms", ()):
            # A look-at places a camera; as a node above a mesh it has a matrix like the others.
            matrix = matrix @ _stated(transform.matrix)
        stack.extend((child, matrix) for child in reversed(getattr(target, "children", ())))


def _stated(values: Any) -> Array:
    """float32 numbers as the decimal numbers that the text says, as far as float32 tells."""
    return np.asarray(np.asarray(values, dtype=np.float32).astype(str), dtype=np.float64)


def _triangles(primitive: Any, positions: dict[int, Array], subject: str) -> TriangleMesh:
    """One primitive's triangles in the frame of its geometry; polygons are cut into triangles."""
    index = primitive.vertex_index
    if primitive.vertex is None or index is None or not len(primitive.index):
        return TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    vertices = _positions(primitive, positions, subject)
    corners = _index(index, len(vertices), "position", subject)
    if hasattr(primitive, "vcounts"):
        counts = np.asarray(primitive.vcounts, dtype=np.int64)
        if (counts < 0).any() or counts.sum() != len(corners):
            raise StepError(
                f"{subject}: its polygons have {counts.sum()} corners, there are {len(corners)}"
            )
        cut = polygon_triangles(counts, vertices[corners])
    else:
        cut = np.arange(len(corners)).reshape(-1, 3)
    uv = normals = None
    if primitive.texcoordset:
        table = np.asarray(primitive.texcoordset[0], dtype=np.float64)[:, :2]
        uv = table[_index(primitive.texcoord_indexset[0], len(table), "texture", subject)[cut]]
    if primitive.normal is not None:
        table = np.asarray(primitive.normal, dtype=np.float64)
        normals = table[_index(primitive.normal_index, len(table), "normal", subject)[cut]]
    return TriangleMesh(vertices, corners[cut], uv, normals)


def _positions(primitive: Any, cache: dict[int, Array], subject: str) -> Array:
    """(n, 3) float64 from the text itself: pycollada rounds to float32 and turns NaN into 0.

    cache: by the identity of the source; ids are repeated in the geometries of some files.
    """
    source = primitive.sources["VERTEX"][0][4]
    if id(source) in cache:
        return cache[id(source)]
    rounded = np.asarray(source.data, dtype=np.float64)
    text = next((n.text for n in source.xmlnode if n.tag.endswith("float_array")), None) or ""
    values = np.fromstring(text, dtype=np.float64, sep=" ") if text.strip() else np.zeros(0)
    out = values.reshape(rounded.shape) if values.size == rounded.size else rounded
    if not np.isfinite(out).all():
        row = int(np.argmin(np.isfinite(out).all(axis=1)))
        raise StepError(f"{subject}: vertex {row} of `{source.id}` is not a finite number")
    if out.shape[1] != 3:
        raise StepError(f"{subject}: positions of `{source.id}` have {out.shape[1]} components")
    cache[id(source)] = out
    return out


def _index(values: Any, size: int, what: str, subject: str) -> Indices:
    index = np.asarray(values, dtype=np.int64).reshape(-1)
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


def _findings(
    document: Any, skipped: Mapping[str, int], unit: float | None, subject: str
) -> Iterator[Finding]:
    if skipped:
        names = ", ".join(f"{count} {name}" for name, count in sorted(skipped.items()))
        severity: Severity = "warning" if MISSED & set(skipped) else "info"
        message, data = f"not surfaces, left out: {names}", dict(sorted(skipped.items()))
        yield SKIPPED(subject, message, severity=severity, data=data)
    if unit is not None and unit != 1.0:
        message = f"the file's unit is {unit:g} m; it is applied, as viewers do"
        yield UNIT(subject, message, data={"unit_m": float(unit)})
    if document.errors:
        message = f"parts of the file were not understood: {one_line(document.errors[0])}"
        hint = "shapes are complete; a colour, camera or texture may be missing"
        yield IGNORED(subject, message, hint, data={"count": len(document.errors)})
