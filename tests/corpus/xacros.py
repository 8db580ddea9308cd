"""Robots of the corpus that come as xacro: what `init` gets for them.

They lie in `$ASSETBUILD_SHARED/data`; the Go1's meshes are those of example-robot-data.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Given:
    """What `init` gets. words: its further arguments; args: those of them that are the xacro's."""

    file: Path
    args: dict[str, str]

    @property
    def words(self) -> list[str]:
        return [word for k, v in self.args.items() for word in ("--arg", f"{k}={v}")]


def xacros() -> list[str]:
    """Names of the robots; [] where the data are not there."""
    return sorted(_GIVEN) if _data() else []


def given(name: str, root: Path, folder: Path) -> Given:
    """The files of one robot; folder: where a package may be put together."""
    data = _data()
    assert data is not None  # `xacros` named it
    return _GIVEN[name](data, root, folder)


def _data() -> Path | None:
    shared = os.environ.get("ASSETBUILD_SHARED")
    data = Path(shared) / "data" if shared else None
    return data if data and data.is_dir() else None


def _ur10e(data: Path, root: Path, folder: Path) -> Given:
    args = {"name": "ur10e", "ur_type": "ur10e"}
    return Given(data / "ur_description/urdf/ur.urdf.xacro", args)


def _go1(data: Path, root: Path, folder: Path) -> Given:
    package = folder / "go1_description"
    if not package.is_dir():
        shutil.copytree(data / "go1_xacro/go1_description", package)
        shutil.copytree(root / "robots/go1_description/meshes", package / "meshes")
    return Given(package / "xacro/robot.xacro", {})


_GIVEN: dict[str, Callable[[Path, Path, Path], Given]] = {
    "xacro/go1": _go1,
    "xacro/ur10e": _ur10e,
}
