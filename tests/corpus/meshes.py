"""A mesh file, read by us and by assimp."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from assetbuild.errors import StepError
from assetbuild.mesh.companions import companions_of, format_of
from assetbuild.mesh.read import read_mesh
from corpus.assimp import Measured, measured, polygons_measured


def compared(path: Path) -> tuple[str, str]:
    """(`same`, `differs`, `we refuse`, `assimp refuses` or `both refuse`; in words)."""
    ours, why = _or_error(ours_measured, path)
    theirs, why_not = _or_error(measured, path)
    if ours is None or theirs is None:
        both = ours is None and theirs is None
        who = "both refuse" if both else "we refuse" if ours is None else "assimp refuses"
        return who, f"{why or why_not}"
    words = ours.unlike(theirs)
    return ("differs", words) if words else ("same", "")


def ours_measured(path: Path) -> Measured:
    data, format = path.read_bytes(), format_of(path.name)
    names = companions_of(data, "gltf") if format == "gltf" else ()
    beside = {n: (path.parent / n).read_bytes() for n in names if (path.parent / n).is_file()}
    mesh = read_mesh(data, format, companions=beside, subject=path.name)  # type: ignore[arg-type]
    corners = np.concatenate([part.mesh.corners.reshape(-1, 3) for part in mesh.parts])
    return polygons_measured(corners, np.full(len(corners) // 3, 3))


def _or_error(read, path: Path) -> tuple[Measured | None, str]:
    try:
        return read(path), ""
    except (StepError, ValueError) as error:
        return None, str(error).splitlines()[0]
