"""An archive as a source: listed first, then unpacked member by member."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable
from pathlib import PurePosixPath

from assetbuild.engine.graph import Ref
from assetbuild.engine.planner import Planner
from assetbuild.errors import SourceError, Where, did_you_mean
from assetbuild.source.get.list_archive import ListArchive
from assetbuild.source.get.unpack import Unpack

MESHES = "unpack meshes"
"""The one label of unpacking that is not light: see `pipeline.check`."""
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
        self._files = [path for path, _ in listing.get("files", ())]
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
        """See `SourceFiles`."""
        if not self._listed:
            return None
        self._require(path, where, "the robot's description")
        return self._unpacked("unpack description", self._root, (path,))[path]

    def meshes(self, listing: list[dict[str, str]], urdf: str) -> dict[str, Ref] | None:
        """See `SourceFiles`."""
        for entry in listing:
            where = Where(urdf, int(entry["line"]))
            self._require(entry["path"], where, f"{entry['subject']}: mesh")
        return self._unpacked(MESHES, self._root, (entry["path"] for entry in listing))

    def below(
        self, folders: tuple[str, ...], suffixes: tuple[str, ...], but: tuple[str, ...] = ()
    ) -> dict[str, Ref] | None:
        """See `SourceFiles`."""
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
        """See `SourceFiles`."""
        if not self._listed:
            return None
        return self._unpacked(f"unpack {what}", self._root, set(paths) & self._regular)

    def licenses(self) -> dict[str, Ref]:
        """See `SourceFiles`."""
        of_wheel = self._unpacked("unpack licences", ".", self._of_wheel)
        beside = filter(self._is_license, self._regular)
        return of_wheel | self._unpacked("unpack licences of the robot", self._root, beside)

    def _is_license(self, path: str) -> bool:
        """A licence text in a folder above the description."""
        place = PurePosixPath(path)
        return place.parent.as_posix() in self._above and place.name.lower().startswith(LICENSES)
