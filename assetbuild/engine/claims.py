"""What belongs to a running process: its name says whose it is, so when the owner dies it is free.

A claim is a folder, or a symbolic link, that names its owner: machine, process and the start of
the process. Whether the owner lives is seen at once on its own machine; on another one a claim
counts until nobody has renewed it for `EXPIRY_S`. No locks are needed, which network file systems
refuse or forget, and nothing has to be unlocked after a kill. Child processes end with their
parent.
"""

from __future__ import annotations

import ctypes
import errno
import functools
import os
import re
import secrets
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

RENEW_S = 60.0
EXPIRY_S = 600.0
"""Much longer than a network file system may show an old stamp."""
LONGEST_PAUSE_S = 0.1
PR_SET_PDEATHSIG = 1
OWNER = re.compile(r"([0-9a-f]{8})-(\d+)-(\d+)-[0-9a-f]{8}$")

_held: set[Path] = set()
_renewing = threading.Lock()


def claimed_name() -> str:
    """A new name that says that it is of this process."""
    pid = os.getpid()
    return f"{_machine()}-{pid}-{_start_of(pid) or 0}-{secrets.token_hex(4)}"


@functools.cache
def _machine() -> str:
    """This machine since it was started, or this container: where process ids mean the same."""
    import hashlib
    import platform

    parts = [platform.node()]
    with suppress(OSError):
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii")
        parts = [boot, str(Path("/proc/self/ns/pid").readlink())]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:8]


def _start_of(pid: int) -> int | None:
    """When a process was started, in ticks since boot; -1 = it is a zombie; None = unknown."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    except (OSError, ValueError):
        return None
    return -1 if fields[0] in "ZX" else int(fields[19])


def claim_new_folder(parent: Path, prefix: str = "") -> Path:
    """Make a folder `<parent>/<prefix><owner>` that is claimed until `release` or our death."""
    folder = parent / f"{prefix}{claimed_name()}"
    folder.mkdir(parents=True)
    _hold(folder)
    return folder


def _hold(path: Path) -> None:
    with _renewing:
        _held.add(path)
        if not any(thread.name == _renew.__name__ for thread in threading.enumerate()):
            threading.Thread(target=_renew, name=_renew.__name__, daemon=True).start()


def _renew() -> None:
    """Tell other machines that this process lives."""
    while True:
        time.sleep(RENEW_S)
        for path in tuple(_held):
            with suppress(OSError):
                os.utime(path, follow_symlinks=False)


def release(path: Path) -> None:
    """Give up a claim, and remove what was claimed."""
    _held.discard(path)
    if path.is_symlink():
        path.unlink(missing_ok=True)
    else:
        shutil.rmtree(path, ignore_errors=True)


def is_claimed(path: Path, name: str = "") -> bool:
    """Does a living process hold it? name: its owner, where the path's own name does not say."""
    owner = OWNER.search(name or path.name)
    if owner is None or owner[1] != _machine():
        return _is_fresh(path)
    pid, start = int(owner[2]), int(owner[3])
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass  # it is another user's
    return not start or _start_of(pid) in (start, None)


def _is_fresh(path: Path) -> bool:
    """Was it renewed lately? When in doubt, the clock of its file system decides."""
    try:
        stamp = path.lstat().st_mtime
    except OSError:
        return False
    if abs(time.time() - stamp) < EXPIRY_S / 2:
        return True
    probe = path.with_name(f".{claimed_name()}")
    try:
        probe.mkdir()
        return probe.stat().st_mtime - stamp < EXPIRY_S
    except OSError:
        return True
    finally:
        with suppress(OSError):
            probe.rmdir()


def remove_abandoned(folders: Iterable[Path]) -> None:
    """Remove those folders, and turns, whose owner is gone; those in use stay."""
    for path in folders:
        try:
            name = str(path.readlink()) if path.is_symlink() else ""
        except OSError:
            continue
        if not is_claimed(path, name):
            release(path)


@contextmanager
def turn(
    path: Path, *, patience_s: float, done: Callable[[], bool] = lambda: False
) -> Iterator[None]:
    """Wait for a link and hold it: one at a time, among all threads and processes.

    The link names its holder: it appears whole, and for one of them only.
    patience_s: then go on without it; so does a file system that knows no links. The turn
    saves work, it guards nothing: what two of them write at once is the same.
    done: asked while waiting; True ends the wait.
    """
    me = _wait(path, time.monotonic() + patience_s, done)
    try:
        yield
    finally:
        with suppress(OSError):
            if me and str(path.readlink()) == me:
                release(path)


def _wait(path: Path, deadline: float, done: Callable[[], bool]) -> str:
    """What the link says that is ours now; nothing when we go on without."""
    pause = 0.005
    me = claimed_name()
    while True:
        try:
            path.symlink_to(me)
            _hold(path)
            return me
        except FileExistsError:
            _free(path)
        except OSError:
            return ""
        if done() or time.monotonic() > deadline:
            return ""
        if os.path.lexists(path):
            time.sleep(pause)
            pause = min(LONGEST_PAUSE_S, pause * 1.5)


def _free(path: Path) -> None:
    """Remove a turn whose holder is gone."""
    try:
        holder = str(path.readlink())
        if is_claimed(path, holder):
            return
        aside = path.with_name(claimed_name())
        path.rename(aside)
        if str(aside.readlink()) != holder:  # another freed it, and a third has it now
            os.link(aside, path, follow_symlinks=False)
        aside.unlink()
    except OSError as error:
        if error.errno == errno.EINVAL:  # no link: what an earlier version left
            path.unlink(missing_ok=True)


def die_with_parent(parent: int, how: signal.Signals) -> None:
    """Ask the kernel to send a signal when the parent dies; leave at once if it has died."""
    if sys.platform == "linux":
        libc = ctypes.CDLL(None, use_errno=True)
        libc.prctl(PR_SET_PDEATHSIG, int(how), 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)
