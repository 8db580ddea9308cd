"""Meshes as arrays, several in one file: how they travel between steps.

Arrays are read much faster than text; a bundle holds OBJ text, which is written once, when a mesh
has its final shape.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from assetbuild.mesh.triangles import TriangleMesh

PARTS = "parts/meshes.npz"
"""The meshes of a converted file, one per material, below the folder of its step."""
TABLES = {"vertices": (3,), "faces": (3,), "uv": (3, 2), "normals": (3, 3)}
"""Arrays of a mesh in one of these files, and the shape of a row."""


def write_meshes(file: Path, meshes: Mapping[str, TriangleMesh]) -> None:
    """Write meshes by name, in their order; zeros have no sign, as in OBJ text."""
    tables = {key: [getattr(mesh, key) for mesh in meshes.values()] for key in TABLES}
    sizes = [[0 if table is None else len(table) for table in arrays] for arrays in tables.values()]
    joined: dict[str, Any] = {  # Any: `savez` has other keywords, too
        key: np.concatenate([np.zeros((0, *TABLES[key])), *(t for t in arrays if t is not None)])
        + 0.0
        for key, arrays in tables.items()
    }
    joined["faces"] = joined["faces"].astype(np.int32)
    names, counts = np.array([*meshes], dtype=np.str_), np.array(sizes, dtype=np.int64)
    np.savez(file, names=names, sizes=counts, **joined)


def read_meshes(file: Path, *, surface: bool = False) -> dict[str, TriangleMesh]:
    """Each mesh by name. surface: with texture coordinates and normals."""
    keys = [*TABLES] if surface else ["vertices", "faces"]
    with np.load(file) as stored:
        names = stored["names"].tolist()
        ends = np.cumsum(stored["sizes"], axis=1)[:, :-1]
        columns = [np.split(stored[key], at) for key, at in zip(keys, ends, strict=False)]
    return {
        name: TriangleMesh(vertices, faces.astype(np.int64), *(t if len(t) else None for t in more))
        for name, vertices, faces, *more in zip(names, *columns, strict=False)
    }
