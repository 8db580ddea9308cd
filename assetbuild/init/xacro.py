"""A xacro file for `init`: its packages looked for, its arguments listed, then expanded.

It is expanded by the step of the build, in the same restricted child.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from xml.etree.ElementTree import ParseError

from assetbuild.engine.scratch import scratch
from assetbuild.errors import SourceError
from assetbuild.init.packages import common_folder, find_package, package_folders
from assetbuild.recipe.loader import shown_path
from assetbuild.source.get.from_archive import left_out
from assetbuild.source.urdf.expand_xacro import MOST_FILES, NOT_TEXT, ExpandXacro

MOST_TRIES = 60
"""Packages that are asked for by a computed name, one after another."""

_FIND = re.compile(r"\$\(find\s+([^\s)]+)\s*\)|package:/*([A-Za-z][\w-]*)/")
_ASKED = re.compile(r"`\$\(find ([^`]+)\)`: no package")
_ABSENT = re.compile(r"of the package `([^`]+)`, which is stated as missing")
_XACRO = re.compile(rb"<xacro:")


@dataclass(frozen=True)
class Expanded:
    """data: URDF; packages: the folders that were used; defaults, absent: see `UrdfSource`."""

    data: bytes
    packages: Mapping[str, Path]
    defaults: Mapping[str, str]
    absent: tuple[str, ...] = ()


def is_xacro(file: Path, data: bytes) -> bool:
    """By its name, or because it uses xacro's elements."""
    return file.suffix == ".xacro" or _XACRO.search(data) is not None


def expand(
    file: Path, data: bytes, stated: Mapping[str, Path], args: Mapping[str, str]
) -> Expanded:
    """Expand a file with its arguments. Raises SourceError as the build would, in words of `init`.

    file: real path. Packages whose names the file computes are found by expanding it again and
    again. One that is found nowhere is an error only where the file reads something of it.
    """
    folders = _packages(file, data, stated)
    absent: list[str] = []
    for _ in range(MOST_TRIES):
        try:
            return _expanded(file, folders, absent, args)
        except SourceError as error:
            asked = _ASKED.search(error.message)
            if asked is None:
                raise _reworded(error, file) from None
            folder = find_package(asked[1], file)
            if folder is None:
                absent.append(asked[1])
            else:
                folders[asked[1]] = folder
    raise SourceError(f"it asks for more than {MOST_TRIES} packages by computed names")


def _expanded(
    file: Path, folders: Mapping[str, Path], absent: Sequence[str], args: Mapping[str, str]
) -> Expanded:
    root = common_folder(file, folders.values(), [])
    step = ExpandXacro(
        file=file.relative_to(root).as_posix(),
        args=dict(sorted(args.items())),
        packages={name: f.relative_to(root).as_posix() for name, f in sorted(folders.items())},
        absent=tuple(sorted(absent)),
    )
    with scratch() as ports:
        for path in (file, *_readable(file.parent), *chain(*map(_readable, folders.values()))):
            ports.link(f"tree/{path.relative_to(root)}", path)
        ports.run(step)
        urdf = ports.read("robot.urdf")
        used = json.loads(ports.read("used.json"))
    text, files = urdf.decode("utf-8"), [root / name for name in used["files"]]
    needed = {
        name: folder
        for name, folder in folders.items()
        if f"package://{name}/" in text or name in used["packages"]
    }
    return Expanded(urdf, needed, _defaults([file, *files]), tuple(sorted(absent)))


def _reworded(error: SourceError, file: Path) -> SourceError:
    """Hints of a build speak of the recipe; there is none yet."""
    message, hint = error.message, error.hint
    if absent := _ABSENT.search(message):
        message = f"`$(find {absent[1]})`: no package named `{absent[1]}`"
        hint = "say where it is: `--package NAME=FOLDER`"
        found: list[Path] = next(package_folders(absent[1], file), [])
        if len(found) > 1:
            message = f"`$(find {absent[1]})`: {len(found)} folders are package `{absent[1]}`"
            hint = " or ".join(f"`--package {absent[1]}={shown_path(f)}`" for f in found)
    elif "Undefined substitution argument" in message:
        hint = "give it: `--arg NAME=VALUE`"
    return SourceError(message, where=error.where, hint=hint)


# --- files ----------------------------------------------------------------------------------


def _packages(file: Path, data: bytes, stated: Mapping[str, Path]) -> dict[str, Path]:
    """Folders of all packages that the file and what it may include speak of, where they exist."""
    found: dict[str, Path | None] = dict(stated)
    waiting = [data.decode("utf-8", "replace")]
    waiting += [_text(path) for folder in stated.values() for path in _readable(folder)]
    while waiting:
        text = waiting.pop()
        for match in _FIND.finditer(text if "<robot" in text else ""):
            name = match[1] or match[2]
            if name not in found:
                folder = found[name] = find_package(name, file)
                if folder is not None:
                    waiting += [_text(path) for path in _readable(folder)]
    return {name: folder for name, folder in found.items() if folder is not None}


def _text(path: Path) -> str:
    return path.read_bytes()[: 1 << 20].decode("utf-8", "replace")


def _readable(folder: Path) -> Iterator[Path]:
    """What a xacro may read below a folder; no links that lead out of it."""
    count = 0
    for here, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(names):
            path = Path(here) / name
            if not left_out(name, NOT_TEXT) and path.is_file() and not path.is_symlink():
                yield path
                count += 1
        if count > MOST_FILES:
            return


# --- arguments ------------------------------------------------------------------------------


def _defaults(files: list[Path]) -> dict[str, str]:
    """Every `<xacro:arg>` of the files that were read, in that order; "" without a default."""
    from defusedxml.ElementTree import parse

    found: dict[str, str] = {}
    for path in files:
        try:
            root = parse(path).getroot()
        except (ParseError, ValueError):
            continue  # xacro has read it; only the list of arguments is shorter
        for element in root.iter() if root is not None else ():
            name = element.get("name")
            if str(element.tag).endswith("}arg") and "xacro" in str(element.tag) and name:
                found.setdefault(name, element.get("default", ""))
    return found
