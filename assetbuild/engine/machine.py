"""What decides how this machine computes: the CPU and the C library. The null build asks too."""

# pathlib, contextlib and platform are not loaded on the way of the null build.
from __future__ import annotations

import os

DECISIVE = ("vendor_id", "cpu family", "model", "flags", "CPU implementer", "CPU part", "Features")


def cpuinfo() -> dict[str, str]:
    """What Linux says of the first core; {} elsewhere.

    The file of a large machine is long and slow to read, so its end is not read.
    """
    text = b""
    try:
        descriptor = os.open("/proc/cpuinfo", os.O_RDONLY)
    except OSError:
        return {}
    try:
        while b"\n\n" not in text and (more := os.read(descriptor, 4096)):
            text += more
    finally:
        os.close(descriptor)
    lines = text.decode("ascii", "replace").partition("\n\n")[0].splitlines()
    pairs = (line.partition(":") for line in lines)
    return {name.strip(): value.strip() for name, _, value in pairs}


def libc() -> str:
    """`glibc2.36`; empty where it is another library."""
    try:
        return (os.confstr("CS_GNU_LIBC_VERSION") or "").replace(" ", "")
    except (ValueError, OSError):
        return ""


def machine_text() -> str:
    """All of it on one line."""
    found = cpuinfo()
    return " ".join([os.uname().machine, libc(), *(found.get(name, "") for name in DECISIVE)])
