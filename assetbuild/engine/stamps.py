"""What was found in a file, known again by the file's stamps, so that it need not be read again."""

from __future__ import annotations

import json
import os
import stat
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from assetbuild.engine.digest import digest_file, is_racy, replace_file, signature_of

Entry = list[Any]  # Any: five numbers, the signature, and the text that was found


class Stamps:
    """Texts that were found in files, trusted while the signature of the file stays the same.

    path: one JSON file, replaced at once by `save`; unreadable counts as empty. None keeps nothing.
    form: of the texts; those in another form are forgotten.
    fresh: trust nothing that an earlier process found. limit: of the entries in the file.
    Safe to use from several threads: every operation on the dictionaries is a single one.
    """

    def __init__(
        self,
        path: Path | None = None,
        *,
        form: str = "digests",
        fresh: bool = False,
        limit: int = 50_000,
    ) -> None:
        self._path = path
        self._limit = limit
        self._form = form
        self._old = {} if fresh else self._load()
        self._new: dict[str, Entry] = {}

    def find(self, name: str, status: os.stat_result, read: Callable[[], str]) -> str:
        """What `read` finds in the file with this `stat`, which comes first.

        An edit between stat and read then leaves a signature that no longer matches, never a fresh
        signature with an old text.
        """
        signature = signature_of(status)
        known = self._new.get(name) or self._old.get(name)
        if known is None or tuple(known[:5]) != signature:
            now = time.time_ns()
            known = [*signature, read()]
            if is_racy(signature, now):
                self._new.pop(name, None)
                self._old.pop(name, None)
                return str(known[5])
        self._new[name] = known
        return str(known[5])

    def digest(self, path: str | os.PathLike[str]) -> str:
        """SHA-256 of a file; OSError when it cannot be read, or is no regular file."""
        name = os.path.abspath(path)  # noqa: PTH100 - keeps symlinks
        status = os.stat(name)  # noqa: PTH116 - on a hot path
        if not stat.S_ISREG(status.st_mode):
            raise OSError(f"not a regular file: {name}")
        return self.find(name, status, lambda: digest_file(name))

    def save(self) -> None:
        """Write what was learnt, beside what other builds learnt meanwhile; OSError passes."""
        is_known = all(self._old.get(name) == entry for name, entry in list(self._new.items()))
        if self._path is None or is_known:
            return
        merged = self._load()
        for name in self._new:
            merged.pop(name, None)  # so that the entries used last stand last
        files = dict(list((merged | self._new).items())[-self._limit :])
        replace_file(self._path, json.dumps({"format": self._form, "files": files}).encode())

    def _load(self) -> dict[str, Entry]:
        try:
            raw = json.loads(self._path.read_bytes()) if self._path else {}
            files = raw["files"]
            if raw["format"] == self._form and all(
                len(entry) == 6 and isinstance(entry[5], str) for entry in files.values()
            ):
                return dict(files)
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            pass
        return {}
