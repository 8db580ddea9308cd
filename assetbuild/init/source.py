"""Where the robot's files lie: the one folder that holds them all, and the package:// roots."""

from __future__ import annotations

import os
import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from assetbuild.errors import SourceError, UsageError, Where
from assetbuild.recipe.loader import read_small_file, shown_path
from assetbuild.steps._urdf_xml import Node, parse

LEVELS = 12
"""Folders above the URDF that are looked at for a package: a tree of files, not a disk."""

_PACKAGE = re.compile(r"package:/*([^/]+)/(.+)")


@dataclass(frozen=True)
class Found:
    """root: absolute, without links; urdf and the package folders: below it, `/` between."""

    root: Path
    urdf: str
    packages: Mapping[str, str]
    data: bytes


def find_source(urdf: Path, packages: Mapping[str, Path]) -> Found:
    """Read the URDF's file names and find what they mean.

    Raises SourceError where a package is not found, UsageError for a `--package` that is no
    folder.
    """
    data = read_small_file(urdf, shown_path(urdf), SourceError)
    uses = _uses(parse(data, shown_path(urdf)))
    file = Path(os.path.realpath(urdf))
    folders = {name: _stated(name, folder) for name, folder in packages.items()}
    wanted = _by_package(uses)
    for name, inside in wanted.items():
        if name not in folders:
            folders[name] = _searched(name, inside, file, uses)
    used = {name: folder for name, folder in folders.items() if name in wanted or name in packages}
    root = _common(file, list(used.values()), uses)
    return Found(
        root=root,
        urdf=file.relative_to(root).as_posix(),
        packages={name: used[name].relative_to(root).as_posix() for name in sorted(used)},
        data=data,
    )


def _uses(root: Node) -> list[tuple[str, Node]]:
    """(uri, element) of every mesh and texture."""
    found = []
    for element in root.element.iter("mesh", "texture"):
        uri = (element.get("filename") or "").strip()
        if uri:
            found.append((uri, Node(element, root.file)))
    return found


def _by_package(uses: list[tuple[str, Node]]) -> dict[str, list[str]]:
    inside: dict[str, list[str]] = defaultdict(list)
    for uri, _ in uses:
        match = _PACKAGE.fullmatch(uri)
        if match:
            inside[match[1]].append(match[2])
    return dict(inside)


def _stated(name: str, folder: Path) -> Path:
    if not folder.is_dir():
        message = f"--package {name}={folder}: there is no such folder"
        raise UsageError(message, hint="it is the folder that `package://" + name + "/` stands for")
    return Path(os.path.realpath(folder))


def _searched(name: str, inside: list[str], file: Path, uses: list[tuple[str, Node]]) -> Path:
    """The nearest folder above the URDF that holds the files, under the package's name or not."""
    above = list(file.parents)[:LEVELS]
    called = [folder for folder in above if folder.name == name]
    beside = [folder / name for folder in above]
    for folder in (*called, *beside, *above):
        if any((folder / path).is_file() for path in inside):
            return Path(os.path.realpath(folder))
    uri, node = next(
        (uri, node) for uri, node in uses if uri.startswith("package:") and name in uri
    )
    raise SourceError(
        f"`{uri}`: no folder above the URDF holds the package `{name}`",
        where=Where(node.file, node.line),
        hint=f"say where it is: `--package {name}=FOLDER`",
    )


def _common(file: Path, folders: list[Path], uses: list[tuple[str, Node]]) -> Path:
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
