"""Named members of an archive, unpacked safely: nothing outside, no links, no bombs."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import SourceError, did_you_mean
from assetbuild.findings import Finding
from assetbuild.source.get.archive import (
    READ_ERRORS,
    Member,
    Members,
    below,
    open_archive,
    printable,
    why_unsafe,
)

MAX_FILE = 1 << 30
MAX_TOTAL = 4 << 30
MAX_RATIO = 200
RATIO_FROM = 10 << 20
"""Below this size a high ratio is harmless: repeated text in a small file."""
_CHUNK = 1 << 20


class Unpack(Step):
    """`files/`: each of `members` (paths relative to `root`) at its relative path."""

    outputs = ("files/",)
    isolated = True
    limits: ClassVar[Limits] = Limits(wall_s=600, memory_mb=2048, file_mb=MAX_FILE >> 20)

    root: str = "."
    """Folder inside the archive; `.` = all of it."""
    members: tuple[str, ...]
    """Files to unpack, relative to `root`."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `archive`; SourceError names the member that is missing, unsafe or broken."""
        folder = files.outputs / "files"
        folder.mkdir(exist_ok=True)
        path = files.inputs / "archive"
        with open_archive(path) as members:
            wanted = _wanted(members, self.root, self.members)
            _check_sizes(wanted, path.stat().st_size)
            for relative in sorted(wanted):
                _write(wanted[relative], folder / relative)
        yield from ()


def _wanted(stated: Members, root: str, members: tuple[str, ...]) -> dict[str, Member]:
    """The member behind each path; SourceError for what is missing, twice there, or unsafe."""
    asked = set(members)
    by_path: dict[str, Member] = {}
    for member in stated:
        path = below(root, member.path)
        if path is None or path not in asked:
            continue
        _check_member(member)
        if path in by_path:
            raise _bad(member, "is there twice")
        by_path[path] = member
    missing = sorted(asked - by_path.keys())
    if missing:
        known = [p for m in stated if (p := below(root, m.path)) and m.kind == "file"]
        message = f"archive: no file `{printable(missing[0])}` below `{root}`"
        raise SourceError(message, hint=did_you_mean(missing[0], known))
    _check_collisions(by_path)
    return by_path


def _check_member(member: Member) -> None:
    """SourceError for a name that leads elsewhere, and for what is no regular file."""
    if reason := why_unsafe(member.path):
        raise _bad(member, f"has {reason}")
    if member.kind == "link":
        raise _bad(member, "is a symbolic link", "links are not followed; name the file itself")
    if member.kind != "file":
        raise _bad(
            member, "is encrypted" if member.kind == "encrypted" else "is not a regular file"
        )


def _check_collisions(members: dict[str, Member]) -> None:
    """Names that are one file on some disks, and files that other files need as a folder."""
    seen: dict[str, str] = {}
    for path in sorted(members):
        same = _on_any_disk(path)
        if same in seen:
            other = printable(seen[same])
            raise _bad(members[path], f"and `{other}` differ only in upper and lower case")
        seen[same] = path
    for path in sorted(members):
        parts = _on_any_disk(path).split("/")
        for n in range(1, len(parts)):
            if "/".join(parts[:n]) in seen:
                raise _bad(members[path], "lies below what is itself a file")


def _on_any_disk(path: str) -> str:
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", path).casefold())


def _check_sizes(wanted: dict[str, Member], archive_size: int) -> None:
    total = 0
    for member in wanted.values():
        total += member.size
        if member.size > MAX_FILE:
            raise _bad(member, f"is larger than {MAX_FILE >> 20} MB")
        if member.size > RATIO_FROM and member.size > MAX_RATIO * max(member.packed, 1):
            ratio = member.size // max(member.packed, 1)
            raise _bad(member, f"grows {ratio} times when unpacked, over {MAX_RATIO}")
    # Members that share their packed bytes pass one by one; together they cannot.
    if total > MAX_TOTAL or (total > RATIO_FROM and total > MAX_RATIO * archive_size):
        raise SourceError(
            f"archive: its members would unpack to {total >> 20} MB from {archive_size >> 20} MB",
            hint=f"the limits are {MAX_TOTAL >> 20} MB and {MAX_RATIO} times the archive",
        )


def _write(member: Member, dest: Path) -> None:
    dest.parent.mkdir(parents=True, exist_ok=True)
    written = 0
    with dest.open("xb") as out:
        for chunk in _chunks(member):
            written += len(chunk)
            if written > member.size:
                raise _bad(member, "is longer than the archive says")
            out.write(chunk)
    if written != member.size:
        raise _bad(member, f"is cut off: {written} of {member.size} bytes")


def _chunks(member: Member) -> Iterator[bytes]:
    """Its bytes; SourceError where the archive is broken."""
    try:
        stream = member.open()
        while stream is not None and (chunk := stream.read(_CHUNK)):
            yield chunk
    except READ_ERRORS as problem:
        raise _bad(member, f"cannot be unpacked: {problem}") from None


def _bad(member: Member, what: str, hint: str = "") -> SourceError:
    return SourceError(f"archive: member `{printable(member.path)}` {what}", hint=hint)
