"""The points of a mesh file, where `init` must look at more than the description."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np

from assetbuild.errors import StepError
from assetbuild.mesh.companions import companions_of
from assetbuild.mesh.hull import refuse_flat
from assetbuild.mesh.material import SourceMesh
from assetbuild.mesh.read import Format, UpAxis, read_mesh
from assetbuild.robot.pose import Array
from assetbuild.robot.shapes import MeshFile

LARGEST = 16 << 20
"""A mesh of more bytes is left to the build, which reads it in a process of its own."""


def mesh_of(root: Path, mesh: MeshFile, up_axis: UpAxis = "ignore") -> SourceMesh | None:
    """What the file holds; None for one that the build would refuse, or that is too large.

    root: the folder that the mesh's path starts from.
    """
    path = root / mesh.path
    formats: dict[str, Format] = {f".{format}": format for format in get_args(Format)}
    format = formats.get(path.suffix.lower())
    try:
        if format is not None and path.stat().st_size <= LARGEST:
            data = path.read_bytes()
            names = companions_of(data, "gltf") if format == "gltf" else ()
            beside = {n: f.read_bytes() for n in names if (f := path.parent / n).is_file()}
            return read_mesh(data, format, companions=beside, up_axis=up_axis, subject=mesh.path)
    except (StepError, OSError):
        pass
    return None


def scaled_points(read: SourceMesh, mesh: MeshFile) -> Array:
    """(n, 3) m, of the points that a face uses."""
    used = [part.mesh.vertices[np.unique(part.mesh.faces)] for part in read.parts]
    points: Array = np.concatenate(used) * np.array(mesh.scale)
    return points


def is_flat(root: Path, mesh: MeshFile) -> bool:
    """Whether the mesh can be read and spans no volume."""
    read = mesh_of(root, mesh)
    if read is None:
        return False
    try:
        refuse_flat(scaled_points(read, mesh), mesh.path)
    except StepError:
        return True
    return False
