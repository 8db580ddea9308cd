"""A xacro file for `init`: its packages looked for, its arguments listed, then expanded.

It is expanded by the step of the build, in the same restricted child.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from xml.etree.ElementTree import ParseError

from assetbuild.engine.scratch import scratch
from assetbuild.errors import SourceError
from assetbuild.init.packages import above, common_folder
from assetbuild.source.urdf.expand_xacro import INCLUDED, ExpandXacro

MOST_FILES = 2000
"""Files of one package that are looked at: a robot description, not a disk."""

_FIND = re.compile(r"\$\(find\s+([^\s)]+)\s*\)|package:/*([A-Za-z][\w-]*)/")
_XACRO = re.compile(rb"<xacro:")
_NAMED = re.compile(r"<name>\s*([^<\s]+)\s*</name>")


@dataclass(frozen=True)
class Expanded:
    """data: URDF; packages: the folders that were used; defaults: see `UrdfSource`."""

    data: bytes
    packages: Mapping[str, Path]
    defaults: Mapping[str, str]


def is_xacro(file: Path, data: bytes) -> bool:
    """By its name, or because it uses xacro's elements."""
    return file.suffix == ".xacro" or _XACRO.search(data) is not None


def expand(
    file: Path, data: bytes, stated: Mapping[str, Path], args: Mapping[str, str]
) -> Expanded:
    """Expand a file with its arguments. Raises SourceError as the build would, in words of `init`.

    file: real path. A package that is found nowhere is an error only where the file needs it.
    """
    folders = _packages(file, data, stated)
    root = common_folder(file, folders.values(), [])
    step = ExpandXacro(
        file=file.relative_to(root).as_posix(),
        args=dict(sorted(args.items())),
        packages={name: f.relative_to(root).as_posix() for name, f in sorted(folders.items())},
    )
    with scratch() as ports:
        for path in (file, *_readable(file.parent), *chain(*map(_readable, folders.values()))):
            ports.link(f"tree/{path.relative_to(root)}", path)
        try:
            ports.run(step)
        except SourceError as error:
            raise _reworded(error) from None
        urdf = ports.read("robot.urdf")
        used = [root / name for name in json.loads(ports.read("used.json"))]
    text = urdf.decode("utf-8")
    needed = {
        name: folder
        for name, folder in folders.items()
        if f"package://{name}/" in text or any(path.is_relative_to(folder) for path in used)
    }
    return Expanded(urdf, needed, _defaults([file, *used]))


def _reworded(error: SourceError) -> SourceError:
    """Hints of a build speak of the recipe; there is none yet."""
    hint = error.hint
    if "$(find" in error.message:
        hint = "say where it is: `--package NAME=FOLDER`"
    elif "Undefined substitution argument" in error.message:
        hint = "give it: `--arg NAME=VALUE`"
    return SourceError(error.message, where=error.where, hint=hint)


# --- files ----------------------------------------------------------------------------------


def _packages(file: Path, data: bytes, stated: Mapping[str, Path]) -> dict[str, Path]:
    """Folders of all packages that the file and what it may include speak of, where they exist."""
    found: dict[str, Path | None] = dict(stated)
    waiting = [data.decode("utf-8", "replace")]
    waiting += [_text(path) for folder in stated.values() for path in _readable(folder)]
    while waiting:
        for match in _FIND.finditer(waiting.pop()):
            name = match[1] or match[2]
            if name not in found:
                folder = found[name] = _folder(name, file)
                if folder is not None:
                    waiting += [_text(p) for p in _readable(folder) if p.suffix != ".yaml"]
    return {name: folder for name, folder in found.items() if folder is not None}


def _folder(name: str, file: Path) -> Path | None:
    """The nearest folder above the file, or beside one of those, that is the package."""
    folders = above(file)
    called = (folder for folder in folders if folder.name == name or _declares(folder, name))
    beside = (folder / name for folder in folders if (folder / name).is_dir())
    found = next(chain(called, beside), None)
    return found and Path(os.path.realpath(found))


def _declares(folder: Path, name: str) -> bool:
    """By its package.xml."""
    manifest = folder / "package.xml"
    found = _NAMED.search(_text(manifest)) if manifest.is_file() else None
    return found is not None and found[1] == name


def _text(path: Path) -> str:
    return path.read_bytes()[: 1 << 20].decode("utf-8", "replace")


def _readable(folder: Path) -> Iterator[Path]:
    """What a xacro may read below a folder; no links that lead out of it."""
    count = 0
    for here, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(names):
            path = Path(here) / name
            if path.suffix.lower() in INCLUDED and not path.is_symlink():
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
        if path.suffix.lower() not in (".xacro", ".urdf", ".xml"):
            continue
        try:
            root = parse(path).getroot()
        except (ParseError, ValueError):
            continue  # xacro has read it; only the list of arguments is shorter
        for element in root.iter() if root is not None else ():
            name = element.get("name")
            if str(element.tag).endswith("}arg") and "xacro" in str(element.tag) and name:
                found.setdefault(name, element.get("default", ""))
    return found
