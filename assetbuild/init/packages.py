"""Packages: what a description names, the folders that they stand for, the folder around all."""

from __future__ import annotations

import functools
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path, PurePosixPath

from assetbuild.errors import UsageError
from assetbuild.recipe.loader import shown_path
from assetbuild.source.urdf.xml import Node

LEVELS = 12
"""Folders above the URDF that are looked at for a package: a tree of files, not a disk."""

NEAR, DEEPEST, MOST_FOLDERS = 4, 5, 20_000
"""Folders above a file in no repository below which packages are looked for; how deep, and how many
folders below each."""

PACKAGE = re.compile(r"(?:package|model):/*([^/]+)/(.+)")
_NAMED = re.compile(r"<name>\s*([^<\s]+)\s*</name>")
Uses = list[tuple[str, Node]]
"""(uri, element) of meshes and textures."""


def files_named(root: Node) -> Uses:
    """Every mesh and texture of a description."""
    elements = root.element.iter("mesh", "texture")
    named = [((element.get("filename") or "").strip(), element) for element in elements]
    return [(uri, Node(element, root.file)) for uri, element in named if uri]


def find_packages(uses: Uses, file: Path, known: Mapping[str, Path]) -> dict[str, Path]:
    """The folder of every package that a `package://` names: as known, else searched.

    SourceError with the line where one is not found.
    """
    inside: dict[str, Uses] = {}
    for uri, node in uses:
        if match := PACKAGE.fullmatch(uri):
            inside.setdefault(match[1], []).append((match[2], node))
    return {name: known.get(name) or _searched(name, inside[name], file) for name in inside}


def above(file: Path) -> list[Path]:
    """The folders above a file that are looked at, the nearest first."""
    return list(file.parents)[:LEVELS]


def stated(name: str, folder: Path) -> Path:
    """The folder of a `--package`; UsageError when it is none."""
    if not folder.is_dir():
        message = f"--package {name}={folder}: there is no such folder"
        raise UsageError(message, hint="it is the folder that `package://" + name + "/` stands for")
    return Path(os.path.realpath(folder))


def package_folders(name: str, file: Path) -> Iterator[list[Path]]:
    """Where a package may lie, the likeliest first; several folders are equally likely.

    A folder above the file that has its name or declares it; one beside those of its name; one that
    declares it, anywhere below a folder above the file.
    """
    folders = above(file)
    for folder in folders:
        if folder.name == name or declared(folder) == name:
            yield [folder]
    for folder in folders:
        if (folder / name).is_dir():
            yield [folder / name]
    for folder in _workspace(file):
        if found := packages_below(folder).get(name):
            yield list(found)


def find_package(name: str, file: Path) -> Path | None:
    """The one folder of a package; None where there is none, or it is not clear which."""
    found = next(package_folders(name, file), [])
    return Path(os.path.realpath(found[0])) if len(found) == 1 else None


def _searched(name: str, inside: Uses, file: Path) -> Path:
    """The likeliest folder that holds the files; at last one above the URDF under another name."""
    node = inside[0][1]
    uri = (node.element.get("filename") or "").strip()
    for folders in (*package_folders(name, file), *([folder] for folder in above(file))):
        holding = [f for f in folders if any(is_file(f / path) for path, _ in inside)]
        if len(holding) > 1:
            choices = " or ".join(f"`--package {name}={shown_path(f)}`" for f in holding)
            raise node.error(f"`{uri}`: {len(holding)} folders are package `{name}`", choices)
        if holding:
            return Path(os.path.realpath(holding[0]))
    known = next(package_folders(name, file), [])
    if known:
        lack, hint = lacking(known[0], inside[0][0])
        hint = hint or f"bring the file, or say where the package is: `--package {name}=FOLDER`"
        raise node.error(
            f"`{uri}`: package `{name}` is `{shown_path(known[0])}`, which holds {lack}", hint
        )
    raise node.error(
        f"`{uri}`: no folder above the URDF holds the package `{name}`",
        f"say where it is: `--package {name}=FOLDER`",
    )


def lacking(root: Path, path: str) -> tuple[str, str]:
    """The first part of a path below a folder that is not there; where such a file is, or ""."""
    here, (*folders, name) = root, PurePosixPath(path).parts
    lack = f"no file `{name}`"
    for folder in folders:
        if not (here / folder).is_dir():
            lack = f"no folder `{folder}`"
            break
        here = here / folder
    if here != root:
        lack += f" in `{here.relative_to(root).as_posix()}`"
    circles = [here, *(above for above in here.parents if above.is_relative_to(root))]
    for top in circles[:NEAR]:
        walked = ((at, one) for at, names in _walk(top) for one in names)
        if found := [at / one for at, one in walked if one.lower() == name.lower()]:
            others = f", and {len(found) - 1} more of that name" if len(found) > 1 else ""
            return lack, f"is `{found[0].relative_to(root).as_posix()}` meant{others}?"
    return lack, ""


def _workspace(file: Path) -> list[Path]:
    """The folders above a file up to its repository; without one `NEAR` of them."""
    folders = above(file)
    tops = [index for index, folder in enumerate(folders) if (folder / ".git").exists()]
    return folders[: tops[0] + 1 if tops else NEAR]


@functools.lru_cache(maxsize=64)
def packages_below(top: Path) -> Mapping[str, tuple[Path, ...]]:
    """Every package that a `package.xml` below a folder declares; nothing behind links."""
    found: dict[str, tuple[Path, ...]] = {}
    for here, names in _walk(top):
        if "package.xml" in names and (name := declared(here)):
            found[name] = (*found.get(name, ()), here)
    return found


def _walk(top: Path) -> Iterator[tuple[Path, list[str]]]:
    """The folders at most `DEEPEST` below one, with the names of their files; no links."""
    for count, (here, folders, names) in enumerate(os.walk(top)):
        deep = len(Path(here).relative_to(top).parts)
        folders[:] = [] if deep >= DEEPEST else sorted(f for f in folders if f[0] != ".")
        yield Path(here), names
        if count > MOST_FOLDERS:
            break


def declared(folder: Path) -> str | None:
    """The name in its package.xml."""
    manifest = folder / "package.xml"
    found = _NAMED.search(start_of(manifest, 1 << 16)) if is_file(manifest) else None
    return found and found[1]


def start_of(path: Path, most: int) -> str:
    """The first bytes of a file as text; none of one that cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(most).decode("utf-8", "replace")
    except OSError:
        return ""


def is_file(path: Path) -> bool:
    """A name that is too long for the disk is that of no file; pathlib raises."""
    try:
        return path.is_file()
    except OSError:
        return False


def common_folder(
    file: Path, folders: Iterable[Path], uses: Uses, start: Path | None = None
) -> Path:
    """The lowest folder that holds the URDF, its packages and what relative names lead to.

    start: where relative names begin, if not at the URDF's folder.
    """
    relative = [
        Path(os.path.normpath((start or file.parent) / uri)).parent
        for uri, _ in uses
        if ":" not in uri and not uri.startswith("/")
    ]
    try:
        return Path(
            os.path.commonpath([file.parent, *folders, *relative, *([start] if start else [])])
        )
    except ValueError:  # another drive
        message = "the URDF and its packages share no folder"
        raise UsageError(message, hint="copy them below one folder") from None
