"""Meshes on their way through the graph: arrays, which are read much faster than text.

A bundle holds OBJ text. It is written once, when a mesh has its final shape.
"""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from assetbuild.errors import StepError
from assetbuild.mesh.obj import obj_bytes, read_triangles
from assetbuild.mesh.triangles import TriangleMesh

SUFFIX = ".npz"


def array_bytes(mesh: TriangleMesh) -> bytes:
    """The arrays of a mesh as an npz file; zeros have no sign, as in OBJ text."""
    tables = {"vertices": mesh.vertices, "uv": mesh.uv, "normals": mesh.normals}
    arrays: dict[str, Any] = {"faces": mesh.faces}  # Any: `savez` has other keywords, too
    arrays |= {name: table + 0.0 for name, table in tables.items() if table is not None}
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def read_part(path: Path, subject: str = "mesh") -> TriangleMesh:
    """A part of a converted mesh, arrays or OBJ. StepError where the file is neither."""
    if path.suffix != SUFFIX:
        return read_triangles(path.read_bytes(), subject)
    try:
        with np.load(path, allow_pickle=False) as file:
            return TriangleMesh(
                file["vertices"], file["faces"], file.get("uv"), file.get("normals")
            )
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise StepError(f"{subject}: `{path.name}` holds no mesh: {error}") from error


def obj_of(path: Path, subject: str = "mesh") -> bytes:
    """A part of a converted mesh as OBJ text."""
    return obj_bytes(read_part(path, subject)) if path.suffix == SUFFIX else path.read_bytes()
