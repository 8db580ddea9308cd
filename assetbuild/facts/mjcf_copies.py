"""Meshes and pictures of an MJCF that MuJoCo need not read: copies of the robot's own files.

What MuJoCo makes of the robot's files is proved once, by the check `mjcf_compiles`. Of a copy with
the same bytes only the use is left to be proved.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from assetbuild.facts.known_files import KnownFiles
from assetbuild.facts.mjcf_words import Spec
from assetbuild.facts.surface import Surface

CORNERS = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
FACES = (0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3)
"""A tetrahedron: the smallest mesh that MuJoCo takes."""


RGBA = 6
"""Byte 25 of a PNG: its pixels have an alpha channel, which MuJoCo reads with `nchannel="4"`."""


@dataclass(frozen=True)
class Copies:
    """What the files hold that were left out: by name of the mesh, and of the texture.

    A surface is in the frame of its file; pixels are the digest of a picture's pixels.
    """

    surfaces: Mapping[str, Surface] = field(default_factory=dict)
    pixels: Mapping[str, str] = field(default_factory=dict)


def leave_out_copies(spec: Spec, known: KnownFiles) -> Copies:
    """Put a tetrahedron or a single pixel in place of each copy that has no effect on motion."""
    surfaces, pixels = {}, {}
    folder = Path(spec.modelfiledir)
    acting = _acting(spec)
    for mesh in spec.meshes:
        if mesh.name in acting or not mesh.file or not _is_plain(mesh):
            continue
        surface = known.surface((folder / spec.compiler.meshdir / mesh.file).read_bytes())
        if surface is not None:
            surfaces[mesh.name] = surface
            mesh.file, mesh.uservert, mesh.userface = "", CORNERS, FACES
    for texture in spec.textures:
        if not texture.file:
            continue
        data = (folder / spec.compiler.texturedir / texture.file).read_bytes()
        digest = known.picture(data)
        if digest is not None and texture.nchannel == (4 if data[25] == RGBA else 3):
            pixels[texture.name] = digest
            texture.file, texture.width, texture.height, texture.nchannel = "", 1, 1, 3
            texture.builtin = type(texture.builtin).mjBUILTIN_FLAT
    return Copies(surfaces, pixels)


def _acting(spec: Spec) -> set[str]:
    """Meshes that may touch something, or that give their body its mass."""
    weighs = int(spec.compiler.inertiafromgeom) == 1
    return {
        geom.meshname
        for geom in spec.geoms
        if geom.contype or geom.conaffinity or weighs or not geom.parent.explicitinertial
        or geom.type.name != "mjGEOM_MESH"
    }  # fmt: skip


def _is_plain(mesh: Spec) -> bool:
    """Whether nothing but its file says what it is."""
    moved = mesh.scale.tolist(), mesh.refpos.tolist(), mesh.refquat.tolist()
    unmoved = [1.0, 1.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
    return moved == unmoved and not len(mesh.uservert) and not mesh.content_type
