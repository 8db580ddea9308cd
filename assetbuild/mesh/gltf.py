"""GLB and glTF through trimesh: every triangle mesh where its nodes put it, pictures as PNG."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Mapping
from typing import Any, Literal
from urllib.parse import unquote

import numpy as np

from assetbuild.errors import StepError, one_line
from assetbuild.findings import Finding
from assetbuild.mesh.companions import relative_name
from assetbuild.mesh.material import (
    STRAY,
    Rgba,
    SourceMesh,
    SurfaceMaterial,
    group_by_material,
)
from assetbuild.mesh.picture import encoded
from assetbuild.mesh.triangles import TriangleMesh

# Any below: trimesh has no type hints.

LOOKS = re.compile("KHR_materials_|KHR_texture_|EXT_texture_|KHR_lights_|KHR_xmp")
"""Extensions that change no shape."""
TRIANGLES, FAN = 4, 6
"""Modes of a primitive."""


def read_gltf(
    data: bytes, format: Literal["glb", "gltf"], companions: Mapping[str, bytes], subject: str
) -> SourceMesh:
    """All triangle meshes of a scene, by material, and its pictures as PNG.

    companions: the buffers and pictures of a glTF, by `relative_name`. StepError for what is no
    glTF, for a buffer that is not there, and for a picture that is too large.
    """
    import trimesh

    files = _Files(companions)
    stray: list[Finding] = []
    whole = int.from_bytes(data[8:12], "little")
    if format == "glb" and data[:4] == b"glTF" and 12 < whole < len(data):
        excess = f"{len(data) - whole} bytes after the end of the file that its header states"
        stray.append(STRAY(subject, f"{excess} are left out", hint="save the file again"))
        data = data[:whole]
    try:
        scene: Any = trimesh.load_scene(
            io.BytesIO(data), file_type=format, process=False, resolver=files
        )
        # In the order of the file's meshes: the graph's own order is not stable.
        order = list(scene.geometry)
        nodes = sorted(scene.graph.nodes_geometry)
        nodes.sort(key=lambda node: order.index(scene.graph.get(node)[1]))
        length = int.from_bytes(data[12:16], "little")
        header = json.loads(data if format == "gltf" else data[20 : 20 + length])
        _refuse_unread(header, subject)
        materials = _Materials(header)
        placed = [_part(scene, node, materials) for node in nodes]
    except StepError:
        raise
    except Exception as error:  # trimesh's reader raises many kinds on broken files
        if files.missing and isinstance(error, KeyError):
            lost = f"{subject}: its buffer `{files.missing[-1]}` is not in the source"
            raise StepError(lost, hint="copy or clone all of the source") from error
        reason = f"{type(error).__name__}: {one_line(error)}"
        raise StepError(f"{subject}: not readable as {format}: {reason}") from error
    parts = group_by_material(part for part in placed if part is not None)
    kinds = {getattr(g, "visual", None) and g.visual.kind for g in scene.geometry.values()}
    coloured = bool(kinds & {"vertex", "face"})
    # Y_UP by definition.
    return SourceMesh(parts, tuple(stray), materials.pictures, "Y_UP", coloured)


def _refuse_unread(header: Any, subject: str) -> None:
    """What trimesh leaves out, or reads as something else, without a word."""
    needed = [name for name in header.get("extensionsRequired", ()) if not LOOKS.match(name)]
    if needed:
        raise StepError(
            f"{subject}: it needs the glTF extension `{needed[0]}`, which is not read",
            hint="export the mesh without compression",
        )
    for mesh in header.get("meshes", ()):
        for primitive in mesh.get("primitives", ()):
            if primitive.get("mode", TRIANGLES) == FAN:
                raise StepError(
                    f"{subject}: mesh `{mesh.get('name', '')}` holds a triangle fan, which is not "
                    "read",
                    hint="export triangles",
                )


class _Files(dict[str, bytes]):
    """What trimesh asks for other files of a glTF; it looks nowhere else."""

    def __init__(self, files: Mapping[str, bytes]) -> None:
        super().__init__(files)
        self.missing: list[str] = []

    def __getitem__(self, name: str) -> bytes:
        content = self.get(relative_name(unquote(name)) or "")
        if content is None:
            self.missing.append(name)
            raise KeyError(name)
        return content


def _shown(linear: float) -> float:
    """One component of a colour as screens and pictures have it (sRGB, IEC 61966-2-1).

    glTF states the light itself: the specification calls the factors linear.
    """
    curved = 1.055 * linear ** (1.0 / 2.4) - 0.055
    return round(12.92 * linear if linear <= 0.0031308 else curved, 6)


class _Materials:
    """Materials of a scene, and the pictures that they use, each once."""

    def __init__(self, header: Any) -> None:
        # Those that state a picture: trimesh is silent where it cannot read one.
        self._textured = {
            str(material.get("name"))
            for material in header.get("materials", ())
            if "baseColorTexture" in material.get("pbrMetallicRoughness", {})
        }
        self.pictures: dict[str, bytes] = {}

    def of(self, source: Any) -> SurfaceMaterial:
        """Name, base colour (white where only a picture is stated) and picture."""
        if source is None:
            return SurfaceMaterial()
        name = getattr(source, "name", None) or None
        image = getattr(source, "baseColorTexture", None)
        factor = getattr(source, "baseColorFactor", None)
        texture = self._picture(image, name or "texture")
        rgba: Rgba | None = None
        if factor is not None:
            r, g, b, a = (float(v) / 255.0 for v in factor)
            rgba = (_shown(r), _shown(g), _shown(b), round(a, 6))
        elif texture is not None:
            rgba = (1.0, 1.0, 1.0, 1.0)
        return SurfaceMaterial(name, rgba, texture)

    def _picture(self, image: Any, name: str) -> str | None:
        """The name of the picture; one that is not among `pictures` is reported as lost."""
        if image is None:
            return name if name in self._textured else None
        try:
            png = encoded(image, name)
        except ValueError:
            return name
        for number in range(len(self.pictures) + 1):
            key = f"{name}_{number}.png" if number else f"{name}.png"
            if self.pictures.setdefault(key, png) == png:
                return key
        raise AssertionError("one of the names is free")


def _part(
    scene: Any, node: str, materials: _Materials
) -> tuple[SurfaceMaterial, TriangleMesh] | None:
    matrix, name = scene.graph.get(node)
    geometry = scene.geometry[name]
    if not hasattr(geometry, "faces"):
        return None  # points and lines
    visual = getattr(geometry, "visual", None)
    faces = np.asarray(geometry.faces, dtype=np.int64)
    uv = getattr(visual, "uv", None)
    # What the file states; the property would make up smooth ones where it states none.
    normals = geometry._cache.cache.get("vertex_normals")
    mesh = TriangleMesh(
        np.asarray(geometry.vertices, dtype=np.float64),
        faces,
        None if uv is None else np.asarray(uv, dtype=np.float64)[faces],
        None if normals is None else np.asarray(normals, dtype=np.float64)[faces],
    )
    return materials.of(getattr(visual, "material", None)), mesh.mapped(
        matrix[:3, :3], matrix[:3, 3]
    )
