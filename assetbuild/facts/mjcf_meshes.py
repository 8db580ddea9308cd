"""Meshes and pictures of a compiled MuJoCo model, each measured once.

MuJoCo need not read copies of the robot's own files: what it makes of these is proved once, by the
reader of the full MJCF. Of a copy with the same bytes only the use is left to be proved.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from assetbuild.facts.known_files import KnownFiles
from assetbuild.facts.surface import Surface, measure
from assetbuild.robot.pose import Pose, normalised_quat, vec3
from assetbuild.simulators.mujoco import Model, name_of

Spec = Any  # mujoco.MjSpec, whose extension module has no types

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


class Meshes:
    """The meshes of a model in their own frames.

    copies: what its files hold that were left out. by_area: see `measure`; float32 may take a
    triangle its area.
    """

    def __init__(
        self, model: Model, copies: Copies | None = None, *, by_area: bool = False
    ) -> None:
        self._model, self._copies, self._by_area = model, copies or Copies(), by_area

    @functools.cache  # noqa: B019 # lives as long as one reading
    def of(self, mesh: int) -> Surface:
        """Corners of all triangles, with texture coordinates where it has them."""
        model, name = self._model, name_of(self._model, "mesh", mesh)
        if name in self._copies.surfaces:
            X_file_mesh = pose_of(model.mesh_pos[mesh], model.mesh_quat[mesh])
            return self._copies.surfaces[name].moved(X_file_mesh.inverse())
        first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        faces = slice(first, first + count)
        vertices = model.mesh_vert[int(model.mesh_vertadr[mesh]) :]
        uv, start = None, int(model.mesh_texcoordadr[mesh])
        if start >= 0:
            uv = model.mesh_texcoord[start:][model.mesh_facetexcoord[faces]]
            uv = np.stack([uv[..., 0], 1.0 - uv[..., 1]], axis=-1)  # MuJoCo counts v downwards
        corners = np.asarray(vertices, dtype=np.float64)[model.mesh_face[faces]]
        # The build drops triangles that use one vertex twice: they have no area.
        a, b, c = model.mesh_face[faces].T
        whole = (a != b) & (b != c) & (c != a)
        uv = None if uv is None else uv[whole]
        return measure(corners[whole], uv, by_area=self._by_area)

    @functools.cache  # noqa: B019 # as above
    def pixels(self, texture: int) -> str:
        """Digest of size and RGBA pixels."""
        model, name = self._model, name_of(self._model, "texture", texture)
        if name in self._copies.pixels:
            return self._copies.pixels[name]
        height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
        channels, start = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
        data = np.asarray(model.tex_data[start : start + height * width * channels])
        picture = data.reshape(height, width, channels).astype(np.uint8)
        if channels == 3:
            opaque = np.full((height, width, 1), 255, dtype=np.uint8)
            picture = np.concatenate([picture, opaque], axis=2)
        held = hashlib.sha256(repr((width, height)).encode() + picture.tobytes())
        return held.hexdigest()[:16]


def pose_of(xyz: object, quat: object) -> Pose:
    """Return the pose that MuJoCo's arrays hold."""
    w, x, y, z = (float(v) for v in np.asarray(quat, dtype=np.float64))
    return Pose(vec3(np.asarray(xyz, dtype=np.float64)), normalised_quat((w, x, y, z)))


# --- copies -------------------------------------------------------------------------------------


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
