"""This machine: its CPU and C library, which decide how it computes, and where its store lives.

The null build asks too, so little is imported.
"""

from __future__ import annotations

import os
import sys

# pathlib, contextlib and platform are not loaded on the way of the null build:
# ruff: noqa: PTH100, PTH111, PTH123

DECISIVE = ("vendor_id", "cpu family", "model", "flags", "CPU implementer", "CPU part", "Features")


def cpuinfo() -> dict[str, str]:
    """What Linux says of the first core; {} elsewhere.

    The file of a large machine is long and slow to read, so its end is not read.
    """
    fields: dict[str, str] = {}
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
            for line in file:
                name, colon, value = line.partition(":")
                if not colon:
                    break
                fields[name.strip()] = value.strip()
    except OSError:
        pass
    return fields


def libc() -> str:
    """`glibc2.36`; empty where it is another library."""
    try:
        return (os.confstr("CS_GNU_LIBC_VERSION") or "").replace(" ", "")
    except (ValueError, OSError):
        return ""


def machine_text() -> str:
    """All of it on one line."""
    fields = cpuinfo()
    return " ".join([os.uname().machine, libc(), *(fields.get(name, "") for name in DECISIVE)])


def cache_root() -> str:
    """The store's folder: `$ASSETBUILD_CACHE`, else `assetbuild` in the user's cache folder."""
    named = os.environ.get("ASSETBUILD_CACHE")
    if named:
        return os.path.abspath(named)
    if sys.platform == "linux":
        base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
        return f"{base}/assetbuild"
    import platformdirs

    return platformdirs.user_cache_dir("assetbuild", appauthor=False)
