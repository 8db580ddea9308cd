"""A xacro file for `init`: its packages looked for, its arguments listed, then expanded.

It is expanded by the step of the build, in the same restricted child.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping
from itertools import islice
from pathlib import Path
from xml.etree.ElementTree import ParseError

from assetbuild.engine.scratch import scratch
from assetbuild.engine.world import World
from assetbuild.errors import SourceError
from assetbuild.init.packages import (
    above,
    common_folder,
    declared,
    find_package,
)
from assetbuild.source.urdf.expand_xacro import (
    ARGUMENT,
    MOST_FILES,
    NOT_INCLUDED,
    WHERE,
    ExpandXacro,
)

MOST_TRIES = 60
"""Packages that are asked for, one after another."""

_ASKED = re.compile(r"`\$\(find ([^`]+)\)`: no package")
_ABSENT = re.compile(r"of the package `([^`]+)`, which is stated as missing")


Expanded = tuple[bytes, Mapping[str, Path], Mapping[str, str], tuple[str, ...]]
"""The URDF; the folders of the packages that were used; defaults and absent: see `UrdfSource`."""


def is_xacro(file: Path, data: bytes) -> bool:
    """By its name, or because it uses xacro's elements."""
    return file.suffix == ".xacro" or b"<xacro:" in data


def expand(file: Path, stated: Mapping[str, Path], args: Mapping[str, str]) -> Expanded:
    """Expand a file with its arguments. Raises SourceError as the build would, in words of `init`.

    file: real path. A package that it asks for is found by expanding it again and again. One that
    is found nowhere is an error only where the robot needs its files.
    """
    folders, absent = dict(stated), list[str]()
    for _ in range(MOST_TRIES):
        try:
            return _expanded(file, folders, args, absent)
        except SourceError as error:
            _mend(error, file, folders, absent)
    raise SourceError(f"it asks for more than {MOST_TRIES} things by computed names")


def _expanded(
    file: Path, folders: Mapping[str, Path], args: Mapping[str, str], missing: Collection[str]
) -> Expanded:
    """One expansion. missing: packages that were found nowhere."""
    root = common_folder(file, folders.values(), [])
    step = ExpandXacro(
        file=file.relative_to(root).as_posix(),
        args=dict(sorted(args.items())),
        packages={name: f.relative_to(root).as_posix() for name, f in sorted(folders.items())},
        absent=tuple(sorted(missing)),
    )
    with scratch() as ports:
        ports.link(f"tree/{step.file}", file)
        for folder in (file.parent, *folders.values()):
            for path in islice(World().below(folder, (), NOT_INCLUDED), MOST_FILES):
                if path.is_file() and not path.is_symlink():
                    ports.link(f"tree/{path.relative_to(root)}", path)
        for finding in ports.run(step):
            if finding.rule == ARGUMENT.id:
                name = finding.data["argument"]
                raise SourceError(f"--arg {name}: {finding.message}", hint=finding.hint)
        urdf = ports.read("robot.urdf")
        used = json.loads(ports.read("used.json"))
    text, files = urdf.decode("utf-8"), [root / name for name in used["files"]]
    needed = {
        name: folder
        for name, folder in folders.items()
        if f"package://{name}/" in text
        or name in used["packages"]
        or any(path.is_relative_to(folder) for path in files)
    }
    absent = tuple(sorted({*missing} & {*used["packages"]}))
    return urdf, needed, _defaults([file, *files]), absent


def _mend(error: SourceError, file: Path, folders: dict[str, Path], absent: list[str]) -> None:
    """Find what an expansion lacked; raise the error, in words of `init`, where that cannot be."""
    if asked := _ASKED.search(error.message):
        folder = find_package(asked[1], file)
        if folder is None:
            absent.append(asked[1])
        else:
            folders[asked[1]] = folder
    elif own := _own_package(error, file, folders):
        folders |= own
    elif absent_package := _ABSENT.search(error.message):  # stated as missing by no recipe yet
        name = absent_package[1]
        message = f"`$(find {name})`: no package named `{name}`"
        raise SourceError(message, where=error.where, hint=WHERE)
    else:
        raise error


def _own_package(error: SourceError, file: Path, folders: Mapping[str, Path]) -> dict[str, Path]:
    """The package that the file lies in, where it includes from there by a relative name."""
    if "readable files" not in error.message and "declared packages" not in error.message:
        return {}
    here, name = next(((f, name) for f in above(file) if (name := declared(f))), (file, ""))
    known = here in folders.values() or name in folders
    return {name: here} if name and not known else {}


# --- arguments ------------------------------------------------------------------------------


def _defaults(files: list[Path]) -> dict[str, str]:
    """Every `<xacro:arg>` of the files that were read, in that order; "" without a default."""
    from defusedxml.ElementTree import parse

    defaults: dict[str, str] = {}
    for path in files:
        try:
            root = parse(path).getroot()
        except (ParseError, ValueError):
            continue  # xacro has read it; only the list of arguments is shorter
        for element in root.iter() if root is not None else ():
            name = element.get("name")
            if str(element.tag).endswith("}arg") and "xacro" in str(element.tag) and name:
                defaults.setdefault(name, element.get("default", ""))
    return defaults
