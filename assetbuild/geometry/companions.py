"""The files that meshes name: material libraries, pictures, buffers. Asked, then declared."""

from __future__ import annotations

import json
import posixpath
from collections.abc import Iterable, Mapping
from typing import get_args

from assetbuild.engine.graph import Ref
from assetbuild.engine.planner import Planner
from assetbuild.geometry.mesh_companions import MeshCompanions
from assetbuild.mesh.companions import Naming, format_of
from assetbuild.source.plan import SourceFiles

Companions = Mapping[str, Mapping[str, Ref]]
"""Path of a mesh -> name from the mesh's folder -> file. What the source lacks is not in it."""


def companions(files: Mapping[str, Ref], source: SourceFiles, p: Planner) -> Companions | None:
    """What every mesh names and the source has; None while a question is open.

    A material library names pictures in its turn; what those are called from the mesh's folder
    is what `convert_mesh` looks for.
    """
    named = _named(files, p)
    if named is None:
        return None
    first = source.present("mesh companions", _all(named))
    if first is None:
        return None
    libraries = {path: ref for path, ref in first.items() if format_of(path) == "mtl"}
    pictures = _named(libraries, p)
    if pictures is None:
        return None
    second = source.present("library pictures", _all(pictures) - set(first))
    if second is None:
        return None
    found = {**first, **second}
    return {
        mesh: {
            posixpath.relpath(path, posixpath.dirname(mesh) or "."): found[path]
            for name in names
            for path in (name, *pictures.get(name, ()))
            if path in found
        }
        for mesh, names in named.items()
    }


def _named(files: Mapping[str, Ref], p: Planner) -> dict[str, tuple[str, ...]] | None:
    """Path of each file -> paths below the source's root that it names."""
    nodes = {
        path: p.add(f"mesh_companions {path}", MeshCompanions(format=kind), {"mesh": ref})
        for path, ref in files.items()
        if (kind := format_of(path)) in get_args(Naming)
    }
    answers = {path: p.ask(node["companions.json"]) for path, node in nodes.items()}
    named: dict[str, tuple[str, ...]] = {}
    for path, answer in answers.items():
        if answer is None:
            return None
        folder = posixpath.dirname(path)
        paths = (posixpath.normpath(posixpath.join(folder, n)) for n in json.loads(answer))
        # What leads out of the source is not followed; `convert_mesh` says that it is not there.
        named[path] = tuple(path for path in paths if not path.startswith("../"))
    return named


def _all(named: Mapping[str, Iterable[str]]) -> set[str]:
    return {path for paths in named.values() for path in paths}
