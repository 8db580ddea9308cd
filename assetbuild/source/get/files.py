"""A robot's files as references into the graph: of an archive or of a folder."""

from __future__ import annotations

import json
import posixpath
from collections.abc import Collection, Iterable
from pathlib import Path, PurePosixPath

from assetbuild.engine.graph import Ref
from assetbuild.engine.planner import Planner
from assetbuild.errors import SourceError, Where, did_you_mean
from assetbuild.recipe.source import Source
from assetbuild.recipe.validation import KeyedError
from assetbuild.source.get.archive import ListArchive, Unpack

MESHES = "unpack meshes"
"""The one label of unpacking that is not light: see `pipeline.check`."""
BUNDLE_FILES = ("manifest.json", "provenance.json")
"""A folder that holds these is a bundle, and no part of a robot's source."""
LICENSES = ("license", "licence", "copying")
"""How the names of licence texts begin, in whatever case."""


def left_out(name: str, but: tuple[str, ...]) -> bool:
    """Whether a file ends with one of `but`, or is hidden where something is left out."""
    return bool(but) and (name.startswith(".") or name.lower().endswith(but))


class ArchiveFiles:
    """A zip or tar, wherever it came from; only what the recipe needs is unpacked."""

    def __init__(self, archive: Ref, root: str, description: str, p: Planner) -> None:
        self._archive, self._root, self._p = archive, root, p
        self._above = {parent.as_posix() for parent in PurePosixPath(description).parents}
        listed = p.add("list_archive", ListArchive(root=root), {"archive": archive})
        answer = p.ask(listed["listing.json"])
        listing = json.loads(answer) if answer is not None else {}
        self._listed = answer is not None
        self._files = listing.get("files", ())
        # Links are never followed, so never among what may be included.
        self._regular = set(self._files) - set(listing.get("links", ()))
        self._of_wheel = listing.get("licenses", ())

    def _unpacked(self, label: str, root: str, paths: Iterable[str]) -> dict[str, Ref]:
        """The files by path, unpacked by one step."""
        members = tuple(sorted(paths))
        if not members:
            return {}
        step = Unpack(root=root, members=members)
        folder = self._p.add(label, step, {"archive": self._archive})["files/"]
        return {path: folder / path for path in members}

    def _require(self, path: str, where: Where, what: str) -> None:
        if path not in self._files:
            hint = did_you_mean(path, self._files)
            raise SourceError(f"{what}: no file `{path}` in the source", where=where, hint=hint)

    def description(self, path: str, where: Where) -> Ref | None:
        """The description below the root; None while that is not known yet."""
        if not self._listed:
            return None
        self._require(path, where, "the robot's description")
        return self._unpacked("unpack description", self._root, (path,))[path]

    def meshes(self, listing: list[dict[str, str]], urdf: str) -> dict[str, Ref] | None:
        """The files that `meshes.json` of the reader lists, by path; None: not known yet."""
        for entry in listing:
            where = Where(urdf, int(entry["line"]))
            self._require(entry["path"], where, f"{entry['subject']}: mesh")
        return self._unpacked(MESHES, self._root, (entry["path"] for entry in listing))

    def below(
        self, folders: tuple[str, ...], suffixes: tuple[str, ...], but: tuple[str, ...] = ()
    ) -> dict[str, Ref] | None:
        """All files below the folders with one of the suffixes, by path; None: not known yet.

        suffixes: () = any; but: suffixes of those that are left out, hidden ones are as well.
        """
        if not self._listed:
            return None
        prefixes = tuple("" if folder == "." else f"{folder}/" for folder in folders)
        inside = [path for path in self._regular if path.startswith(prefixes)]
        wanted = [
            path
            for path in inside
            if path.lower().endswith(suffixes or "") and not left_out(PurePosixPath(path).name, but)
        ]
        return self._unpacked("unpack includes", self._root, wanted)

    def present(self, what: str, paths: Collection[str]) -> dict[str, Ref] | None:
        """Those of the paths that are files of the source; None: not known yet.

        what: they are, in two words; each question has its own.
        """
        if not self._listed:
            return None
        return self._unpacked(f"unpack {what}", self._root, set(paths) & self._regular)

    def licenses(self) -> dict[str, Ref]:
        """Licence texts that come with the robot, by path."""
        of_wheel = self._unpacked("unpack licences", ".", self._of_wheel)
        places = map(PurePosixPath, self._regular)
        named = (place for place in places if place.name.lower().startswith(LICENSES))
        beside = [str(place) for place in named if str(place.parent) in self._above]
        return of_wheel | self._unpacked("unpack licences of the robot", self._root, beside)


