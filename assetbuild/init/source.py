"""What file the user gave, and where the robot's other files lie: one folder holds them all."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from assetbuild.errors import SourceError, UsageError, Where
from assetbuild.init.file_names import (
    absolute_folders,
    elsewhere,
    packageless,
    relative_start,
    respelled,
)
from assetbuild.init.packages import (
    common_folder,
    files_named,
    find_packages,
    packages_below,
    stated,
)
from assetbuild.init.xacro import Expanded, Rewrite, expand, is_xacro, leftovers, rewritten
from assetbuild.recipe.loader import read_small_file, shown_path
from assetbuild.recipe.source import Patch
from assetbuild.robot.loops import LoopRow
from assetbuild.source.urdf.read_urdf import ReadUrdf
from assetbuild.source.urdf.xml import parse


@dataclass(frozen=True)
class UrdfSource:
    """key: of the recipe's source that names `file`. data: the description, a xacro's expanded.

    root: absolute, without links; file and the package folders: below it, `/` between.
    args: as given; defaults: of all arguments that the xacro declares, as it spells them.
    relative_to, absolute, patches: see `recipe.source`; absent: packages that the source lacks;
    missing: visual meshes that it lacks; loops: in place of joints that patches take away, remarks:
    what is to be said of these.
    """

    key: Literal["urdf", "xacro"]
    root: Path
    file: str
    packages: Mapping[str, str]
    data: bytes
    args: Mapping[str, str]
    defaults: Mapping[str, str]
    relative_to: str | None = None
    absolute: Mapping[str, str] = field(default_factory=dict)
    absent: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    patches: tuple[Patch, ...] = ()
    loops: tuple[LoopRow, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def shown(self) -> str:
        """The description's name in messages, as a build would give it."""
        return self.file if self.key == "urdf" else f"{self.file} (expanded)"

    def reader(self) -> ReadUrdf:
        """The step that reads `data`, as a build would run it."""
        return ReadUrdf(
            file=self.shown,
            base="floating",
            packages=dict(self.packages),
            relative_to=self.relative_to,
            absolute=dict(self.absolute),
            missing=self.missing,
        )


def find_source(
    file: Path, packages: Mapping[str, Path], args: Mapping[str, str] | None = None
) -> UrdfSource:
    """Read the description and find what its file names mean.

    Raises SourceError where a package is not found, UsageError for a `--package` that is no
    folder and for `--arg` without a xacro.
    """
    packages_below.cache_clear()  # the files may have changed since another robot was read
    args, name = args or {}, shown_path(file)
    data = read_small_file(file, name, SourceError)
    folders = {name: stated(name, folder) for name, folder in packages.items()}
    real = Path(os.path.realpath(file))
    left = (*leftovers(real, data), *packageless(real, data))
    data = rewritten(data, left)
    by_xacro = is_xacro(file, data)
    if not by_xacro:
        left = (*left, *respelled(real, data, folders))
        data = rewritten(data, left)
    if args and not by_xacro:
        raise UsageError("`--arg` is for a xacro file", where=Where(name), hint="leave it out")
    read = expand(real, data, folders, args) if by_xacro else Expanded(data)
    # Backslashes are patched later; until then they are read as they are meant.
    named = files_named(parse(read.data, name))
    uses = [(uri.replace("\\", "/"), node) for uri, node in named]
    used = {**folders, **read.packages}
    used |= find_packages(uses, real, used)
    start, absolute = relative_start(uses, real), absolute_folders(uses, real)
    strays = [stray.parent for stray in elsewhere(uses, real, start).values()]
    root = common_folder(real, (*used.values(), *absolute.values(), *strays), uses, start)
    return UrdfSource(
        key="xacro" if by_xacro else "urdf",
        root=root,
        file=real.relative_to(root).as_posix(),
        packages={name: used[name].relative_to(root).as_posix() for name in sorted(used)},
        data=read.data,
        args=read.args,
        defaults=read.defaults,
        relative_to=start.relative_to(root).as_posix() if start else None,
        absolute={of: to.relative_to(root).as_posix() for of, to in sorted(absolute.items())},
        absent=read.absent,
        patches=tuple(_patch(each, root) for each in (*left, *read.removed)),
    )


def _patch(passage: Rewrite, root: Path) -> Patch:
    """The patch of a passage, everywhere."""
    text = passage.file.read_bytes().decode("utf-8", "replace")
    return Patch(
        file=passage.file.relative_to(root).as_posix(),
        find=passage.tag,
        replace=passage.instead,
        times=text.count(passage.tag),
        because=passage.because,
    )
