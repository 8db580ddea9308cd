"""An archive as a source: listed first, then unpacked member by member."""

from __future__ import annotations

import json
import re
from collections.abc import Collection
from pathlib import Path, PurePosixPath

from assetbuild.engine.graph import Node, Ref
from assetbuild.engine.planner import Planner
from assetbuild.errors import SourceError, Where, did_you_mean
from assetbuild.source.get.list_archive import ListArchive
from assetbuild.source.get.unpack import Unpack

MESHES = "unpack meshes"
"""The one label of unpacking that is not light: see `pipeline.check`."""
_LICENSE = re.compile(r"(licen[cs]e|copying)[^/]*", re.IGNORECASE)


class ArchiveSource:
    """A zip or tar, wherever it came from; only what the recipe needs is unpacked."""

    def __init__(self, archive: Ref, root: str, description: str, p: Planner) -> None:
        self._archive, self._root, self._p = archive, root, p
        self._above = {parent.as_posix() for parent in PurePosixPath(description).parents}
        listed = p.add("list_archive", ListArchive(root=root), {"archive": archive})
        answer = p.ask(listed["listing.json"])
        self._listing: dict[str, list[str]] | None = None
        if answer is not None:
            raw = json.loads(answer)
            self._listing = {
                "files": [path for path, _ in raw["files"]],
                "licenses": raw["licenses"],
                "links": raw["links"],
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
        unpacked = self._unpack(MESHES, self._root, paths)["files/"]
        return {path: unpacked / path for path in paths}

    def below(self, folders: tuple[str, ...], suffixes: tuple[str, ...]) -> dict[str, Ref] | None:
        """See `Source`."""
        if self._listing is None:
            return None
        links = set(self._listing["links"])  # never followed, so never among what may be included
        prefixes = tuple("" if folder == "." else f"{folder}/" for folder in folders)
        paths = tuple(
            path
            for path in self._listing["files"]
            if path.startswith(prefixes) and path.lower().endswith(suffixes) and path not in links
        )
        if not paths:
            return {}
        unpacked = self._unpack("unpack includes", self._root, paths)["files/"]
        return {path: unpacked / path for path in paths}

    def present(self, what: str, paths: Collection[str]) -> dict[str, Ref] | None:
        """See `Source`."""
        if self._listing is None:
            return None
        known = set(self._listing["files"]) - set(self._listing["links"])
        there = tuple(sorted(set(paths) & known))
        if not there:
            return {}
        unpacked = self._unpack(f"unpack {what}", self._root, there)["files/"]
        return {path: unpacked / path for path in there}

    @property
    def absent(self) -> tuple[Path, ...]:
        """See `Source`: an archive does not change."""
        return ()

    def licenses(self) -> dict[str, Ref]:
        """See `Source`."""
        if self._listing is None:
            return {}
        of_wheel = tuple(self._listing["licenses"])
        links = set(self._listing["links"])
        beside = tuple(
            path for path in self._listing["files"] if path not in links and self._is_license(path)
        )
        found = {}
        for label, root, paths in (
            ("unpack licences", ".", of_wheel),
            ("unpack licences of the robot", self._root, beside),
        ):
            if paths:
                unpacked = self._unpack(label, root, paths)["files/"]
                found.update({path: unpacked / path for path in paths})
        return found

    def _is_license(self, path: str) -> bool:
        """A licence text in a folder above the description."""
        place = PurePosixPath(path)
        return place.parent.as_posix() in self._above and bool(_LICENSE.fullmatch(place.name))
