"""The lists of robots: what `init` gets for each, and where its files come from.

`example`: the URDFs of example-robot-data, and what `others` adds. `wide`: `wide.yaml`, robots
of public repositories and packages, each with its commit or version and its licence; a source is
looked for in a folder and fetched when it is not there.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain, zip_longest
from pathlib import Path

import yaml

from assetbuild.engine.machine import cache_root

PACKAGE = "example-robot-data==6.0.0"
ROOT_IN_WHEEL = "cmeel.prefix/share/example-robot-data"
WIDE = Path(__file__).with_name("wide.yaml")


@dataclass(frozen=True)
class Robot:
    """name: unique in its list; root: the folder that holds its files; args: of a xacro."""

    name: str
    file: Path
    root: Path
    args: dict[str, str] = field(default_factory=dict)

    @property
    def words(self) -> list[str]:
        """What `init` gets besides the file."""
        return [word for k, v in self.args.items() for word in ("--arg", f"{k}={v}")]

    @property
    def half(self) -> str:
        """`a` is looked at while we work, `b` only when the work is done."""
        return "ab"[int(hashlib.sha256(self.name.encode()).hexdigest(), 16) % 2]


# --- example-robot-data ---------------------------------------------------------------------


def example(root: Path) -> list[Robot]:
    """All URDFs below `robots`, sorted by their paths there."""
    robots = root / "robots"
    paths = sorted(robots.rglob("*.urdf"), key=lambda path: path.relative_to(robots).as_posix())
    return [Robot(path.relative_to(robots).as_posix(), path, root) for path in paths]


def data_root(stated: Path | None) -> Path:
    """The folder `example-robot-data`."""
    named = stated or os.environ.get("ASSETBUILD_TEST_DATA")
    if named:
        return Path(named) / "example-robot-data"
    return unpacked_wheel(PACKAGE, Path(cache_root()) / "test-data/whole") / ROOT_IN_WHEEL


def unpacked_wheel(requirement: str, folder: Path) -> Path:
    """The folder of a wheel that pip fetches once, unpacked and never installed."""
    done = folder / "unpacked"
    if not done.exists():
        shutil.rmtree(folder, ignore_errors=True)
        pip = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps"]
        only = ["--only-binary", ":all:", "--dest", str(folder)]
        subprocess.run([*pip, *only, requirement], check=True)
        (wheel,) = folder.glob("*.whl")
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(folder)
        wheel.unlink()
        done.touch()
    return folder


def others(root: Path, work: Path) -> list[Robot]:
    """Two xacros and mjlab's MJCFs, where their data are; work: for a package put together.

    The xacros lie in `$ASSETBUILD_SHARED/data`; the Go1's meshes are those of example-robot-data.
    mjlab's wheel is unpacked in `$ASSETBUILD_MJLAB`.
    """
    data, mjlab = _folder("ASSETBUILD_SHARED", "data"), _folder("ASSETBUILD_MJLAB", "")
    found = [_go1(data, root, work), _ur10e(data)] if data else []
    if mjlab:
        robots = mjlab / "mjlab/asset_zoo/robots"
        files = ("unitree_g1/xmls/g1.xml", "unitree_go1/xmls/go1.xml", "i2rt_yam/xmls/yam.xml")
        found += [Robot(f"mjlab/{Path(file).stem}", robots / file, mjlab) for file in files]
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


# --- the wide list --------------------------------------------------------------------------


def wide(sources: Path, list_file: Path = WIDE, half: str = "") -> list[Robot]:
    """One robot of each source, then the second of each, and so on: families come early.

    sources: a folder with one folder for each source.
    """
    stated = yaml.safe_load(list_file.read_text(encoding="utf-8"))["sources"]
    by_source = [list(_robots(source, sources)) for source in stated]
    chosen = ([r for r in robots if half in ("", r.half)] for robots in by_source)
    return [robot for robot in chain(*zip_longest(*chosen)) if robot]


def _robots(source: dict, sources: Path) -> Iterator[Robot]:
    name = source.get("github") or source["pypi"].partition("==")[0]
    root = sources / name.replace("/", "+")
    for stated in source["robots"]:
        entry = {"path": stated} if isinstance(stated, str) else stated
        args = {key: str(value) for key, value in entry.get("args", {}).items()}
        told = "".join(f" {key}={value}" for key, value in args.items())
        yield Robot(f"{name}/{entry['path']}{told}", root / entry["path"], root, args)


def fetch(sources: Path, list_file: Path = WIDE) -> None:
    """Bring what is not there: a commit without its history, a wheel without its dependencies."""
    for source in yaml.safe_load(list_file.read_text(encoding="utf-8"))["sources"]:
        name = source.get("github") or source["pypi"].partition("==")[0]
        folder = sources / name.replace("/", "+")
        if folder.is_dir():
            continue
        part = folder.with_name(folder.name + ".part")
        if "pypi" in source:
            unpacked_wheel(source["pypi"], part)
        else:
            _checked_out(f"https://github.com/{name}.git", source["commit"], part)
        part.rename(folder)


def _checked_out(url: str, commit: str, folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    git = ["git", "-C", str(folder)]
    subprocess.run(["git", "init", "--quiet", str(folder)], check=True)
    subprocess.run([*git, "fetch", "--quiet", "--depth=1", url, commit], check=True)
    subprocess.run([*git, "checkout", "--quiet", "FETCH_HEAD"], check=True)
