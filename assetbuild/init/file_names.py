"""What the file names of a URDF mean that name no package: relative ones, and absolute ones."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from assetbuild.errors import SourceError, Where
from assetbuild.init.packages import (
    PACKAGE,
    Uses,
    above,
    files_named,
    find_package,
    is_file,
    package_folders,
)
from assetbuild.init.xacro import Rewrite
from assetbuild.recipe.loader import shown_path
from assetbuild.source.urdf.xml import parse

SHORTEST = 2
"""Names at the end of an absolute path that must agree: a file's name alone proves nothing."""

_NO_PACKAGE = re.compile(rb"package:///([^\"'<>]*)")
_FIND = re.compile(r"^(?:(?:file|package):/*)?\$\(\s*find\s+([^)\s]+)\s*\)/*")
FIND = "xacro and ROS 1 launch files know `$(find ...)`, readers of URDF do not"
ENCODED = "the name is percent-encoded, which ROS' `file://` decodes; the file has the decoded name"
PACKAGELESS = "no package is named: pinocchio reads such names from each package's folder"


def packageless(file: Path, data: bytes) -> tuple[Rewrite, ...]:
    """The `package:///` before names that lie beside a URDF, as Onshape's exporters write it."""
    names = {*_NO_PACKAGE.findall(data)}
    if file.suffix != ".urdf" or not names or any(b"/" in name for name in names):
        return ()
    return (Rewrite(file, "package:///", PACKAGELESS),)


def respelled(file: Path, data: bytes, known: Mapping[str, Path]) -> tuple[Rewrite, ...]:
    """Names of a URDF as its readers spell them: `$(find NAME)/` and percent-encoding resolved.

    An encoded name that leads to a file as it stands is that file's.
    """
    text, made = data.decode("utf-8", "replace"), []
    for uri in dict.fromkeys(uri for uri, _ in files_named(parse(data, shown_path(file)))):
        named, because = _FIND.sub(r"package://\1/", uri), FIND
        decoded = unquote(named)
        if decoded != named and not _leads(named, file, known) and _leads(decoded, file, known):
            named, because = decoded, ENCODED if named == uri else f"{FIND}; {ENCODED}"
        if named != uri and not set(named) & set("\"'<>&"):
            quoted = ((f"{mark}{uri}{mark}", f"{mark}{named}{mark}") for mark in "\"'")
            made += [Rewrite(file, old, because, new) for old, new in quoted if old in text]
    return tuple(made)


def _leads(uri: str, file: Path, known: Mapping[str, Path]) -> bool:
    """Whether a name, taken literally, may be that of a file here."""
    if inside := PACKAGE.fullmatch(uri):
        name, path = inside[1], inside[2]
        likely = [[known[name]]] if name in known else package_folders(name, file)
        return any(is_file(at / path) for at in chain(above(file), *likely))
    if (path := absolute_path(uri)) is not None:
        return any(True for _ in _hits(path, file))
    return any(is_file(folder / uri.removeprefix("file://")) for folder in above(file))


def relative_start(uses: Uses, file: Path) -> Path | None:
    """The folder above the URDF that relative names start from; None: its own folder.

    The nearest that holds the most of them. SourceError where two folders hold other bytes.
    """
    names = {uri: node for uri, node in uses if ":" not in uri and not uri.startswith("/")}
    folders = above(file)
    held = {folder: [uri for uri in names if is_file(folder / uri)] for folder in folders}
    best = max(folders, key=lambda folder: len(held[folder]))  # of equals the first
    if best == file.parent:
        return None
    for folder in folders:
        for uri in held[folder]:
            if is_file(best / uri) and not _same(folder / uri, best / uri):
                first, second = (shown_path(one / uri) for one in (folder, best))
                raise names[uri].error(
                    f"relative names are taken from a folder above the URDF, where `{uri}` is two "
                    f"files: `{first}` and `{second}`",
                    "remove the one that is not meant, or write the names from the URDF's folder",
                )
    return best


def elsewhere(uses: Uses, file: Path, start: Path | None) -> dict[str, Path]:
    """Relative names that lead nowhere from `start`, by the one file that they mean from above.

    start: as `relative_start` found it; None: the folder of the URDF.
    """
    found: dict[str, Path] = {}
    for uri, _ in uses:
        if ":" in uri or uri.startswith("/") or is_file((start or file.parent) / uri):
            continue
        held = [folder / uri for folder in above(file) if is_file(folder / uri)]
        if held and all(_same(held[0], other) for other in held):
            found[uri] = Path(os.path.normpath(held[0]))
    return found


def absolute_folders(uses: Uses, file: Path) -> dict[str, Path]:
    """Folder of the author's machine -> the folder here, for absolute names of files.

    Found by the longest end of the name that is a file here. SourceError with the line where none
    is, or several files are.
    """
    found: dict[str, Path] = {}
    lost: Uses = []
    for uri, node in uses:
        path = absolute_path(uri)
        if path is None or _is_known(path, found):
            continue
        hits = list(_hits(path, file))
        if not hits:
            lost.append((path, node))
            continue
        length = max(length for length, _ in hits)
        longest = [here for count, here in hits if count == length]
        if any(not _same(longest[0], other) for other in longest):
            choices = " or ".join(f"`{shown_path(here)}`" for here in longest)
            raise node.error(f"`{uri}` may be {choices}", "remove the one that is not meant")
        # The same file may be reached from several folders above: the nearest says the least.
        near = min(count for count, here in hits if here == longest[0])
        found[str(PurePosixPath(*PurePosixPath(path).parts[:-near]))] = longest[0].parents[near - 1]
    for path, node in lost:
        if not any(path.startswith(f"{known}/") for known in found):
            raise _not_here(path, node.file, node.line)
    return found


def absolute_path(uri: str) -> str | None:
    """`/home/me/arm.stl` of that name or of `file:///home/me/arm.stl`; None for others.

    `file://meshes/arm.stl` has two slashes and starts from the URDF.
    """
    match = re.fullmatch(r"(?:file:(?://(?=/)|(?!//)))?(/.*)", uri)
    return None if match is None else os.path.normpath("/" + match[1].lstrip("/"))


def _is_known(path: str, found: Mapping[str, Path]) -> bool:
    """Whether a folder of the author's machine that is known already leads to a file here."""
    begun = [of for of in found if path.startswith(f"{of}/")]
    return any(is_file(found[of] / path[len(of) + 1 :]) for of in begun)


def _hits(path: str, file: Path) -> Iterator[tuple[int, Path]]:
    """(names that agree, file here) of every end of the path that is a file here."""
    parts = PurePosixPath(path).parts[1:]
    for count in range(len(parts) - 1, SHORTEST - 1, -1):
        tail = PurePosixPath(*parts[-count:])
        for folder in above(file):
            if is_file(folder / tail):
                yield count, Path(os.path.realpath(folder)) / tail
        package = find_package(parts[-count], file) if count > SHORTEST else None
        if package is not None and is_file(package.joinpath(*parts[-count + 1 :])):
            yield count - 1, package.joinpath(*parts[-count + 1 :])


def _same(one: Path, other: Path) -> bool:
    return one == other or one.read_bytes() == other.read_bytes()


def _not_here(path: str, file: str, line: int) -> SourceError:
    return SourceError(
        f"`{path}` is on the author's machine, and no folder above the URDF holds the end of it",
        where=Where(file, line),
        hint="bring the file, or write `package://NAME/path` (and `--package NAME=FOLDER`)",
    )
