"""`--sandbox=strict`: a step reads what it declares; anything else is refused, and named.

Landlock refuses. It does not say what it refused, and native code makes of "permission denied"
what it likes (MuJoCo: "STL file is empty"), so a second process is told of every file that the
step opens and notes those that it may not read.
"""

from __future__ import annotations

import json
import os
import select
import signal
import site
import socket
import sys
import sysconfig
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import assetbuild
from assetbuild.engine import landlock, seccomp
from assetbuild.engine.claims import die_with_parent
from assetbuild.engine.wire import REFUSED

SYSTEM = ("/usr", "/lib", "/lib32", "/lib64", "/bin", "/sbin", "/etc", "/proc", "/sys", "/dev")
"""What any program reads. Not `/opt`: there may be robots."""
NAMED = 20
"""Refused paths that are reported, of one step."""


def why_not() -> str:
    """Why steps cannot be confined here, or nothing."""
    if not landlock.version():
        return "this kernel has no Landlock (Linux 5.13 has it, if it is switched on)"
    if not seccomp.is_known():
        return "seccomp is known here for Linux on x86_64 and aarch64 only"
    return ""


@dataclass(frozen=True)
class Places:
    """What a step may read: files and folders, and folders whose names alone it may list."""

    readable: tuple[str, ...]
    listable: tuple[str, ...]

    def allow(self, path: str) -> bool:
        """May this be read? A folder that may be listed counts, a file in it does not."""
        real = os.path.realpath(path)
        if any(real == place or real.startswith(f"{place}/") for place in self.readable):
            return True
        below = any(real == place or real.startswith(f"{place}/") for place in self.listable)
        return below and os.path.isdir(real)  # noqa: PTH112 - strings


def places(folder: Path, declared: Iterable[Path]) -> Places:
    """For a step with the private folder `folder`, whose inputs link to objects in `declared`."""
    paths = sysconfig.get_paths()
    code = [paths[name] for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    code += [*sys.path, *site.getsitepackages(), os.path.dirname(sys.executable)]  # noqa: PTH120
    packages = {p for p in code if p.endswith("-packages") or p in paths.values()}
    readable = {*SYSTEM, *packages, os.path.dirname(assetbuild.__file__)}  # noqa: PTH120
    readable |= {sys.base_prefix, sys.prefix} - {"/"}
    readable |= {p for p in os.environ.get("LD_LIBRARY_PATH", "").split(":") if p}
    readable |= {str(folder), *map(str, declared)}
    return Places(_existing(readable), _existing({p for p in sys.path if p}))


def _existing(paths: Iterable[str]) -> tuple[str, ...]:
    return tuple(sorted({os.path.realpath(p) for p in paths if os.path.exists(p)}))  # noqa: PTH110


def enter(folder: Path) -> None:
    """Split this process: the caller goes on confined; its parent watches and ends as it ends."""
    inputs = folder / "inputs"
    # The folders of objects: one that another step makes as well is a new file of the same name.
    declared = {p.resolve().parent for p in inputs.rglob("*") if not p.is_dir()}
    allowed = places(folder, declared)
    ours, theirs = socket.socketpair()
    watcher = os.getpid()
    child = os.fork()
    if child:
        theirs.close()
        _watch(ours, child, allowed, folder / REFUSED)
    ours.close()
    die_with_parent(watcher, signal.SIGKILL)
    if not landlock.restrict(allowed.readable, allowed.listable, only_reading=True):
        raise OSError("the kernel refuses Landlock")
    socket.send_fds(theirs, [b"."], [seccomp.listener()])
    theirs.close()


def _watch(ours: socket.socket, child: int, allowed: Places, report: Path) -> NoReturn:
    """Note what the child may not read, until it ends; then end in the same way."""
    refused: dict[str, None] = {}
    _, descriptors, _, _ = socket.recv_fds(ours, 1, 1)
    end = os.pidfd_open(child)
    poll = select.poll()
    for descriptor in (end, *descriptors):
        poll.register(descriptor, select.POLLIN)
    while True:
        ready = {descriptor for descriptor, event in poll.poll() if event & select.POLLIN}
        if end in ready or not descriptors:
            break
        for descriptor in ready:
            for opened in seccomp.answer(descriptor):
                if opened.to_read and _is_refused(opened.path, allowed):
                    refused[os.path.realpath(opened.path)] = None
    if refused:
        report.write_text(json.dumps(list(refused)[:NAMED]), encoding="utf-8")
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)
    os._exit(os.waitstatus_to_exitcode(status))


def _is_refused(path: str, allowed: Places) -> bool:
    """What is not there is not refused: programs look in many places."""
    return os.path.exists(path) and not allowed.allow(path)  # noqa: PTH110 - strings
