"""Meshes and pictures of a compiled MuJoCo model, each measured once."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Collection

import numpy as np

from assetbuild.facts.mjcf_copies import Copies
from assetbuild.facts.surface import Surface, measure
from assetbuild.robot.pose import Pose, normalised_quat, vec3
from assetbuild.simulators.mujoco import Model, name_of


class Meshes:
    """The meshes of a model in their own frames.

    copies: what its files hold that were left out. stated: meshes whose files state normals; of
    the others MuJoCo makes its own. by_area: see `measure`; float32 may take a triangle its area.
    """

    def __init__(
        self,
        model: Model,
        copies: Copies | None = None,
        stated: Collection[str] = (),
        *,
        by_area: bool = False,
    ) -> None:
        self._model, self._copies, self._stated = model, copies or Copies(), stated
        self._by_area = by_area

    @functools.cache  # noqa: B019 # lives as long as one reading
    def of(self, mesh: int) -> Surface:
        """Corners of all triangles, with texture coordinates and normals where it has them."""
        model, name = self._model, name_of(self._model, "mesh", mesh)
        if name in self._copies.surfaces:
            X_file_mesh = pose_of(model.mesh_pos[mesh], model.mesh_quat[mesh])
            return self._copies.surfaces[name].moved(X_file_mesh.inverse())
        first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        faces = slice(first, first + count)
        vertices = model.mesh_vert[int(model.mesh_vertadr[mesh]) :]
        uv, normals, start = None, None, int(model.mesh_texcoordadr[mesh])
        if start >= 0:
            uv = model.mesh_texcoord[start:][model.mesh_facetexcoord[faces]]
            uv = np.stack([uv[..., 0], 1.0 - uv[..., 1]], axis=-1)  # MuJoCo counts v downwards
        if name in self._stated:
            own = model.mesh_normal[int(model.mesh_normaladr[mesh]) :]
            normals = own[model.mesh_facenormal[faces]]
        corners = np.asarray(vertices, dtype=np.float64)[model.mesh_face[faces]]
        # The build drops triangles that use one vertex twice: they have no area.
        a, b, c = model.mesh_face[faces].T
        whole = (a != b) & (b != c) & (c != a)
        uv = None if uv is None else uv[whole]
        normals = None if normals is None else normals[whole]
        return measure(corners[whole], uv, normals, by_area=self._by_area)

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
