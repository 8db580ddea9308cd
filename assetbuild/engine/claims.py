"""What belongs to a running process: when it dies, however it dies, it is free.

A claim is an advisory lock of the kernel on the folder or file itself, so nothing has to be
unlocked after a kill. Child processes end with their parent.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import secrets
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

FOLDER = os.O_RDONLY | os.O_DIRECTORY
LONGEST_PAUSE_S = 0.1
PR_SET_PDEATHSIG = 1


def claim_new_folder(parent: Path, prefix: str = "") -> tuple[Path, int]:
    """Make `<parent>/<prefix><8 hex>` and claim it; the claim ends when the descriptor closes.

    Some network file systems know no locks: there folders are made, and never swept.
    """
    while True:
        folder = parent / f"{prefix}{secrets.token_hex(4)}"
        folder.mkdir(parents=True)
        with suppress(FileNotFoundError):  # swept before it was claimed
            try:
                descriptor = _lock(folder, FOLDER)
            except OSError:
                descriptor = os.open(folder, FOLDER)
            if descriptor is not None:
                return folder, descriptor


def _lock(path: Path, flags: int) -> int | None:
    """A descriptor that holds the lock on this path; None when another has it or removed it.

    OSError where locks are not known, or it cannot be opened.
    """
    descriptor = os.open(path, flags, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if path.stat().st_ino == os.fstat(descriptor).st_ino:
            return descriptor
    except (BlockingIOError, FileNotFoundError):
        pass
    except OSError:
        os.close(descriptor)
        raise
    os.close(descriptor)
    return None


def _claim(folder: Path) -> int | None:
    """A descriptor that holds the folder; None when another process has it or removed it."""
    try:
        return _lock(folder, FOLDER)
    except OSError:
        return None


def remove_abandoned(folders: Iterable[Path]) -> None:
    """Remove those folders whose owner is gone; those in use stay."""
    for folder in folders:
        descriptor = _claim(folder)
        if descriptor is not None:
            shutil.rmtree(folder, ignore_errors=True)
            os.close(descriptor)


def is_claimed(folder: Path) -> bool:
    """Does a live process hold the folder?"""
    descriptor = _claim(folder)
    if descriptor is not None:
        os.close(descriptor)
    return descriptor is None and folder.is_dir()


class Turns:
    """One at a time per name, among all threads and processes that share a folder.

    The same thread may take a name that it holds already.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._mine = threading.local()

    @contextmanager
    def turn(
        self, name: str, *, patience_s: float, done: Callable[[], bool] = lambda: False
    ) -> Iterator[None]:
        """Wait for the name and hold it.

        patience_s: then go on without it; so does a file system that knows no locks. The turn
        saves work, it guards nothing: what two of them write at once is the same.
        done: asked while waiting; True ends the wait.
        """
        held: set[str] = self._mine.__dict__.setdefault("held", set())
        if name in held:
            yield
            return
        path = self._folder / name
        descriptor = self._wait(path, time.monotonic() + patience_s, done)
        held.add(name)
        try:
            yield
        finally:
            held.discard(name)
            if descriptor is not None:
                path.unlink(missing_ok=True)  # whoever waits for this file notices, and opens anew
                os.close(descriptor)

    def _wait(self, path: Path, deadline: float, done: Callable[[], bool]) -> int | None:
        pause = 0.005
        while True:
            try:
                path.parent.mkdir(exist_ok=True)
                descriptor = _lock(path, os.O_RDWR | os.O_CREAT)
            except OSError:
                return None
            if descriptor is not None or done() or time.monotonic() > deadline:
                return descriptor
            time.sleep(pause)
            pause = min(LONGEST_PAUSE_S, pause * 1.5)


def die_with_parent(parent: int, how: signal.Signals) -> None:
    """Ask the kernel to send a signal when the parent dies; leave at once if it has died."""
    if sys.platform == "linux":
        libc = ctypes.CDLL(None, use_errno=True)
        libc.prctl(PR_SET_PDEATHSIG, int(how), 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)
