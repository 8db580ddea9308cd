"""The record of a finished build: did anything change since? Answered by `stat` alone.

This is all that a build with nothing to do loads, so it uses the standard library sparingly:
no json, re, typing, pathlib; hashlib only for files whose stamps prove nothing.

A record is text, one line per fact, tab-separated, closed by a line with the CRC of the rest.
Whatever is odd about it counts as "something changed".
"""

# pathlib and contextlib are not loaded here:
# ruff: noqa: PTH100, PTH114, PTH116, PTH118, PTH119, PTH120, PTH123, SIM105
from __future__ import annotations

import os
import stat
import sys
import time

from assetbuild.engine.digest import RACY_NS, digest_file, replace_file

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

FORMAT = "assetbuild null 1"
ABSENT = "absent"
UNPROVEN = "-"
"""In place of a signature: the file was touched too recently, its content must be read."""


def record_file(store_root: str, *names: str) -> str:
    """Where the record of a build lies; `names`: what tells builds apart (recipe, out folder).

    Two builds may fall on one file; then each finds the other's options and builds.
    """
    import zlib

    stem = os.path.basename(names[0]) if names else "build"
    code = zlib.crc32("\n".join(names).encode("utf-8", "surrogatepass"))
    return os.path.join(store_root, "v1", "null", f"{stem[:80]}-{code:08x}")


def check(record: str, options: str) -> dict[str, object] | None:
    """`{"exit_code", "summary"}` of the recorded build if it would do nothing now, else None.

    options: must equal those given to `write`. Files whose stamps changed are read; if none
    has other bytes, the answer stands, and their new stamps are noted.
    """
    try:
        with open(record, encoding="utf-8", errors="surrogateescape", newline="") as file:
            text = file.read()
        lines = _whole_lines(text)
        if lines is None or lines[:3] != [FORMAT, identity(), _escape(options)]:
            return None
        noted = _check_lines(lines[4:])
        if noted is None:
            return None
        exit_code, summary = lines[3].split("\t")
        if noted != lines[4:]:
            try:
                _save(record, [*lines[:4], *noted])
            except OSError:  # then the next build reads these files again, no more
                pass
        return {"exit_code": int(exit_code), "summary": _unescape(summary)}
    except (OSError, ValueError):
        return None


def write(
    record: str,
    *,
    options: str,
    files: Mapping[str, str],
    folders: Iterable[str] = (),
    absent: Iterable[str] = (),
    exit_code: int,
    summary: str,
    began_ns: int,
) -> bool:
    """Record a finished build; False, and no record, when a file was edited meanwhile.

    files: path -> SHA-256 of everything the build read (recipe, lock, includes, sources) and of
    every file of the bundle, as the build saw or made it. folders: they hold the files named
    here and nothing else. absent: paths whose appearance changes the build.
    began_ns: `time.time_ns()` before the first of them was read; younger files are read again.
    OSError when the record cannot be written.
    """
    lines = []
    for path, digest in sorted(files.items()):
        line = _line_of(os.path.abspath(path), digest, began_ns - RACY_NS)
        if line is None:
            return False
        lines.append(line)
    lines += [
        f"+\t{_escape(os.path.abspath(folder))}\t{_count_below(folder)}" for folder in folders
    ]
    for path in sorted(absent):
        if os.path.lexists(path):
            return False
        lines.append(f"{ABSENT}\t{_escape(os.path.abspath(path))}\t{UNPROVEN}")
    head = [FORMAT, identity(), _escape(options), f"{exit_code}\t{_escape(summary)}"]
    _save(record, head + lines)
    return True


