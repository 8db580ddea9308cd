"""What file the user gave, and where the robot's other files lie: one folder holds them all."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from assetbuild.errors import SourceError, UsageError, Where
from assetbuild.init.packages import common_folder, files_named, find_packages, stated
from assetbuild.init.xacro import Expanded, expand, is_xacro
from assetbuild.recipe.loader import read_small_file, shown_path
from assetbuild.source.urdf.xml import parse


@dataclass(frozen=True)
class Found:
    """key: of the recipe's source that names `file`. data: the description, a xacro's expanded.

    root: absolute, without links; file and the package folders: below it, `/` between.
    args: as given; defaults: of all arguments that the xacro declares, as it spells them.
    """

    key: Literal["urdf", "xacro"]
    root: Path
    file: str
    packages: Mapping[str, str]
    data: bytes
    args: Mapping[str, str] = field(default_factory=dict)
    defaults: Mapping[str, str] = field(default_factory=dict)

    @property
    def shown(self) -> str:
        """The description's name in messages, as a build would give it."""
        return self.file if self.key == "urdf" else f"{self.file} (expanded)"


def find_source(
    file: Path, packages: Mapping[str, Path], args: Mapping[str, str] | None = None
) -> Found:
    """Read the description and find what its file names mean.

    Raises SourceError where a package is not found, UsageError for a `--package` that is no
    folder and for `--arg` without a xacro.
    """
    data = read_small_file(file, shown_path(file), SourceError)
    folders = {name: stated(name, folder) for name, folder in packages.items()}
    real = Path(os.path.realpath(file))
    if is_xacro(file, data):
        return _found(
            "xacro", real, shown_path(file), expand(real, data, folders, args or {}), folders
        )
    if args:
        where = Where(shown_path(file))
        raise UsageError("`--arg` is for a xacro file", where=where, hint="leave it out")
    return _found("urdf", real, shown_path(file), Expanded(data, {}), folders)


def _found(
    key: Literal["urdf", "xacro"],
    file: Path,
    shown: str,
    read: Expanded,
    stated_folders: Mapping[str, Path],
) -> Found:
    uses = files_named(parse(read.data, shown))
    used = {**stated_folders, **read.packages}
    used |= find_packages(uses, file, used)
    root = common_folder(file, used.values(), uses)
    return Found(
        key=key,
        root=root,
        file=file.relative_to(root).as_posix(),
        packages={name: used[name].relative_to(root).as_posix() for name in sorted(used)},
        data=read.data,
        args=read.args,
        defaults=read.defaults,
    )
