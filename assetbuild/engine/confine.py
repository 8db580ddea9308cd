"""Take rights away from this process for good: files by Landlock, the network, new processes.

For code that strangers wrote. Each layer holds where the kernel has it; none needs root. What
a layer cannot do, the caller's own private folder and empty environment still do.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterable
from contextlib import suppress

from assetbuild.engine import landlock

_CLONE_NEWUSER, _CLONE_NEWNET = 0x10000000, 0x40000000


def confine(readable: Iterable[str]) -> frozenset[str]:
    """From now on this process may open only `readable` files and folders, and only to read.

    No file is written, run or made; where the kernel knows how, nothing is sent either. Returns
    what holds: `files`, `network`, `processes`. It cannot be undone, and children inherit it.
    """
    held: set[str] = set()
    if sys.platform == "linux":
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.unshare(_CLONE_NEWUSER | _CLONE_NEWNET) == 0:
            held.add("network")
        held |= landlock.restrict(readable)
    with suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
        resource.setrlimit(resource.RLIMIT_NPROC, (0, 0))
        held.add("processes")
    return frozenset(held)
