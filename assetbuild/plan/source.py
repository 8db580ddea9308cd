"""Where the robot's files come from, as references into the graph."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Protocol

from assetbuild.engine.graph import Node, Planner, Ref
from assetbuild.errors import RecipeError, SourceError, Where, did_you_mean
from assetbuild.lock import Lock
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.steps.fetch import Fetch
from assetbuild.steps.list_archive import ListArchive
from assetbuild.steps.unpack import Unpack


@dataclass(frozen=True)
class Description:
    """The robot's description: its path below the source's root, and its file."""

    path: str
    ref: Ref


class Source(Protocol):
    """A robot's files, each as a reference into the graph. Errors name who asked for a file."""

    def description(self, path: str, where: Where) -> Ref | None:
        """The description below the root; None while that is not known yet."""
        ...

    def meshes(self, listing: list[dict[str, str]], urdf: str) -> dict[str, Ref] | None:
        """The files that `meshes.json` of the reader lists, by path; None: not known yet."""
        ...

    def licenses(self) -> dict[str, Ref]:
        """Licence texts that come with the robot, by path."""
        ...


class FolderSource:
    """`source.path`: files are read where they lie, each by its own digest."""

    def __init__(self, loaded: LoadedRecipe, p: Planner) -> None:
        recipe_dir = loaded.path.parent
        self._loaded, self._p = loaded, p
        self.root = (
            recipe_dir / (loaded.recipe.source.path or "") / loaded.recipe.source.root
        ).resolve()
        if not self.root.is_dir():
            key = ("source", "path")
            raise RecipeError(
                f"source.path: no folder `{loaded.recipe.source.path}`",
                where=loaded.where(key),
                hint="paths are relative to the recipe's folder",
            )

    def file(self, path: str, where: Where, what: str) -> Ref:
        """The file at `path` below the root; SourceError names `where` it was asked for."""
        full = self.root / path
        if not full.is_file():
            near = [str(PurePosixPath(path).parent / f.name) for f in full.parent.glob("*")]
            hint = did_you_mean(path, near) or "check `source.root` and `source.packages`"
            raise SourceError(f"{what}: no file `{path}` in the source", where=where, hint=hint)
        if not full.resolve().is_relative_to(self.root):
            raise SourceError(
                f"{what}: `{path}` is a link that leads out of the source",
                where=where,
                hint="copy the file into the source, or widen `source.path`",
            )
        return self._p.source(full)

    def description(self, path: str, where: Where) -> Ref | None:
        """See `Source`."""
        return self.file(path, where, "the robot's description")

    def meshes(self, listing: list[dict[str, str]], urdf: str) -> dict[str, Ref] | None:
        """See `Source`."""
        return {
            entry["path"]: self.file(
                entry["path"], Where(urdf, int(entry["line"])), f"{entry['subject']}: mesh"
            )
            for entry in listing
        }

    def licenses(self) -> dict[str, Ref]:
        """See `Source`."""
        urdf = self.root / (self._loaded.recipe.source.urdf or "")
        folders = [f for f in (urdf.parent, *urdf.parents) if f.is_relative_to(self.root)]
        found = {}
        for folder in folders:
            for path in sorted(folder.glob("LICEN[CS]E*")):
                if path.is_file():
                    found[path.relative_to(self.root).as_posix()] = self._p.source(path)
        return found


class WheelSource:
    """`source.pypi`: a pinned archive; only what the recipe needs is unpacked."""

    def __init__(self, loaded: LoadedRecipe, lock: Lock, p: Planner) -> None:
        self._loaded, self._p = loaded, p
        self._root = loaded.recipe.source.root
        pin = lock.source
        self._archive = p.add(
            "fetch",
            Fetch(name=pin.name, release=pin.version, filename=pin.file, sha256=pin.sha256),
            {},
        )["archive"]
        listed = p.add("list_archive", ListArchive(root=self._root), {"archive": self._archive})
        answer = p.ask(listed["listing.json"])
        self._listing: dict[str, list[str]] | None = None
        if answer is not None:
            raw = json.loads(answer)
            self._listing = {
                "files": [path for path, _ in raw["files"]],
                "licenses": raw["licenses"],
            }

    def _unpack(self, label: str, root: str, members: tuple[str, ...]) -> Node:
        return self._p.add(label, Unpack(root=root, members=members), {"archive": self._archive})

    def _require(self, path: str, where: Where, what: str) -> None:
        assert self._listing is not None  # noqa: S101 # callers return early without a listing
        if path not in self._listing["files"]:
            hint = did_you_mean(path, self._listing["files"])
            raise SourceError(f"{what}: no file `{path}` in the source", where=where, hint=hint)

    def description(self, path: str, where: Where) -> Ref | None:
        """See `Source`."""
        if self._listing is None:
            return None
        self._require(path, where, "the robot's description")
        return self._unpack("unpack description", self._root, (path,))["files/"] / path

    def meshes(self, listing: list[dict[str, str]], urdf: str) -> dict[str, Ref] | None:
        """See `Source`."""
        for entry in listing:
            where = Where(urdf, int(entry["line"]))
            self._require(entry["path"], where, f"{entry['subject']}: mesh")
        paths = tuple(sorted(entry["path"] for entry in listing))
        if not paths:
            return {}
        unpacked = self._unpack("unpack meshes", self._root, paths)["files/"]
        return {path: unpacked / path for path in paths}

    def licenses(self) -> dict[str, Ref]:
        """See `Source`."""
        if self._listing is None:
            return {}
        paths = tuple(self._listing["licenses"])
        if not paths:
            return {}
        unpacked = self._unpack("unpack licences", ".", paths)["files/"]
        return {path: unpacked / path for path in paths}


def open_source(loaded: LoadedRecipe, lock: Lock | None, p: Planner) -> Source:
    """The source that the recipe names. RecipeError when a folder is not there."""
    if loaded.recipe.source.pypi is None:
        return FolderSource(loaded, p)
    assert lock is not None  # noqa: S101 # the pipeline pins moving sources first
    return WheelSource(loaded, lock, p)


def description_of(loaded: LoadedRecipe, source: Source) -> Description | None:
    """The robot's description; None while the source is not listed yet."""
    path = str(loaded.recipe.source.urdf)
    ref = source.description(path, loaded.where(("source", "urdf")))
    return Description(path, ref) if ref is not None else None
