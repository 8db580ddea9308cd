"""Digests: SHA-256 of bytes and files; what identifies an unchanged file; files replaced at once.

The null build imports this module: standard library only, heavy parts inside functions.
"""

# pathlib is not loaded on the way of the null build:
# ruff: noqa: PTH103, PTH105, PTH108, PTH120, PTH123
from __future__ import annotations

import os
import time

Signature = tuple[int, int, int, int, int]
"""(mtime_ns, ctime_ns, size, inode, device): equal means unchanged, unless racy."""

RACY_NS = 2_000_000_000
"""Stamps younger than this prove nothing: clocks of file systems tick every 1 ms to 2 s."""
FINE_RACY_NS = 50_000_000
"""The same where stamps are finer than a millisecond: such clocks tick every 10 ms or less."""

CHUNK = 1 << 20


def canonical_json(value: object) -> bytes:
    """The one JSON text of plain data: sorted keys, no blanks, UTF-8.

    NaN and infinity are written as Python writes and reads them; they occur in findings.
    Raises TypeError on what is not plain data.
    """
    import json

    text = json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return text.encode("utf-8", "surrogatepass")


def digest_bytes(data: bytes) -> str:
    """SHA-256 as 64 lower-case hex digits."""
    import hashlib

    return hashlib.sha256(data).hexdigest()


def digest_file(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a file's content; OSError when it cannot be read."""
    import hashlib

    state = hashlib.sha256()
    with open(path, "rb", buffering=0) as file:
        while chunk := file.read(CHUNK):
            state.update(chunk)
    return state.hexdigest()


def regular_bytes(path: str | os.PathLike[str]) -> bytes:
    """A file's content; OSError for a pipe or a device, which would never end."""
    if os.path.exists(path) and not os.path.isfile(path):  # noqa: PTH110, PTH113 # no pathlib here
        raise OSError("it is not a regular file")
    with open(path, "rb") as file:
        return file.read()


def signature_of(status: os.stat_result) -> Signature:
    """What identifies an unchanged file, from its `stat`."""
    return (status.st_mtime_ns, status.st_ctime_ns, status.st_size, status.st_ino, status.st_dev)


def is_racy(signature: Signature, now_ns: int | None = None, window_ns: int = RACY_NS) -> bool:
    """Was the file touched so recently (or in the future) that a later edit may look the same?"""
    now = time.time_ns() if now_ns is None else now_ns
    return max(signature[0], signature[1]) > now - window_ns


def replace_file(path: str | os.PathLike[str], data: bytes) -> None:
    """Write beside, then rename: a reader sees the old bytes or the new ones, never a part."""
    target = os.fspath(path)
    os.makedirs(os.path.dirname(target) or ".", exist_ok=True)
    beside = f"{target}.{os.getpid():x}-{time.monotonic_ns():x}.tmp"
    try:
        with open(beside, "wb") as file:
            file.write(data)
        os.replace(beside, target)
    except BaseException:
        if os.path.lexists(beside):
            os.unlink(beside)
        raise
