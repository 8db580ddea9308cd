"""Robots of the corpus that are no URDF: what `init` gets for them.

The xacros lie in `$ASSETBUILD_SHARED/data`; the Go1's meshes are those of example-robot-data.
The MJCFs are mjlab's, in its wheel, unpacked in `$ASSETBUILD_MJLAB`.
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


def others() -> list[str]:
    """Names of the robots whose data are there."""
    return [*(sorted(_XACROS) if _data() else []), *(sorted(_MJCFS) if _mjlab() else [])]


def given(name: str, root: Path, folder: Path) -> Given:
    """The files of one robot; folder: where a package may be put together."""
    data, mjlab = _data(), _mjlab()
    if mjlab and name in _MJCFS:
        return Given(mjlab / "mjlab/asset_zoo/robots" / _MJCFS[name], {})
    assert data is not None  # `others` named it
    return _XACROS[name](data, root, folder)


def _mjlab() -> Path | None:
    wheel = os.environ.get("ASSETBUILD_MJLAB")
    return Path(wheel) if wheel and Path(wheel).is_dir() else None


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


_MJCFS = {
    "mjlab/g1": "unitree_g1/xmls/g1.xml",
    "mjlab/go1": "unitree_go1/xmls/go1.xml",
    "mjlab/yam": "i2rt_yam/xmls/yam.xml",
}
_XACROS: dict[str, Callable[[Path, Path, Path], Given]] = {
    "xacro/go1": _go1,
    "xacro/ur10e": _ur10e,
}
