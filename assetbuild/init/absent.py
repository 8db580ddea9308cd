"""What a recipe can do about mesh files that are not where the URDF says, and refused words."""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

from assetbuild.engine.scratch import scratch
from assetbuild.errors import SourceError, Where, nearest
from assetbuild.init.file_names import elsewhere
from assetbuild.init.packages import files_named, is_file, lacking
from assetbuild.init.patches import patched, retyped, shortened
from assetbuild.init.source import UrdfSource
from assetbuild.init.words import some
from assetbuild.recipe.source import Patch
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.shapes import MeshFile
from assetbuild.source.urdf.xml import parse

BACKSLASH = "only Windows reads a backslash as the end of a folder"
STRAY = "only from a folder further up does this name lead to a file"
CASE = "Linux tells upper from lower case, and this is how the file is called"


def mended(source: UrdfSource) -> UrdfSource:
    """The source with patches for names and types, and what it lacks stated as missing.

    A visual mesh may be missing, a collision mesh may not. SourceError with file and line for what
    no recipe can mend.
    """
    source = patched(source, (*_slashes(source), *retyped(source), *shortened(source)))
    meshes, solid = _meshes(source)
    absent = [mesh for mesh in meshes if not is_file(source.root / mesh["path"])]
    if not absent:
        return source
    source = patched(source, (*_cases(source, absent), *_strays(source)))
    meshes, solid = _meshes(source)
    absent = [mesh for mesh in meshes if not is_file(source.root / mesh["path"])]
    needed = [mesh for mesh in absent if mesh["path"] in solid]
    if needed or (absent and len(absent) == len(meshes)):
        raise _refused(source, needed or absent)
    return replace(source, missing=tuple(mesh["path"] for mesh in absent))


def _meshes(source: UrdfSource) -> tuple[list[dict[str, str]], set[str]]:
    """Every mesh that is named, and the paths of those that something collides with."""
    with scratch() as ports:
        ports.put("robot.urdf", source.data)
        ports.run(source.reader())
        listed: list[dict[str, str]] = json.loads(ports.read("meshes.json"))
        shapes = RobotFiles(ports.folder).source_shapes.of("collision")
    return listed, {s.geometry.path for s in shapes if isinstance(s.geometry, MeshFile)}


def _refused(source: UrdfSource, absent: list[dict[str, str]]) -> SourceError:
    """A build would stop there too, at the first; here all are named."""
    first, others = absent[0], [f"`{mesh['path']}`" for mesh in absent[1:]]
    near = (source.root / first["path"]).parent
    names = [str(PurePosixPath(first["path"]).parent / f.name) for f in _listing(near)]
    close, (lack, meant) = nearest(first["path"], names), lacking(source.root, first["path"])
    more = f" (and {len(others)} more: {some(others)})" if others else ""
    return SourceError(
        f"{first['subject']}: no file `{first['path']}`{more}",
        where=Where(source.shown, int(first["line"])),
        hint=f"did you mean `{close}`?" if close else meant or f"the source holds {lack}",
    )


def _listing(folder: Path) -> Iterable[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError:
        return ()


# --- patches --------------------------------------------------------------------------------


def _slashes(source: UrdfSource) -> Iterator[Patch | None]:
    for uri in dict.fromkeys(_names(source)):
        if "\\" in uri:
            yield _renaming(source, uri, uri.replace("\\", "/"), BACKSLASH)


def _cases(source: UrdfSource, absent: Sequence[dict[str, str]]) -> Iterator[Patch | None]:
    """A patch for each mesh that is there under one name of other case."""
    for mesh in absent:
        own = _other_case(source.root, PurePosixPath(mesh["path"]))
        if own is not None:
            stated, said = PurePosixPath(mesh["path"]).parts, mesh["uri"].split("/")
            pairs = zip(reversed(stated), reversed(said), strict=False)
            same = len(list(itertools.takewhile(lambda pair: pair[0] == pair[1], pairs)))
            if same and own.parts[:-same] == stated[:-same]:
                named = "/".join((*said[:-same], *own.parts[-same:]))
                yield _renaming(source, mesh["uri"], named, CASE)


def _strays(source: UrdfSource) -> Iterator[Patch | None]:
    """A patch for each relative name that starts from another folder than most of them do."""
    if source.key != "urdf":
        return
    file = source.root / source.file
    start = None if source.relative_to is None else source.root / source.relative_to
    for uri, path in elsewhere(files_named(parse(source.data, source.shown)), file, start).items():
        named = os.path.relpath(path, start or file.parent)
        yield _renaming(source, uri, named.replace(os.sep, "/"), STRAY)


def _other_case(root: Path, path: PurePosixPath) -> PurePosixPath | None:
    """The one file below the root whose path is the same but for upper and lower case."""
    found = [PurePosixPath()]
    for part in path.parts:
        found = [
            here / entry.name
            for here in found
            for entry in _listing(root / here)
            if entry.name.lower() == part.lower()
        ]
    return found[0] if len(found) == 1 else None


def _names(source: UrdfSource) -> list[str]:
    """Every name of a file, as often as it is used; none of a xacro, which computes them."""
    if source.key != "urdf":
        return []
    return [uri for uri, _ in files_named(parse(source.data, source.shown))]


def _renaming(source: UrdfSource, old: str, new: str, because: str) -> Patch | None:
    """A patch of a name, everywhere; None where the text spells it in another way."""
    uses, text = _names(source).count(old), source.data.decode("utf-8", "replace")
    for mark in ('"', "'", ""):
        if uses and text.count(f"{mark}{old}{mark}") == uses:
            find, replace = f"{mark}{old}{mark}", f"{mark}{new}{mark}"
            file = source.file
            return Patch(file=file, find=find, replace=replace, times=uses, because=because)
    return None
