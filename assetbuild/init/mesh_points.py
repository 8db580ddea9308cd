"""The points of a mesh file, where `init` must look at more than the description."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np

from assetbuild.errors import StepError
from assetbuild.mesh.hull import refuse_flat
from assetbuild.mesh.read import Format, SourceMesh, read_mesh
from assetbuild.robot.model import Mesh
from assetbuild.robot.pose import Array

LARGEST = 16 << 20
"""A mesh of more bytes is left to the build, which reads it in a process of its own."""


def mesh_of(root: Path, mesh: Mesh) -> SourceMesh | None:
    """What the file holds; None for one that the build would refuse, or that is too large.

    root: the folder that the mesh's path starts from.
    """
    path = root / mesh.mesh
    formats: dict[str, Format] = {f".{format}": format for format in get_args(Format)}
    format = formats.get(path.suffix.lower())
    try:
        if format is not None and path.stat().st_size <= LARGEST:
            return read_mesh(path.read_bytes(), format)
    except (StepError, OSError):
        pass
    return None


def scaled_points(read: SourceMesh, mesh: Mesh) -> Array:
    """(n, 3) m, of the points that a face uses."""
    used = [part.mesh.vertices[np.unique(part.mesh.faces)] for part in read.parts]
    points: Array = np.concatenate(used) * np.array(mesh.scale)
    return points


def is_flat(root: Path, mesh: Mesh) -> bool:
    """Whether the mesh can be read and spans no volume."""
    read = mesh_of(root, mesh)
    if read is None:
        return False
    try:
        refuse_flat(np.unique(scaled_points(read, mesh), axis=0), mesh.mesh)
    except StepError:
        return True
    return False
