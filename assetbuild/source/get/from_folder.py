"""A folder as a source: files are read where they lie."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from pathlib import Path, PurePosixPath

from assetbuild.engine.graph import Ref
from assetbuild.engine.planner import Planner
from assetbuild.errors import RecipeError, SourceError, Where, did_you_mean
from assetbuild.recipe.loader import LoadedRecipe


class FolderFiles:
    """`source.path`: files are read where they lie, each by its own digest."""

    def __init__(self, loaded: LoadedRecipe, p: Planner) -> None:
        recipe_dir = loaded.path.parent
        self._loaded, self._p = loaded, p
        self._absent: list[Path] = []
        self.root = (
            recipe_dir / (loaded.recipe.source.path or "") / loaded.recipe.source.root
        ).resolve()
        if not self.root.is_dir():
            key = ("source", "path")
            raise RecipeError(
                f"source.path: no folder or archive `{loaded.recipe.source.path}`",
                where=loaded.where(key),
                hint="paths are relative to the recipe's folder",
            )

    def file(self, path: str, where: Where, what: str) -> Ref:
        """The file at `path` below the root; SourceError names `where` it was asked for."""
        full = self.root / path
        if not is_file(full):
            near = [str(PurePosixPath(path).parent / f.name) for f in full.parent.glob("*")]
            hint = did_you_mean(path, near) or "check `source.root` and `source.packages`"
            raise SourceError(f"{what}: no file `{path}` in the source", where=where, hint=hint)
        if not self._holds(full):
            raise SourceError(
                f"{what}: `{path}` is a link that leads out of the source",
                where=where,
                hint="copy the file into the source, or widen `source.path`",
            )
        return self._p.source(full)

    def description(self, path: str, where: Where) -> Ref | None:
        """See `SourceFiles`."""
        return self.file(path, where, "the robot's description")

    def meshes(self, listing: list[dict[str, str]], urdf: str) -> dict[str, Ref] | None:
        """See `SourceFiles`."""
        return {
            entry["path"]: self.file(
                entry["path"], Where(urdf, int(entry["line"])), f"{entry['subject']}: mesh"
            )
            for entry in listing
        }

    def below(self, folders: tuple[str, ...], suffixes: tuple[str, ...]) -> dict[str, Ref] | None:
        """See `SourceFiles`. Links that lead out of the source, or nowhere, are not among them."""
        found = {}
        for folder in folders:
            for path in _files_below(self.root / folder):
                if path.suffix.lower() in suffixes and is_file(path) and self._holds(path):
                    name = Path(os.path.normpath(path)).relative_to(self.root).as_posix()
                    found[name] = path
        return {name: self._p.source(path) for name, path in sorted(found.items())}

    def present(self, what: str, paths: Collection[str]) -> dict[str, Ref] | None:
        """See `SourceFiles`. A link that leads out of the source is not there."""
        found = {}
        for path in sorted(paths):
            full = self.root / path
            if is_file(full) and self._holds(full):
                found[path] = self._p.source(full)
            elif not os.path.lexists(full):
                self._absent.append(full)
        return found

    def _holds(self, path: Path) -> bool:
        """Behind all links; `resolve` would raise on a loop of them."""
        return Path(os.path.realpath(path)).is_relative_to(self.root)

    @property
    def absent(self) -> tuple[Path, ...]:
        """See `SourceFiles`."""
        return tuple(self._absent)

    def licenses(self) -> dict[str, Ref]:
        """See `SourceFiles`."""
        urdf = self.root / (self._loaded.recipe.source.description)
        folders = [f for f in (urdf.parent, *urdf.parents) if f.is_relative_to(self.root)]
        found = {}
        for folder in folders:
            for path in sorted(folder.glob("LICEN[CS]E*")):
                if path.is_file():
                    found[path.relative_to(self.root).as_posix()] = self._p.source(path)
        return found


def is_file(path: Path) -> bool:
    """A name that is too long for the disk is that of no file; pathlib raises."""
    try:
        return path.is_file()
    except OSError:
        return False


def _files_below(folder: Path) -> Iterator[Path]:
    for here, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield from (Path(here) / name for name in sorted(names))