class FolderFiles:
    """`source.path`: files are read where they lie, each by its own digest."""

    def __init__(self, source: Source, folder: Path, p: Planner) -> None:
        self._description, self._p, self._world = source.description, p, p.world
        # Not resolved: a link on the way that leads elsewhere tomorrow is asked for again.
        self.root = self._world.plain(folder / (source.path or "") / source.root)
        self._real = self._world.real(self.root)
        if not self._world.is_folder(self.root):
            raise KeyedError(
                ("source", "path"),
                f"no folder or archive `{source.path}`",
                "paths are relative to the recipe's folder",
            )

    def file(self, path: str, where: Where, what: str) -> Ref:
        """The file at `path` below the root; SourceError names `where` it was asked for."""
        full = self.root / path
        if not self._world.is_file(full):
            beside = self._world.names(full.parent)
            near = [(PurePosixPath(path).parent / name).as_posix() for name in beside]
            hint = did_you_mean(path, near) or "check `source.root` and `source.packages`"
            if what.endswith(": mesh"):
                hint += "; or, to build without a visual, name it under `source.missing.visuals`"
            raise SourceError(f"{what}: no file `{path}` in the source", where=where, hint=hint)
        if not self._holds(full):
            raise SourceError(
                f"{what}: `{path}` is a link that leads out of the source",
                where=where,
                hint="copy the file into the source, or widen `source.path`",
            )
        return self._p.source(full)

    def description(self, path: str, where: Where) -> Ref | None:
        """See `ArchiveFiles`."""
        return self.file(path, where, "the robot's description")

    def meshes(self, listing: list[dict[str, str]], urdf: str) -> dict[str, Ref] | None:
        """See `ArchiveFiles`."""
        return {
            entry["path"]: self.file(
                entry["path"], Where(urdf, int(entry["line"])), f"{entry['subject']}: mesh"
            )
            for entry in listing
        }

    def below(
        self, folders: tuple[str, ...], suffixes: tuple[str, ...], but: tuple[str, ...] = ()
    ) -> dict[str, Ref] | None:
        """See `ArchiveFiles`. Links that lead out of the source, or nowhere, are not among them."""
        paths = {}
        for folder in folders:
            for path in self._world.below(self.root / folder, suffixes, but, self._is_built):
                if self._is_inside(path):
                    paths[path.relative_to(self.root).as_posix()] = path
        return {name: self._p.source(path) for name, path in sorted(paths.items())}

    def _is_built(self, folder: Path) -> bool:
        """Whether a build left it there: a bundle, or what it set aside of one."""
        bundle = all(self._world.is_file(folder / name) for name in BUNDLE_FILES)
        return bundle or folder.name.endswith(".edited")

    def present(self, what: str, paths: Collection[str]) -> dict[str, Ref] | None:
        """See `ArchiveFiles`. A link that leads out of the source is not there."""
        full_paths = ((path, self.root / path) for path in sorted(paths))
        return {path: self._p.source(full) for path, full in full_paths if self._is_inside(full)}

    def _is_inside(self, path: Path) -> bool:
        return self._world.is_file(path) and self._holds(path)

    def _holds(self, path: Path) -> bool:
        """Whether it lies in the source behind all links."""
        return self._world.real(path).is_relative_to(self._real)

    def licenses(self) -> dict[str, Ref]:
        """See `ArchiveFiles`."""
        licenses = {}
        for folder in PurePosixPath(self._description).parents:
            for name in self._world.names(self.root / folder, starts=LICENSES):
                path = posixpath.normpath(folder / name)
                if self._world.is_file(self.root / path):
                    licenses[path] = self._p.source(self.root / path)
        return licenses
