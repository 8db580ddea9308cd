"""Meshes and pictures of a compiled MuJoCo model, each measured once."""

from __future__ import annotations

import functools
import hashlib

import numpy as np

from assetbuild.facts.surface import Surface, measure
from assetbuild.robot.pose import Pose, normalised_quat, vec3
from assetbuild.simulators.mujoco import Model


class Meshes:
    """The meshes of a model in their own frames.

    by_area: see `measure`; float32 may take a triangle its area.
    """

    def __init__(self, model: Model, *, by_area: bool = False) -> None:
        self._model, self._by_area = model, by_area

    @functools.cache  # noqa: B019 # lives as long as one reading
    def of(self, mesh: int) -> Surface:
        """Corners of all triangles, with texture coordinates where it has them."""
        model = self._model
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
        model = self._model
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
