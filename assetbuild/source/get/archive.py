"""Archives, listed and unpacked safely: nothing outside, no links, no bombs."""

from __future__ import annotations

import lzma
import re
import stat
import tarfile
import unicodedata
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path, PurePosixPath
from typing import IO, ClassVar

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import SourceError, did_you_mean
from assetbuild.findings import Finding
from assetbuild.lfs import refuse_pointer

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


MAX_FILE = 1 << 30
MAX_TOTAL = 4 << 30
MAX_RATIO = 200
RATIO_FROM = 10 << 20
"""Below this size a high ratio is harmless: repeated text in a small file."""
_CHUNK = 1 << 20
_LICENSE = re.compile(
    r"[^/]+\.dist-info/(licen[cs]es/.+|(licen[cs]e|copying|notice|authors)[^/]*)", re.IGNORECASE
)


@dataclass(frozen=True)
class Member:
    """One entry as the archive states it. packed, size: bytes; open: its bytes as a stream.

    odd: why it is neither a regular file nor a folder, or "".
    """

    path: str
    is_folder: bool
    odd: str
    size: int
    packed: int
    open: Callable[[], IO[bytes] | None] = field(compare=False, repr=False)


Members = tuple[Member, ...]
LINK, ENCRYPTED, SPECIAL = "is a symbolic link", "is encrypted", "is not a regular file"


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
    form = stat.S_IFMT(info.external_attr >> 16) if info.create_system == 3 else 0  # 3 = Unix
    is_plain = form in (0, stat.S_IFREG)
    is_folder = form == stat.S_IFDIR or (is_plain and info.filename.endswith("/"))
    odd = ENCRYPTED if info.flag_bits & 1 else ""
    if not is_plain:
        odd = LINK if form == stat.S_IFLNK else SPECIAL
    # orig_filename: zipfile itself cuts names at a NUL, which would hide what was meant.
    path, reading = info.orig_filename, partial(file.open, info)
    return Member(
        path, is_folder, "" if is_folder else odd, info.file_size, info.compress_size, reading
    )


def _of_tar(file: tarfile.TarFile) -> Iterator[Member]:
    total = 0
    for count, info in enumerate(file, start=1):  # each is stated before it is unpacked
        total += info.size
        if total > MAX_CONTENT or count > MAX_MEMBERS:
            size = f"{total >> 20} MB in {count} members"
            raise SourceError(f"the archive states {size}; that is no robot")
        odd = "" if info.isdir() or (info.isreg() and not info.sparse) else SPECIAL
        odd = LINK if info.issym() or info.islnk() else odd
        path = info.name + "/" if info.isdir() else info.name
        # `tar -c .` puts `./` before every name.
        path = path if path in (".", "./") else path.removeprefix("./")
        # The packed size is that of the whole archive; `unpack` bounds all members by it together.
        reading = partial(file.extractfile, info)
        yield Member(path, info.isdir(), odd, info.size, info.size, reading)


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


# --- what lies in one ------------------------------------------------------------------------


class ListArchive(Step):
    """`listing.json`: the files below `root`, and the licence texts.

    {"files": [path relative to root, ...], "licenses": [path in the archive, ...],
    "links": [path relative to root, ...]}, all sorted. links: those of `files` that are no regular
    files; `unpack` refuses them by name.
    """

    own_name = "list_archive"
    outputs = ("listing.json",)
    isolated = True
    limits: ClassVar[Limits] = Limits(wall_s=120, memory_mb=2048)

    root: str = "."
    """Folder inside the archive; `.` = all of it."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `archive`; SourceError for a broken archive, an unsafe name, a missing root."""
        with open_archive(files.inputs / "archive") as members:
            odd = [m.path for m in members if m.odd]
            whole = (m.path for m in members if not (m.is_folder or m.odd))
            regular = [path for path in whole if not why_unsafe(path)]
            listing = {
                "files": sorted(_files_below(members, self.root)),
                "licenses": sorted({path for path in regular if _LICENSE.fullmatch(path)}),
                "links": sorted({path for name in odd if (path := below(self.root, name))}),
            }
        files.write_json("listing.json", listing)
        yield from ()


def _files_below(members: Members, root: str) -> set[str]:
    files: set[str] = set()
    for member in members:
        path = below(root, member.path)
        if path is None or member.is_folder:
            continue
        if reason := why_unsafe(member.path):
            raise _bad(member, f"has {reason}")
        files.add(path)
    if not files:
        raise _no_root(members, root)
    return files


def _no_root(members: Members, root: str) -> SourceError:
    folders = set()
    for member in members:
        parts = member.path.split("/")[:-1]
        folders |= {"/".join(parts[:n]) for n in range(1, min(len(parts), 6) + 1)}
    hint = did_you_mean(root, folders) if folders else "the archive has no folders"
    message = f"source.root: the archive has no file below the folder `{printable(root)}`"
    return SourceError(message, hint=hint)


# --- named members of one --------------------------------------------------------------------


class Unpack(Step):
    """`files/`: each of `members` (paths relative to `root`) at its relative path."""

    own_name = "unpack"
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
        known = [p for m in stated if (p := below(root, m.path)) and not (m.is_folder or m.odd)]
        message = f"archive: no file `{printable(missing[0])}` below `{root}`"
        raise SourceError(message, hint=did_you_mean(missing[0], known))
    _check_collisions(by_path)
    return by_path


def _check_member(member: Member) -> None:
    """SourceError for a name that leads elsewhere, and for what is no regular file."""
    if reason := why_unsafe(member.path):
        raise _bad(member, f"has {reason}")
    if member.odd or member.is_folder:
        hint = "links are not followed; name the file itself" if member.odd == LINK else ""
        raise _bad(member, member.odd or SPECIAL, hint)


def _check_collisions(members: dict[str, Member]) -> None:
    """Names that are one file on some disks, and files that other files need as a folder."""
    seen: dict[str, str] = {}
    for same, path in sorted((_on_any_disk(path), path) for path in members):
        if same in seen:
            other = printable(seen[same])
            raise _bad(members[path], f"and `{other}` differ only in upper and lower case")
        if any(str(folder) in seen for folder in PurePosixPath(same).parents):
            raise _bad(members[path], "lies below what is itself a file")
        seen[same] = path


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
