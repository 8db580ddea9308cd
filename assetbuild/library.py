"""The robots that travel with the package: a recipe and its lock for each."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path

from assetbuild.errors import UsageError, did_you_mean

INSTALLED = Path(__file__).with_name("_recipes")
"""Where a wheel puts the folder `recipes` of the repository."""


def robots() -> Mapping[str, Path]:
    """Name -> recipe, in the order of the names."""
    folder = INSTALLED if INSTALLED.is_dir() else Path(__file__).parents[1] / "recipes"
    paths = (path for path in sorted(folder.glob("*.yaml")) if ".lock" not in path.name)
    return {path.stem: path for path in paths}


def recipe(name: str) -> Path:
    """The recipe of a robot. UsageError for a name that no robot has."""
    known = robots()
    if name not in known:
        hint = did_you_mean(name, known) or "`assetbuild list` prints all of them"
        raise UsageError(f"the library has no robot `{name}`", hint=hint)
    return known[name]


def sentence(path: Path) -> str:
    """What a recipe of the library says of its robot, in its first comment but one."""
    return path.read_text(encoding="utf-8").splitlines()[1].removeprefix("# ")


def copy(name: str, out: Path) -> None:
    """Write a robot's recipe as `out`, with its lock and what it names beside it.

    UsageError where one of these files exists.
    """
    files = dict(_files(recipe(name), out))
    for path in files:
        if path.exists():
            raise UsageError(f"`{path}` exists", hint="name another file: `-o FOLDER/robot.yaml`")
    out.parent.mkdir(parents=True, exist_ok=True)
    for path, origin in files.items():
        if origin.is_dir():
            shutil.copytree(origin, path)
        else:
            text = origin.read_text(encoding="utf-8").replace("../docs/reference/", "")
            path.write_text(text.replace(f"recipes/{origin.name}", str(path)), encoding="utf-8")


def _files(origin: Path, out: Path) -> Iterator[tuple[Path, Path]]:
    """(copy, original) of a recipe, its lock, and of sources and parts that it names beside it."""
    import yaml

    yield out, origin
    lock = origin.with_suffix(".lock.yaml")
    if lock.is_file():
        yield out.with_suffix(".lock.yaml"), lock
    content = yaml.safe_load(origin.read_text(encoding="utf-8"))
    parts = [part.get("recipe") for part in content.get("compose", [])]
    for name in filter(None, [content["source"].get("path"), *parts]):
        beside = origin.parent / name
        if beside.suffix == ".yaml":
            yield from _files(beside, out.parent / name)
        elif beside.is_dir():
            yield out.parent / name, beside
