"""Folders that belong to a running process: when it dies, however it dies, they are free.

The claim is an advisory lock on the folder itself, so nothing has to be unlocked after a kill.
"""

from __future__ import annotations

import fcntl
import os
import secrets
import shutil
from collections.abc import Iterable
from pathlib import Path


def claim_new_folder(parent: Path, prefix: str = "") -> tuple[Path, int]:
    """Make `<parent>/<prefix><8 hex>` and claim it; the claim ends when the descriptor closes."""
    while True:
        folder = parent / f"{prefix}{secrets.token_hex(4)}"
        folder.mkdir(parents=True)
        descriptor = _claim(folder, without_locks=True)
        if descriptor is not None:
            return folder, descriptor


def _claim(folder: Path, *, without_locks: bool = False) -> int | None:
    """A descriptor that holds the claim, or None when another process has it or removed it.

    Some network file systems know no locks: there folders are made, and never swept.
    """
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if folder.stat().st_ino == os.fstat(descriptor).st_ino:
            return descriptor
    except (BlockingIOError, FileNotFoundError):
        pass
    except OSError:
        if without_locks:
            return descriptor
    os.close(descriptor)
    return None


def remove_abandoned(folders: Iterable[Path]) -> None:
    """Remove those folders whose owner is gone; those in use stay."""
    for folder in folders:
        descriptor = _claim(folder)
        if descriptor is not None:
            shutil.rmtree(folder, ignore_errors=True)
            os.close(descriptor)
