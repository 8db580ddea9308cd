"""Archives as lists of members that are safe to look at; unpacking is in `unpack.py`.

One reader per format behind `open_archive`: it names the members, in the archive's order, says
what each one is, and streams it. Formats never write.
"""

from __future__ import annotations

import stat
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Literal, Protocol

from assetbuild.errors import SourceError

Kind = Literal["file", "folder", "link", "special"]

READ_ERRORS = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    NotImplementedError,
    OSError,
    RuntimeError,
    ValueError,
)
"""What reading a broken or foreign archive raises."""


@dataclass(frozen=True)
class Member:
    """One entry as the archive states it. packed, size: bytes; index: place in the archive."""

    path: str
    kind: Kind
    size: int
    packed: int
    encrypted: bool
    index: int


class Archive(Protocol):
    """What every archive format offers."""

    members: tuple[Member, ...]

    def open(self, member: Member) -> IO[bytes]:
        """A stream of the member's bytes; raises one of `READ_ERRORS`."""
        ...


class _Zip:
    def __init__(self, file: zipfile.ZipFile) -> None:
        self._file = file
        self._infos = file.infolist()
        self.members = tuple(_zip_member(i, info) for i, info in enumerate(self._infos))

    def open(self, member: Member) -> IO[bytes]:
        return self._file.open(self._infos[member.index])


def _zip_member(index: int, info: zipfile.ZipInfo) -> Member:
    mode = info.external_attr >> 16
    form = stat.S_IFMT(mode) if info.create_system == 3 else 0  # 3 = Unix
    kind: Kind = "file"
    if stat.S_ISLNK(form):
        kind = "link"
    elif form not in (0, stat.S_IFREG, stat.S_IFDIR):
        kind = "special"
    elif info.filename.endswith("/") or form == stat.S_IFDIR:
        kind = "folder"
    # orig_filename: zipfile itself cuts names at a NUL, which would hide what was meant.
    return Member(
        path=info.orig_filename,
        kind=kind,
        size=info.file_size,
        packed=info.compress_size,
        encrypted=bool(info.flag_bits & 1),
        index=index,
    )


@contextmanager
def open_archive(path: Path) -> Iterator[Archive]:
    """The archive in a file; SourceError when it is none of the formats that we read."""
    try:
        file = zipfile.ZipFile(path)
    except READ_ERRORS as problem:
        message = f"the archive cannot be read: {problem}"
        hint = "only zip archives (wheels) are read; was the download cut off?"
        raise SourceError(message, hint=hint) from None
    with file:
        yield _Zip(file)


def why_unsafe(path: str) -> str:
    """Why a member's name must not become a path below a folder of ours, or ""."""
    parts = path.removesuffix("/").split("/")
    if path.startswith("/") or (len(path) > 1 and path[1] == ":"):
        return "an absolute path"
    if ".." in parts:
        return "a path that leads outside"
    if "\\" in path or any(ord(c) < 32 or ord(c) == 127 for c in path):
        return "a backslash or control character in the path"
    if any(part in ("", ".") for part in parts):
        return "an empty part in the path"
    if any(len(part.encode("utf-8", "surrogateescape")) > 255 for part in parts):
        return "a name of more than 255 bytes"
    return ""


def below(root: str, path: str) -> str | None:
    """`path` relative to the folder `root` of the archive (`.` = all), None when not below."""
    if root in (".", ""):
        return path
    prefix = root.rstrip("/") + "/"
    return path[len(prefix) :] if path.startswith(prefix) and path != prefix else None


def printable(path: str) -> str:
    """A member's name for a message: short, no control characters."""
    text = path.encode("unicode_escape").decode("ascii") if not path.isprintable() else path
    return text if len(text) <= 120 else f"{text[:117]}..."
