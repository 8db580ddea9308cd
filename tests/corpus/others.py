"""Robots of the corpus that are no URDF of example-robot-data.

The xacros lie in `$ASSETBUILD_SHARED/data`; the Go1's meshes are those of example-robot-data.
The MJCFs are mjlab's, in its wheel, unpacked in `$ASSETBUILD_MJLAB`.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from tests.corpus.lists import Robot

_MJCFS = {
    "mjlab/g1": "unitree_g1/xmls/g1.xml",
    "mjlab/go1": "unitree_go1/xmls/go1.xml",
    "mjlab/yam": "i2rt_yam/xmls/yam.xml",
}


def others(root: Path, work: Path) -> list[Robot]:
    """The robots whose data are there; work: where a package may be put together."""
    data, mjlab = _folder("ASSETBUILD_SHARED", "data"), _folder("ASSETBUILD_MJLAB", "")
    found = [_go1(data, root, work), _ur10e(data)] if data else []
    if mjlab:
        robots = mjlab / "mjlab/asset_zoo/robots"
        found += [Robot(name, robots / path, mjlab) for name, path in _MJCFS.items()]
    return found


def _folder(variable: str, below: str) -> Path | None:
    named = os.environ.get(variable)
    return Path(named) / below if named and (Path(named) / below).is_dir() else None


def _ur10e(data: Path) -> Robot:
    folder = data / "ur_description"
    args = {"name": "ur10e", "ur_type": "ur10e"}
    return Robot("xacro/ur10e", folder / "urdf/ur.urdf.xacro", folder, args)


def _go1(data: Path, root: Path, work: Path) -> Robot:
    package = work / "go1_description"
    if not package.is_dir():
        shutil.copytree(data / "go1_xacro/go1_description", package)
        shutil.copytree(root / "robots/go1_description/meshes", package / "meshes")
    return Robot("xacro/go1", package / "xacro/robot.xacro", package)
