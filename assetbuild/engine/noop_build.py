"""The record of a finished build: would its questions get the same answers? By `stat` alone.

This is all that a build with nothing to do loads, so it uses the standard library sparingly:
no json, re, typing, pathlib; hashlib only for files whose stamps prove nothing.

A record is text, one line per fact, tab-separated, closed by a line with the CRC of the rest.
Whatever is odd about it counts as "something changed".
"""

# pathlib and contextlib are not loaded here:
# ruff: noqa: PTH100, PTH116, PTH118, PTH119, PTH120, PTH123, SIM105
from __future__ import annotations

import os
import stat
import sys
import time

from assetbuild.engine.digest import RACY_NS, digest_bytes, digest_file, replace_file
from assetbuild.engine.machine import machine_text
from assetbuild.engine.questions import BYTES, KIND, LINK, NAMES, answer, names_text, signature_text

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from assetbuild.engine.questions import Question

FORMAT = "assetbuild null 4"
MADE, COUNT = "made", "count"
"""Questions that only the record asks: the bytes of a file that must be no link, and the number of
files below a folder."""
UNPROVEN = "-"
"""In place of stamps: the file or folder was touched too recently, it must be read."""


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

    options: must equal those given to `write`. Files and folders whose stamps changed are read;
    if all answers are as before, the answer stands, and the new stamps are noted.
    """
    try:
        with open(record, encoding="utf-8", errors="surrogateescape", newline="") as file:
            text = file.read()
        body, _, last = text.removesuffix("\n").rpartition("\n")
        lines = body.split("\n")
        if last != _crc(body) or lines[:3] != [FORMAT, identity(), _escape(options)]:
            return None
        noted = []
        for line in lines[4:]:
            fresh = _renewed(line)
            if fresh is None:
                return None
            noted.append(fresh)
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
    asked: Mapping[Question, str],
    made: Mapping[str, str] | None = None,
    folders: Iterable[str] = (),
    exit_code: int,
    summary: str,
    began_ns: int,
) -> bool:
    """Record a finished build; False, and no record, when the world changed meanwhile.

    asked: every question that the build put to the world, with its answer. made: path -> SHA-256
    of every file of the bundle. folders: they hold the files of `made` and nothing else.
    began_ns: `time.time_ns()` before the first question; younger files are read again.
    OSError when the record cannot be written.
    """
    ours = {(MADE, os.path.abspath(path), ""): digest for path, digest in (made or {}).items()}
    counts = {(COUNT, path, ""): _count_below(path) for path in map(os.path.abspath, folders)}
    body, changed = lines_of({**asked, **ours, **counts}, began_ns)
    if not changed:
        head = [FORMAT, identity(), _escape(options), f"{exit_code}\t{_escape(summary)}"]
        _save(record, head + body)
    return not changed


def lines_of(asked: Mapping[Question, str], began_ns: int) -> tuple[list[str], list[str]]:
    """A line for each question, and the subjects whose answer is another one now.

    A file that was asked for its bytes needs no line that says it is a file, or no link.
    """
    lines, changed = [], []
    for (kind, subject, detail), expected in asked.items():
        if (BYTES, subject, "") in asked and (kind, expected) in ((KIND, "file"), (LINK, "")):
            continue
        if kind == BYTES and asked.get((LINK, subject, "")) == "":
            kind = MADE
        elif kind == NAMES:
            expected = _digest(expected)
        stamp = _proof(kind, subject, detail, expected, began_ns - RACY_NS)
        if stamp is None:
            changed.append(subject)
        else:
            lines.append("\t".join([kind, *map(_escape, (subject, detail, expected)), stamp]))
    return lines, changed


def renewed(lines: Sequence[str]) -> tuple[list[str], list[str]]:
    """The same lines with stamps brought up to date, and the subjects that answer otherwise."""
    fresh = [_renewed(line) for line in lines]
    changed = [
        _unescape(old.split("\t")[1]) for old, new in zip(lines, fresh, strict=True) if new is None
    ]
    return [new or old for old, new in zip(lines, fresh, strict=True)], changed


def identity() -> str:
    """This machine and installation: CPU, Python, our own files, what is installed beside them.

    Installing or removing a distribution changes the stamp of its site-packages folder; an
    edit of our own files (an editable installation) changes the sum of their stamps.
    """
    import assetbuild
    from assetbuild._version import __version__

    count = stamps = sizes = 0
    pending = [os.path.dirname(os.path.abspath(assetbuild.__file__))]
    while pending:
        with os.scandir(pending.pop()) as entries:
            for entry in entries:
                if entry.is_dir():
                    if entry.name != "__pycache__":
                        pending.append(entry.path)
                else:
                    status = entry.stat()
                    count += 1
                    stamps += status.st_mtime_ns + status.st_ctime_ns
                    sizes += status.st_size
    parts = [__version__, sys.version.split()[0], sys.prefix, sys.platform]
    parts += [machine_text()]
    parts += [str(count), str(stamps), str(sizes)]
    for folder in sorted({p for p in sys.path if p.endswith("-packages")}):
        try:
            status = os.stat(folder)
        except OSError:
            continue
        parts.append(f"{folder}={status.st_mtime_ns}:{status.st_ino}")
    return _escape(" ".join(parts))


def _crc(body: str) -> str:
    import zlib

    return f"end {zlib.crc32(body.encode('utf-8', 'surrogateescape')):08x}"


def _save(record: str, lines: list[str]) -> None:
    body = "\n".join(lines)
    text = f"{body}\n{_crc(body)}\n"
    replace_file(record, text.encode("utf-8", "surrogateescape"))


def _renewed(line: str) -> str | None:
    """The same line, its stamps brought up to date; None when the answer is another one now."""
    kind, name, detail, expected, stamp = line.split("\t")
    subject = _unescape(name) if "\\" in name else name
    if stamp and (status := _status(kind, subject)) and signature_text(status) == stamp:
        return line
    fresh = _proof(kind, subject, _unescape(detail), _unescape(expected))
    return None if fresh is None else line.removesuffix(stamp) + fresh


def _proof(
    kind: str, subject: str, detail: str, expected: str, trusted_before_ns: int = 0
) -> str | None:
    """The stamps that prove an answer while they stay; None when it is not the expected one now.

    UNPROVEN when the stamps are too young, "" for a question that is asked again each time.
    trusted_before_ns: a file not touched since then needs no reading.
    """
    try:
        now, status = time.time_ns(), _status(kind, subject)
        touched = max(status.st_mtime_ns, status.st_ctime_ns) if status else now
        is_file = kind in (BYTES, MADE)
        if is_file and not (status and stat.S_ISREG(status.st_mode)):
            return None
        trusted = is_file and touched < trusted_before_ns
        if not trusted and _answer(kind, subject, detail) != expected:
            return None
    except (OSError, ValueError):
        return None
    if status and touched < now - RACY_NS:
        return signature_text(status)
    return UNPROVEN if is_file or kind == NAMES else ""


def _status(kind: str, subject: str) -> os.stat_result | None:
    """What `stat` says of a file, or of a folder, which a new or removed entry gives new stamps.

    None where nothing is there, and for questions that no stamp answers.
    """
    try:
        if kind == MADE:
            return os.lstat(subject)
        return os.stat(subject) if kind in (BYTES, NAMES) else None
    except (OSError, ValueError):
        return None


def _answer(kind: str, subject: str, detail: str) -> str:
    if kind in (BYTES, MADE):
        return digest_file(subject)
    if kind == COUNT:
        return _count_below(subject)
    if kind == NAMES:
        return _digest(names_text(subject, detail))
    return answer((kind, subject, detail))


def _digest(names: str) -> str:
    return digest_bytes(names.encode("utf-8", "surrogateescape"))


def _count_below(folder: str) -> str:
    """Number of files and other things below a folder that are not folders; "-1" when absent."""
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
            return "-1"
    return str(count)


def _escape(text: str) -> str:
    return text.encode("unicode_escape").decode("ascii")


def _unescape(text: str) -> str:
    return text.encode("ascii").decode("unicode_escape")
