"""Digests: SHA-256 of bytes and files, and a cache that saves reading unchanged files again.

The null build imports this module: standard library only, heavy parts inside functions.
"""

# pathlib is not loaded on the way of the null build:
# ruff: noqa: PTH100, PTH103, PTH105, PTH108, PTH116, PTH120, PTH123
from __future__ import annotations

import os
import stat
import time

TYPE_CHECKING = False  # `typing` would cost the null build a tenth of its time
if TYPE_CHECKING:
    from collections.abc import Iterable

Signature = tuple[int, int, int, int, int]
"""(mtime_ns, ctime_ns, size, inode, device): equal means unchanged, unless racy."""

RACY_NS = 2_000_000_000
"""Stamps younger than this prove nothing: clocks of file systems tick every 1 ms to 2 s."""

CHUNK = 1 << 20
CACHE_FORMAT = 1
CACHE_LIMIT = 50_000
"""Entries kept in one stat cache file."""


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


def signature_of(found: os.stat_result) -> Signature:
    """What identifies an unchanged file, from its `stat`."""
    return (found.st_mtime_ns, found.st_ctime_ns, found.st_size, found.st_ino, found.st_dev)


def is_racy(signature: Signature, now_ns: int | None = None) -> bool:
    """Was the file touched so recently (or in the future) that a later edit may look the same?"""
    now = time.time_ns() if now_ns is None else now_ns
    return max(signature[0], signature[1]) > now - RACY_NS


class StatCache:
    """Digest by path, trusted while the file's signature stays the same.

    path: one JSON file, replaced atomically by `save`; unreadable counts as empty.
    None keeps the cache in memory. Safe to use from several threads: every operation on the
    dictionaries is a single one.
    """

    def __init__(self, path: str | os.PathLike[str] | None = None, *, rehash: bool = False) -> None:
        self.path = path
        self._old: dict[str, tuple[Signature, str]] = {}
        self._new: dict[str, tuple[Signature, str]] = {}
        if path is not None and not rehash:
            self._old = _load(path)

    def digest(self, path: str | os.PathLike[str]) -> str:
        """SHA-256 of the file, read only when its signature is new; OSError when unreadable.

        The stat comes first: an edit between stat and read then leaves a signature that no
        longer matches, never a fresh signature with an old digest.
        """
        key = os.path.abspath(path)
        found = os.stat(key)
        if not stat.S_ISREG(found.st_mode):
            raise OSError(f"not a regular file: {key}")
        signature = signature_of(found)
        known = self._new.get(key) or self._old.get(key)
        if known is not None and known[0] == signature:
            self._new[key] = known
            return known[1]
        now = time.time_ns()
        digest = digest_file(key)
        if is_racy(signature, now):
            self._new.pop(key, None)
            self._old.pop(key, None)
        else:
            self._new[key] = (signature, digest)
        return digest

    def save(self) -> None:
        """Write what was learnt, beside what other builds learnt meanwhile; OSError passes."""
        if self.path is None or all(
            self._old.get(path) == entry for path, entry in list(self._new.items())
        ):
            return
        import json

        merged = _load(self.path)
        for key in self._new:
            merged.pop(key, None)  # so that the entries used last stand last
        merged |= self._new
        kept = list(merged.items())[-CACHE_LIMIT:]
        text = json.dumps({"format": CACHE_FORMAT, "files": {k: [*s, d] for k, (s, d) in kept}})
        replace_file(self.path, text.encode())


def _load(path: str | os.PathLike[str]) -> dict[str, tuple[Signature, str]]:
    import json

    try:
        with open(path, "rb") as file:
            raw = json.load(file)
        if raw["format"] != CACHE_FORMAT:
            return {}
        return {str(k): _entry(v) for k, v in raw["files"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}


def _entry(raw: Iterable[object]) -> tuple[Signature, str]:
    mtime, ctime, size, inode, device, digest = raw
    if not isinstance(digest, str) or len(digest) != 64:
        raise TypeError("not a digest")
    numbers = (mtime, ctime, size, inode, device)
    if not all(isinstance(n, int) for n in numbers):
        raise TypeError("not a signature")
    return numbers, digest  # type: ignore[return-value]  # checked on the line above


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
