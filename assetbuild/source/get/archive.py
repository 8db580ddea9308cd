"""Archives as lists of members that are safe to look at; unpacking is in `unpack.py`.

One reader per format behind `open_archive`: it names the members, in the archive's order, says
what each one is, and streams it. Formats never write.
"""

from __future__ import annotations

import lzma
import stat
import tarfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Literal

from assetbuild.errors import SourceError
from assetbuild.lfs import refuse_pointer

Kind = Literal["file", "folder", "link", "special"]

MAX_CONTENT = 16 << 30
"""Bytes that a tar may state in all: to list one is to unpack it."""
MAX_MEMBERS = 1_000_000
READ_ERRORS = (
    zipfile.BadZipFile,
    tarfile.TarError,
    lzma.LZMAError,
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


class _Tar:
    def __init__(self, file: tarfile.TarFile) -> None:
        self._file = file
        self._infos: list[tarfile.TarInfo] = []
        total = 0
        for info in file:  # each is stated before it is unpacked
            self._infos.append(info)
            total += info.size
            if total > MAX_CONTENT or len(self._infos) > MAX_MEMBERS:
                size = f"{total >> 20} MB in {len(self._infos)} members"
                raise SourceError(f"the archive states {size}; that is no robot")
        self.members = tuple(_tar_member(i, info) for i, info in enumerate(self._infos))

    def open(self, member: Member) -> IO[bytes]:
        stream = self._file.extractfile(self._infos[member.index])
        if stream is None:
            raise OSError("it has no content")
        return stream


def _tar_member(index: int, info: tarfile.TarInfo) -> Member:
    kind: Kind = "special"
    if info.issym() or info.islnk():
        kind = "link"
    elif info.isdir():
        kind = "folder"
    elif info.isreg() and not info.sparse:
        kind = "file"
    path = info.name + "/" if kind == "folder" else info.name
    # `tar -c .` puts `./` before every name.
    path = path if path in (".", "./") else path.removeprefix("./")
    # The packed size is that of the whole archive; `unpack` bounds all members by it together.
    return Member(path, kind, info.size, info.size, encrypted=False, index=index)


Archive = _Zip | _Tar
"""`members`, and `open`: a stream of a member's bytes, which raises one of `READ_ERRORS`."""


@contextmanager
def open_archive(path: Path) -> Iterator[Archive]:
    """The archive in a file; SourceError when it is none of the formats that we read."""
    with path.open("rb") as file:
        refuse_pointer(file.read(1024), "the archive")
    with ExitStack() as opened:
        try:
            archive: Archive
            if zipfile.is_zipfile(path):
                archive = _Zip(opened.enter_context(zipfile.ZipFile(path)))
            else:
                archive = _Tar(opened.enter_context(tarfile.open(path, "r:*")))
        except READ_ERRORS as problem:
            message = f"the archive cannot be read: {problem}"
            hint = "zip and tar (plain, gz, bz2, xz) are read; was the download cut off?"
            raise SourceError(message, hint=hint) from None
        yield archive


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
