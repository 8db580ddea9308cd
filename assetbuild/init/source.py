"""What file the user gave, and where the robot's other files lie: one folder holds them all."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from assetbuild.errors import SourceError, UsageError, Where
from assetbuild.init.packages import common_folder, files_named, find_packages, stated
from assetbuild.init.xacro import Expanded, expand, is_xacro
from assetbuild.recipe.loader import read_small_file, shown_path
from assetbuild.source.urdf.xml import parse


@dataclass(frozen=True)
class UrdfSource:
    """key: of the recipe's source that names `file`. data: the description, a xacro's expanded.

    root: absolute, without links; file and the package folders: below it, `/` between.
    args: as given; defaults: of all arguments that the xacro declares, as it spells them.
    """

    key: Literal["urdf", "xacro"]
    root: Path
    file: str
    packages: Mapping[str, str]
    data: bytes
    args: Mapping[str, str]
    defaults: Mapping[str, str]

    @property
    def shown(self) -> str:
        """The description's name in messages, as a build would give it."""
        return self.file if self.key == "urdf" else f"{self.file} (expanded)"


def find_source(
    file: Path, packages: Mapping[str, Path], args: Mapping[str, str] | None = None
) -> UrdfSource:
    """Read the description and find what its file names mean.

    Raises SourceError where a package is not found, UsageError for a `--package` that is no
    folder and for `--arg` without a xacro.
    """
    args, name = args or {}, shown_path(file)
    data = read_small_file(file, name, SourceError)
    folders = {name: stated(name, folder) for name, folder in packages.items()}
    real = Path(os.path.realpath(file))
    by_xacro = is_xacro(file, data)
    if args and not by_xacro:
        raise UsageError("`--arg` is for a xacro file", where=Where(name), hint="leave it out")
    read = expand(real, data, folders, args) if by_xacro else Expanded(data, {}, {})
    uses = files_named(parse(read.data, name)[0])
    used = {**folders, **read.packages}
    used |= find_packages(uses, real, used)
    root = common_folder(real, used.values(), uses)
    return UrdfSource(
        key="xacro" if by_xacro else "urdf",
        root=root,
        file=real.relative_to(root).as_posix(),
        packages={name: used[name].relative_to(root).as_posix() for name in sorted(used)},
        data=read.data,
        args=args,
        defaults=read.defaults,
    )
