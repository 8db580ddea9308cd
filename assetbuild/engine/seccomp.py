"""Seccomp's user notification: one process is told of every file that another one opens.

The kernel stops the opener until the listener has answered, and the answer here is always "go
on": this names what is opened, by native code too; it forbids nothing. See seccomp(2) and
seccomp_unotify(2).
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import platform
import struct
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

_SET_MODE_FILTER, _NEW_LISTENER = 1, 1 << 3
_PR_SET_NO_NEW_PRIVS = 38
_RECEIVE, _SEND = 0xC0502100, 0xC0182101
_NOTICE_BYTES = 80
_CONTINUE = 1
_AT_FDCWD = 0xFFFFFF9C
_PAGE = 4096
_LONGEST_PATH = 4096

# The BPF program's instructions: load a word, jump if equal, return.
_LOAD, _JUMP_EQUAL, _RETURN = 0x20, 0x15, 0x06
_ALLOW, _NOTIFY = 0x7FFF0000, 0x7FC00000
_NUMBER_AT, _ARCH_AT = 0, 4


@dataclass(frozen=True)
class _Machine:
    """Numbers of one architecture: of itself, `seccomp`, `open` (None = has none), `openat`."""

    arch: int
    seccomp: int
    open: int | None
    openat: int
    openat2: int = 437


_MACHINES = {
    "x86_64": _Machine(0xC000003E, 317, 2, 257),
    "aarch64": _Machine(0xC00000B7, 277, None, 56),
}


@dataclass(frozen=True)
class Opened:
    """A file that a process is about to open; the path as it gave it, but absolute."""

    path: str
    to_read: bool


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_char_p))


def is_known() -> bool:
    """Can it work on this machine? The kernel may still refuse."""
    return sys.platform == "linux" and platform.machine() in _MACHINES


def listener() -> int:
    """From now on each opening of a file by this process waits for whoever reads this descriptor.

    OSError when the kernel refuses.
    """
    machine = _MACHINES[platform.machine()]
    calls = [n for n in (machine.open, machine.openat, machine.openat2) if n is not None]
    code = [(_LOAD, 0, 0, _ARCH_AT), (_JUMP_EQUAL, 0, len(calls) + 1, machine.arch)]
    code.append((_LOAD, 0, 0, _NUMBER_AT))
    code += [(_JUMP_EQUAL, len(calls) - i, 0, number) for i, number in enumerate(calls)]
    code += [(_RETURN, 0, 0, _ALLOW), (_RETURN, 0, 0, _NOTIFY)]
    text = b"".join(struct.pack("=HBBI", *line) for line in code)
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
    program = _Program(len(code), text)
    found = libc.syscall(machine.seccomp, _SET_MODE_FILTER, _NEW_LISTENER, ctypes.byref(program))
    if found < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    return int(found)


def answer(descriptor: int) -> Iterator[Opened]:
    """Take one notice from a readable listener, tell what is opened, let the opener go on."""
    notice = bytearray(_NOTICE_BYTES)
    try:
        fcntl.ioctl(descriptor, _RECEIVE, notice, True)
    except OSError:  # the opener was killed meanwhile
        return
    number, pid, _, call, _, _, *arguments = struct.unpack("=QIIiIQ6Q", notice)
    try:
        opened = _opened(pid, call, arguments)
        if opened is not None:
            yield opened
    finally:
        with suppress(OSError):
            reply = bytearray(struct.pack("=QqiI", number, 0, 0, _CONTINUE))
            fcntl.ioctl(descriptor, _SEND, reply, True)


def _opened(pid: int, call: int, arguments: list[int]) -> Opened | None:
    machine = _MACHINES[platform.machine()]
    at, path, flags = (_AT_FDCWD, *arguments[:2]) if call == machine.open else arguments[:3]
    name = _text_at(pid, path)
    if not name:
        return None
    if not name.startswith("/"):
        here = f"/proc/{pid}/cwd" if at & 0xFFFFFFFF == _AT_FDCWD else f"/proc/{pid}/fd/{at}"
        try:
            name = f"{os.readlink(here)}/{name}"  # noqa: PTH115 - strings
        except OSError:
            return None
    writes = call != machine.openat2 and flags & os.O_ACCMODE == os.O_WRONLY
    return Opened(name, not writes)


def _text_at(pid: int, address: int) -> str:
    """The text in another process's memory, up to its zero byte; "" when it cannot be read."""
    data = b""
    try:
        memory = os.open(f"/proc/{pid}/mem", os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return ""
    try:
        while b"\0" not in data and len(data) < _LONGEST_PATH:
            place = address + len(data)
            part = os.pread(memory, _PAGE - place % _PAGE, place)  # the next page may be absent
            if not part:
                break
            data += part
    except OSError:
        pass
    finally:
        os.close(memory)
    return os.fsdecode(data.partition(b"\0")[0])
