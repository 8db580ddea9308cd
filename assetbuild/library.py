"""The robots that travel with the package: a recipe and its lock for each."""

from __future__ import annotations

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


def text(origin: Path, out: Path) -> str:
    """The text of a recipe of the library as it reads in `out`."""
    text = origin.read_text(encoding="utf-8").replace("../docs/reference/", "")
    return text.replace(f"recipes/{origin.name}", str(out))


def copy(name: str, out: Path, *, force: bool = False) -> None:
    """Write a robot's recipe as `out`, with its lock and what it names beside it.

    UsageError where `out` or a file of other content is in the way, unless `force` replaces it.
    """
    files = {path: text(origin, path) for path, origin in _files(recipe(name), out)}
    for path, content in files.items():
        if not force and path.exists() and (path == out or path.read_text("utf-8") != content):
            hint = "name another file: `-o FOLDER/robot.yaml`, or replace it: `--force`"
            raise UsageError(f"`{path}` exists", hint=hint)
    for path, content in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content, encoding="utf-8")


def _files(origin: Path, out: Path) -> Iterator[tuple[Path, Path]]:
    """(copy, original) of a recipe, its lock, and of sources and parts that name files beside it.

    Parts of variants count: a recipe is checked whole.
    """
    import yaml

    yield out, origin
    lock = origin.with_suffix(".lock.yaml")
    if lock.is_file():
        yield out.with_suffix(".lock.yaml"), lock
    content = yaml.safe_load(origin.read_text(encoding="utf-8"))
    variants = content.get("variants", {}).values()
    parts = [part for one in [content, *variants] for part in one.get("compose", [])]
    for name in filter(None, [content["source"].get("path"), *(p.get("recipe") for p in parts)]):
        beside = origin.parent / name
        if beside.suffix == ".yaml":
            yield from _files(beside, out.parent / name)
        for path in filter(Path.is_file, beside.rglob("*")):
            yield out.parent / name / path.relative_to(beside), path
