"""Packages: what a description names, the folders that they stand for, the folder around all."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from assetbuild.errors import UsageError
from assetbuild.source.urdf.xml import Node

LEVELS = 12
"""Folders above the URDF that are looked at for a package: a tree of files, not a disk."""

_PACKAGE = re.compile(r"package:/*([^/]+)/(.+)")
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
        if match := _PACKAGE.fullmatch(uri):
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


def _searched(name: str, inside: Uses, file: Path) -> Path:
    """The nearest folder above the URDF that holds the files, under the package's name or not."""
    folders = above(file)
    called = [folder for folder in folders if folder.name == name]
    for folder in (*called, *(folder / name for folder in folders), *folders):
        if any(is_file(folder / path) for path, _ in inside):
            return Path(os.path.realpath(folder))
    node = inside[0][1]
    uri = (node.element.get("filename") or "").strip()
    raise node.error(
        f"`{uri}`: no folder above the URDF holds the package `{name}`",
        f"say where it is: `--package {name}=FOLDER`",
    )


def is_file(path: Path) -> bool:
    """A name that is too long for the disk is that of no file; pathlib raises."""
    try:
        return path.is_file()
    except OSError:
        return False


def common_folder(file: Path, folders: Iterable[Path], uses: Uses) -> Path:
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