def identity() -> str:
    """This installation: Python, our own files, and what is installed beside them.

    Installing or removing a distribution changes the stamp of its site-packages folder; an
    edit of our own files (an editable installation) changes the sum of their stamps.
    """
    import assetbuild

    count = stamps = sizes = 0
    pending = [os.path.dirname(os.path.abspath(assetbuild.__file__))]
    while pending:
        with os.scandir(pending.pop()) as entries:
            for entry in entries:
                if entry.is_dir():
                    if entry.name != "__pycache__":
                        pending.append(entry.path)
                else:
                    found = entry.stat()
                    count += 1
                    stamps += found.st_mtime_ns + found.st_ctime_ns
                    sizes += found.st_size
    parts = [assetbuild.__version__, sys.version.split()[0], sys.prefix, sys.platform]
    parts += [str(count), str(stamps), str(sizes)]
    for folder in sorted({p for p in sys.path if p.endswith("-packages")}):
        try:
            found = os.stat(folder)
        except OSError:
            continue
        parts.append(f"{folder}={found.st_mtime_ns}:{found.st_ino}")
    return _escape(" ".join(parts))


def _whole_lines(text: str) -> list[str] | None:
    """The lines of a record without its last one, or None when the record is not whole."""
    body, _, last = text.removesuffix("\n").rpartition("\n")
    return body.split("\n") if last == _crc(body) else None


def _crc(body: str) -> str:
    import zlib

    return f"end {zlib.crc32(body.encode('utf-8', 'surrogateescape')):08x}"


def _save(record: str, lines: list[str]) -> None:
    body = "\n".join(lines)
    text = f"{body}\n{_crc(body)}\n"
    replace_file(record, text.encode("utf-8", "surrogateescape"))


def _check_lines(lines: list[str]) -> list[str] | None:
    """The same lines, stamps brought up to date, or None when something changed."""
    noted = []
    for line in lines:
        kind, name, rest = line.split("\t", 2)
        path = _unescape(name) if "\\" in name else name
        if kind == "+":
            if str(_count_below(path)) != rest:
                return None
        elif kind == ABSENT:
            if os.path.lexists(path):
                return None
        elif _signature_text(os.lstat(path)) != rest:
            fresh = _line_of(path, kind)
            if fresh is None:
                return None
            noted.append(fresh)
            continue
        noted.append(line)
    return noted


def _line_of(path: str, digest: str, trusted_before_ns: int | None = None) -> str | None:
    """The line of one file, or None when its bytes are not those of the digest.

    trusted_before_ns: a file not touched since then needs no reading.
    """
    try:
        found = os.stat(path)
        now = time.time_ns()
        touched = max(found.st_mtime_ns, found.st_ctime_ns)
        trusted = trusted_before_ns is not None and touched < trusted_before_ns
        if not stat.S_ISREG(found.st_mode) or (not trusted and digest_file(path) != digest):
            return None
        # A link proves nothing by its own stamps: what it points to is read every time.
        proven = touched < now - RACY_NS and not os.path.islink(path)
        return f"{digest}\t{_escape(path)}\t{_signature_text(found) if proven else UNPROVEN}"
    except OSError:
        return None


def _signature_text(found: os.stat_result) -> str:
    return f"{found.st_mtime_ns} {found.st_ctime_ns} {found.st_size} {found.st_ino} {found.st_dev}"


def _count_below(folder: str) -> int:
    """Number of files and other things below a folder that are not folders; -1 when absent."""
    count = 0
    pending = [folder]
    while pending:
        try:
            with os.scandir(pending.pop()) as entries:
                for entry in entries:
                    if entry.is_dir(follow_symlinks=False):
                        pending.append(entry.path)
                    else:
                        count += 1
        except OSError:
            return -1
    return count


def _escape(text: str) -> str:
    for plain, escaped in (("\\", "\\\\"), ("\n", "\\n"), ("\t", "\\t"), ("\r", "\\r")):
        text = text.replace(plain, escaped)
    return text


def _unescape(text: str) -> str:
    parts = [
        part.replace("\\n", "\n").replace("\\t", "\t").replace("\\r", "\r")
        for part in text.split("\\\\")
    ]
    return "\\".join(parts)
