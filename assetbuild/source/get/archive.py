"""Archives as members that are safe to look at, in the archive's order; nothing is written here."""

from __future__ import annotations

import lzma
import stat
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import IO, Literal

from assetbuild.errors import SourceError
from assetbuild.lfs import refuse_pointer

Kind = Literal["file", "folder", "link", "special", "encrypted"]

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
    """One entry as the archive states it. packed, size: bytes; open: its bytes as a stream."""

    path: str
    kind: Kind
    size: int
    packed: int
    open: Callable[[], IO[bytes] | None] = field(compare=False, repr=False)


Members = tuple[Member, ...]


@contextmanager
def open_archive(path: Path) -> Iterator[Members]:
    """The members of an archive; SourceError when it is none of the formats that we read."""
    with path.open("rb") as file:
        refuse_pointer(file.read(1024), "the archive")
    try:
        opened: zipfile.ZipFile | tarfile.TarFile
        if zipfile.is_zipfile(path):
            opened = zipfile.ZipFile(path)
            members = tuple(_of_zip(opened, info) for info in opened.infolist())
        else:
            opened = tarfile.open(path, "r:*")  # noqa: SIM115 # closed below
            members = tuple(_of_tar(opened))
    except READ_ERRORS as problem:
        message = f"the archive cannot be read: {problem}"
        hint = "zip and tar (plain, gz, bz2, xz) are read; was the download cut off?"
        raise SourceError(message, hint=hint) from None
    with opened:
        yield members


def _of_zip(file: zipfile.ZipFile, info: zipfile.ZipInfo) -> Member:
    mode = info.external_attr >> 16
    form = stat.S_IFMT(mode) if info.create_system == 3 else 0  # 3 = Unix
    kind: Kind = "encrypted" if info.flag_bits & 1 else "file"
    if stat.S_ISLNK(form):
        kind = "link"
    elif form not in (0, stat.S_IFREG, stat.S_IFDIR):
        kind = "special"
    elif info.filename.endswith("/") or form == stat.S_IFDIR:
        kind = "folder"
    # orig_filename: zipfile itself cuts names at a NUL, which would hide what was meant.
    reading = partial(file.open, info)
    return Member(info.orig_filename, kind, info.file_size, info.compress_size, reading)


def _of_tar(file: tarfile.TarFile) -> Iterator[Member]:
    total = 0
    for count, info in enumerate(file, start=1):  # each is stated before it is unpacked
        total += info.size
        if total > MAX_CONTENT or count > MAX_MEMBERS:
            size = f"{total >> 20} MB in {count} members"
            raise SourceError(f"the archive states {size}; that is no robot")
        kind: Kind = "file" if info.isreg() and not info.sparse else "special"
        kind = "link" if info.issym() or info.islnk() else "folder" if info.isdir() else kind
        path = info.name + "/" if kind == "folder" else info.name
        # `tar -c .` puts `./` before every name.
        path = path if path in (".", "./") else path.removeprefix("./")
        # The packed size is that of the whole archive; `unpack` bounds all members by it together.
        yield Member(path, kind, info.size, info.size, partial(file.extractfile, info))


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
