"""Packages: what a description names, the folders that they stand for, the folder around all."""

from __future__ import annotations

import os
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path

from assetbuild.errors import SourceError, UsageError, Where
from assetbuild.source.urdf.xml import Node

LEVELS = 12
"""Folders above the URDF that are looked at for a package: a tree of files, not a disk."""

_PACKAGE = re.compile(r"package:/*([^/]+)/(.+)")


def files_named(root: Node) -> list[tuple[str, Node]]:
    """(uri, element) of every mesh and texture."""
    found = []
    for element in root.element.iter("mesh", "texture"):
        uri = (element.get("filename") or "").strip()
        if uri:
            found.append((uri, Node(element, root.file)))
    return found


def by_package(uses: list[tuple[str, Node]]) -> dict[str, list[str]]:
    """Paths inside each package that a `package://` names."""
    inside: dict[str, list[str]] = defaultdict(list)
    for uri, _ in uses:
        match = _PACKAGE.fullmatch(uri)
        if match:
            inside[match[1]].append(match[2])
    return dict(inside)


def find_packages(
    uses: list[tuple[str, Node]], file: Path, known: Mapping[str, Path]
) -> dict[str, Path]:
    """The folder of every package that a `package://` names: as known, else searched.

    SourceError with the line where one is not found.
    """
    return {
        name: known[name] if name in known else searched(name, inside, file, uses)
        for name, inside in by_package(uses).items()
    }


def above(file: Path) -> list[Path]:
    """The folders above a file that are looked at, the nearest first."""
    return list(file.parents)[:LEVELS]


def stated(name: str, folder: Path) -> Path:
    """The folder of a `--package`; UsageError when it is none."""
    if not folder.is_dir():
        message = f"--package {name}={folder}: there is no such folder"
        raise UsageError(message, hint="it is the folder that `package://" + name + "/` stands for")
    return Path(os.path.realpath(folder))


def searched(name: str, inside: list[str], file: Path, uses: list[tuple[str, Node]]) -> Path:
    """The nearest folder above the URDF that holds the files, under the package's name or not."""
    folders = above(file)
    called = [folder for folder in folders if folder.name == name]
    beside = [folder / name for folder in folders]
    for folder in (*called, *beside, *folders):
        if any(is_file(folder / path) for path in inside):
            return Path(os.path.realpath(folder))
    uri, node = next(
        (uri, node) for uri, node in uses if uri.startswith("package:") and name in uri
    )
    raise SourceError(
        f"`{uri}`: no folder above the URDF holds the package `{name}`",
        where=Where(node.file, node.line),
        hint=f"say where it is: `--package {name}=FOLDER`",
    )


def is_file(path: Path) -> bool:
    """A name that is too long for the disk is that of no file; pathlib raises."""
    try:
        return path.is_file()
    except OSError:
        return False


def common_folder(file: Path, folders: Iterable[Path], uses: list[tuple[str, Node]]) -> Path:
    """The lowest folder that holds the URDF, its packages and what relative names lead to."""
    relative = [
        Path(os.path.normpath(file.parent / uri)).parent
        for uri, _ in uses
        if ":" not in uri and not uri.startswith("/")
    ]
    try:
        return Path(os.path.commonpath([file.parent, *folders, *relative]))
    except ValueError:  # another drive
        message = "the URDF and its packages share no folder"
        raise UsageError(message, hint="copy them below one folder") from None
