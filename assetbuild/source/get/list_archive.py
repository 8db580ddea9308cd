"""What lies in an archive, without unpacking it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import ClassVar

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import SourceError, did_you_mean
from assetbuild.findings import Finding
from assetbuild.source.get.archive import Members, below, open_archive, printable, why_unsafe

_LICENSE = re.compile(
    r"[^/]+\.dist-info/(licen[cs]es/.+|(licen[cs]e|copying|notice|authors)[^/]*)", re.IGNORECASE
)


class ListArchive(Step):
    """`listing.json`: the files below `root` with their sizes, and the licence texts.

    {"files": [[path relative to root, bytes], ...], "licenses": [path in the archive, ...],
    "links": [path relative to root, ...]}, all sorted. links: those of `files` that are no regular
    files; `unpack` refuses them by name.
    """

    outputs = ("listing.json",)
    isolated = True
    limits: ClassVar[Limits] = Limits(wall_s=120, memory_mb=2048)

    root: str = "."
    """Folder inside the archive; `.` = all of it."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `archive`; SourceError for a broken archive, an unsafe name, a missing root."""
        with open_archive(files.inputs / "archive") as members:
            odd = [m.path for m in members if m.kind not in ("file", "folder")]
            listing = {
                "files": [[path, size] for path, size in _files_below(members, self.root)],
                "licenses": _licenses(members),
                "links": sorted({path for name in odd if (path := below(self.root, name))}),
            }
        text = json.dumps(listing, separators=(",", ":"))
        (files.outputs / "listing.json").write_text(text + "\n", encoding="ascii")
        yield from ()


def _files_below(members: Members, root: str) -> list[tuple[str, int]]:
    files: set[tuple[str, int]] = set()
    for member in members:
        path = below(root, member.path)
        if path is None or member.kind == "folder":
            continue
        reason = why_unsafe(member.path)
        if reason:
            raise SourceError(f"archive: member `{printable(member.path)}` has {reason}")
        files.add((path, member.size))
    if not files:
        raise _no_root(members, root)
    return sorted(files)


def _licenses(members: Members) -> list[str]:
    licenses = {
        member.path
        for member in members
        if member.kind == "file" and _LICENSE.fullmatch(member.path) and not why_unsafe(member.path)
    }
    return sorted(licenses)


def _no_root(members: Members, root: str) -> SourceError:
    folders = set()
    for member in members:
        parts = member.path.split("/")[:-1]
        folders |= {"/".join(parts[:n]) for n in range(1, min(len(parts), 6) + 1)}
    hint = did_you_mean(root, folders) if folders else "the archive has no folders"
    return SourceError(f"archive: no file below the folder `{printable(root)}`", hint=hint)
