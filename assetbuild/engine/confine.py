"""Programs for what strangers wrote: they take one job, and give up all rights before they do it.

For good: files by Landlock, the network, new processes. Each layer holds where the kernel has it;
none needs root. What a layer cannot do, the caller's own private folder and empty environment do.
Landlock's calls and structures are those of Documentation/userspace-api/landlock.rst of Linux.
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import stat
import struct
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

LISTING = ("os.listdir", "os.scandir")
REFUSED = (
    "os.", "shutil.", "socket.", "subprocess.", "ctypes.", "tempfile.", "pty.", "mmap.", "fcntl.",
    "signal.", "webbrowser.", "urllib.",
)  # fmt: skip
"""Audit events that neither a robot description nor a configuration needs; those of `LISTING` may
be harmless."""


def bare_environment() -> dict[str, str]:
    """Nothing of the user's, but what the interpreter itself needs to start."""
    needed = ("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "SYSTEMROOT")
    fixed = {"PYTHONHASHSEED": "0", "PYTHONUTF8": "1", "TZ": "UTC", "LC_ALL": "C"}
    return {name: os.environ[name] for name in needed if name in os.environ} | fixed


def do_one_job(do: Callable[[Any], object], memory_bytes: int) -> NoReturn:  # Any: JSON
    """Do the job on the standard input, write what came of it as JSON, and end this process.

    Nothing else reaches the standard output.
    """
    job = json.loads(sys.stdin.read())
    answer = os.dup(1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    data = json.dumps(do(job)).encode()
    while data:
        data = data[os.write(answer, data) :]
    os._exit(0)


def set_limits(memory_mb: int, others: Mapping[int, int]) -> None:
    """Bound this process, without core files. Memory is counted on top of what is mapped.

    others: kind of a limit -> bound. They may be set again, for another job.
    """
    mapped = 0
    with suppress(OSError):
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        mapped = pages * resource.getpagesize()
    memory = mapped + memory_mb * 1024 * 1024
    for kind, bound in {resource.RLIMIT_AS: memory, resource.RLIMIT_CORE: 0, **others}.items():
        # A lower hard limit of the user's stays.
        with suppress(ValueError, OSError):
            resource.setrlimit(kind, (bound, resource.getrlimit(kind)[1]))


# Newer system calls have the same number on every architecture.
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_GET_VERSION = 1
_RULE_PATH_BENEATH = 1
_PR_SET_NO_NEW_PRIVS = 38
READ_FILE, READ_DIR = 1 << 2, 1 << 3
_FILE_RIGHTS_OF_ABI = {1: 13, 2: 14, 3: 15, 4: 15, 5: 16}
"""Number of file rights that a version of Landlock knows; later ones know 16."""


def version() -> int:
    """The version of Landlock that this kernel has; 0 = none."""
    if sys.platform != "linux":
        return 0
    libc = ctypes.CDLL(None, use_errno=True)
    return max(0, int(libc.syscall(_CREATE_RULESET, None, ctypes.c_size_t(0), _GET_VERSION)))


def _restrict(readable: Iterable[str]) -> bool:
    """Landlock: False where the kernel refuses. OSError when a path is not there."""
    known = version()
    if known < 1:
        return False
    libc = ctypes.CDLL(None, use_errno=True)
    rights = (1 << _FILE_RIGHTS_OF_ABI.get(known, 16)) - 1
    # Rights of files, then of the network from version 4 on, and scopes from version 6 on.
    rules = struct.pack("QQQ", rights, 3, 3)[: 24 if known >= 6 else 16 if known >= 4 else 8]
    ruleset = libc.syscall(_CREATE_RULESET, rules, ctypes.c_size_t(len(rules)), 0)
    if ruleset < 0:
        return False
    try:
        for path in readable:
            _allow(libc, ruleset, path)
        failed = libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
        return not (failed or libc.syscall(_RESTRICT_SELF, ruleset, 0))
    finally:
        os.close(ruleset)


def _allow(libc: ctypes.CDLL, ruleset: int, path: str) -> None:
    """OSError when the rule is refused: then the process would be missing a declared input."""
    place = os.open(path, getattr(os, "O_PATH", 0) | os.O_CLOEXEC)
    try:
        folder = stat.S_ISDIR(os.fstat(place).st_mode)
        rule = struct.pack("=Qi", READ_FILE | READ_DIR if folder else READ_FILE, place)
        if libc.syscall(_ADD_RULE, ruleset, _RULE_PATH_BENEATH, rule, 0) != 0:
            raise OSError(ctypes.get_errno(), "Landlock refused a rule", path)
    finally:
        os.close(place)


_CLONE_NEWUSER, _CLONE_NEWNET = 0x10000000, 0x40000000


def confine(readable: Iterable[str]) -> bool:
    """Let this process open only `readable` files and folders from now on, and only to read.

    No file is written, run or made; where the kernel knows how, nothing is sent either. Returns
    whether Landlock holds the files. It cannot be undone, and children inherit it.
    """
    holds = False
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).unshare(_CLONE_NEWUSER | _CLONE_NEWNET)
        holds = _restrict(readable)
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
        resource.setrlimit(resource.RLIMIT_NPROC, (0, 0))
    return holds
