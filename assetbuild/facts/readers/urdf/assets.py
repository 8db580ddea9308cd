"""The meshes and pictures that a URDF names."""

from __future__ import annotations

import hashlib
import posixpath
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from assetbuild.errors import AssetBuildError
from assetbuild.facts.known_files import KnownFiles
from assetbuild.facts.picture import pixel_digest
from assetbuild.facts.sketch import SKETCH, sketch_of
from assetbuild.facts.surface import Surface, measure
from assetbuild.facts.table import Value, Writer
from assetbuild.mesh.companions import companions_of, format_of, picture_of_map, relative_name
from assetbuild.mesh.obj import read_triangles
from assetbuild.mesh.read import Format, read_mesh
from assetbuild.robot.pose import Array, Pose

PLAIN = frozenset((b"", b"v", b"vt", b"vn", b"f"))
"""Lines of an OBJ that are a surface."""
NO_FACTS = frozenset((b"o", b"g", b"s", b"#"))
"""Groups and comments name things that nobody looks up."""
UNSCALED = (1.0, 1.0, 1.0)
LOOKS = frozenset((b"mtllib", b"usemtl"))
HEAD = re.compile(rb"(?:[ \t]*(?:#|mtllib|usemtl|o|g)\b[^\n]*\n)*")


class Assets:
    """Files below the folder of a URDF, each read once."""

    def __init__(self, folder: Path, book: Writer, known: KnownFiles) -> None:
        self.folder = folder
        self._book, self._known = book, known
        self._meshes: dict[str, tuple[Array, Array | None, Array | None]] = {}
        self._looks: dict[str, dict[str, Value]] = {}
        self._copies: dict[str, Surface | None] = {}
        self._pixels: dict[str, str] = {}

    def find(self, stated: str) -> Path | None:
        """The file behind a name; None of one that lies elsewhere: `package://`, absolute."""
        name = relative_name(stated)
        path = self.folder / name if name is not None else None
        return path if path is not None and path.is_file() else None

    def mesh_facts(self, stated: str, scale: tuple[float, ...], pose: Pose) -> dict[str, Value]:
        """The surface of a mesh at its place in the link.

        What cannot be read is a word: the name of the file, or what is wrong with it.
        """
        path = self.find(stated)
        if path is None:
            return {"geometry": "mesh", "urdf:missing mesh": stated}
        try:
            surface = self._surface(stated, path, scale, pose)
        except AssetBuildError as error:
            return {"geometry": "mesh", "urdf:unreadable mesh": f"{stated}: {error.message}"}
        facts = {"geometry": "mesh"} | surface.facts()
        if surface.normals:
            facts["urdf:normals"] = surface.normals
        facts[f"urdf:{SKETCH}"] = surface.sketch
        if format_of(stated) != "obj":
            facts["urdf:mesh file"] = _digest(path)  # with its colours, names and normals
        return facts

    def mesh_looks(self, stated: str) -> dict[str, Value]:
        """Colour and picture by which a viewer draws the mesh: of the MTL beside an OBJ."""
        return self._looks.get(stated, {})

    def picture(self, stated: str) -> dict[str, Value]:
        """The pixels of a texture."""
        path = self.find(stated)
        if path is None:
            return {"urdf:missing texture": stated}
        if stated not in self._pixels:
            self._pixels[stated] = pixel_digest(path, self._known)
        digest = self._pixels[stated]
        return {"texture": digest} if digest else {"urdf:unreadable texture": True}

    def _surface(self, stated: str, path: Path, scale: tuple[float, ...], pose: Pose) -> Surface:
        if scale == UNSCALED and (known := self._known_surface(stated, path)) is not None:
            return known.moved(pose)
        corners, uv, normals = self._read(stated, path)
        sketch = sketch_of(corners, uv, normals)
        placed = pose.apply(corners * np.asarray(scale))
        if np.prod(scale) < 0.0:  # a mirror image: its triangles turn the other way
            placed, uv = placed[:, ::-1], None if uv is None else uv[:, ::-1]
        if normals is not None:
            normals = normals / np.asarray(scale) @ pose.rotation.T
        return replace(measure(placed, uv, normals), sketch=sketch)

    def _known_surface(self, stated: str, path: Path) -> Surface | None:
        """That of the robot's mesh whose OBJ this is, after the lines that name materials."""
        if format_of(stated) != "obj":
            return None
        if stated not in self._copies:
            data = path.read_bytes()
            start = _end_of_head(data)
            self._copies[stated] = self._known.surface(data[start:])
            if self._copies[stated] is not None:
                self._take_words(stated, data[:start])
        return self._copies[stated]

    def _read(self, stated: str, path: Path) -> tuple[Array, Array | None, Array | None]:
        """(n, 3, 3) corners in the file's own frame, (n, 3, 2) texture coordinates, normals."""
        if stated not in self._meshes:
            data, format = path.read_bytes(), format_of(stated)
            if format == "obj":
                self._meshes[stated] = self._read_obj(stated, data)
            else:
                beside = {}
                if format == "gltf":
                    names = companions_of(data, "gltf")
                    files = {name: path.parent / name for name in names}
                    beside = {n: file.read_bytes() for n, file in files.items() if file.is_file()}
                known = cast(Format, format)  # read_mesh refuses what it does not know
                mesh = read_mesh(data, known, companions=beside, subject=stated)
                self._meshes[stated] = (
                    np.concatenate([p.mesh.corners for p in mesh.parts]),
                    None,
                    None,
                )
        return self._meshes[stated]

    def _read_obj(self, stated: str, data: bytes) -> tuple[Array, Array | None, Array | None]:
        start = _end_of_head(data)
        plain = set(data[start:].translate(None, b"0123456789.-+eE/ \t\r").split(b"\n")) <= PLAIN
        self._take_words(stated, data[:start] if plain else data)  # none among the numbers
        mesh = read_triangles(data[start:], stated)
        return mesh.corners, mesh.uv, mesh.normals

    def _take_words(self, stated: str, text: bytes) -> None:
        """Looks, and what has no meaning here, of the lines of an OBJ that are no surface."""
        for word in sorted(set(re.findall(rb"(?m)^[ \t]*([^\s\d]+)", text))):
            if word not in PLAIN | NO_FACTS | LOOKS and not word.startswith(b"#"):
                self._book.skip(stated, "an element of the OBJ", word.decode("utf-8", "replace"))
        self._looks[stated] = self._obj_looks(stated, text)

    def _obj_looks(self, stated: str, data: bytes) -> dict[str, Value]:
        worn = re.findall(rb"(?m)^[ \t]*usemtl[ \t]+([^\r\n]+)", data)
        known: dict[str, dict[str, Value]] = {}
        for library in companions_of(data, "obj"):
            name = posixpath.join(posixpath.dirname(stated), library)
            path = self.find(name)
            if path is None:
                known[""] = {"missing library": library}
            else:
                known |= self._library(name, path.read_text("utf-8", "replace"))
        found = dict(known.get("", {}))
        for number, word in enumerate(dict.fromkeys(worn), start=1):
            look = known.get(word.decode("utf-8", "replace").strip(), {})
            found |= {f"{key} {number}" if number > 1 else key: v for key, v in look.items()}
        return {f"urdf:mesh {key}": value for key, value in found.items()}

    def _library(self, name: str, text: str) -> dict[str, dict[str, Value]]:
        """Looks by material of an MTL file; what else it says of one is unread."""
        looks: dict[str, dict[str, Value]] = {}
        look: dict[str, Value] = {}
        for number, line in enumerate(text.splitlines(), start=1):
            key, _, rest = line.strip().partition(" ")
            if key == "newmtl":
                look = looks.setdefault(rest.strip(), {})
            elif key in ("Kd", "d"):
                look["colour" if key == "Kd" else "opacity"] = _plain_numbers(rest)
            elif key == "map_Kd":
                picture = posixpath.join(posixpath.dirname(name), picture_of_map(rest))
                look |= {k.removeprefix("urdf:"): v for k, v in self.picture(picture).items()}
            elif key and not key.startswith("#"):
                self._book.skip(f"{name}:{number}", f"`{key}` of a material", rest)
        return looks


def _end_of_head(data: bytes) -> int:
    head = HEAD.match(data)
    return head.end() if head else 0


def _plain_numbers(text: str) -> Value:
    try:
        return tuple(float(word) for word in text.split())
    except ValueError:
        return text


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def pixels_of(digest: str | None) -> dict[str, Value]:
    """What a texture must be, as `Assets.picture` finds it; None: no picture in the source."""
    return {"texture": digest} if digest else {"urdf:unreadable texture": True}


def looks_of(rgba: tuple[float, ...], digest: str | None) -> Mapping[str, Value]:
    """What the MTL beside a mesh must say of a material with a texture."""
    pixels = {f"urdf:mesh {k.removeprefix('urdf:')}": v for k, v in pixels_of(digest).items()}
    return {"urdf:mesh colour": tuple(rgba[:3]), "urdf:mesh opacity": (rgba[3],), **pixels}
