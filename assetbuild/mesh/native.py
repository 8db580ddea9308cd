"""Native libraries in a process of their own: a crash, a hang or an over-run loses one result.

They abort on bad input (there is no exception to catch), run for minutes on some small meshes,
and take gigabytes on others. The caller gets the cause and can go on with another method.
"""

from __future__ import annotations

import io
import os
import resource
import select
import signal
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from assetbuild.mesh.triangles import TriangleMesh

WALL_PER_CPU = 10.0
"""A process gets this many times its CPU limit on the wall clock: the machine may be busy."""
WALL_EXTRA_S = 30.0
CHUNK = 1 << 16


@dataclass(frozen=True)
class NativeLimits:
    """Bounds of one run. cpu_s: user and system seconds; memory_mb: on top of what is mapped."""

    cpu_s: float = 60.0
    memory_mb: int = 3072


class NativeError(Exception):
    """The library gave no result. cause: `crash`, `time`, `memory`, `error` or `stopped`."""

    def __init__(self, cause: str, message: str) -> None:
        self.cause = cause
        super().__init__(message)


def run_apart(
    work: Callable[[], Sequence[TriangleMesh]],
    limits: NativeLimits,
    *,
    stop_when: Callable[[bytes], bool] | None = None,
) -> list[TriangleMesh]:
    """The meshes that `work` returns, computed in a forked process.

    stop_when: told each line that it prints, in order and all of them, however fast it runs; True
    ends it (cause `stopped`). Raises NativeError.
    """
    result_in, result_out = os.pipe()
    said_in, said_out = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(result_in)
        os.close(said_in)
        _become_worker(work, limits, result_out, said_out)
    os.close(result_out)
    os.close(said_out)
    try:
        data, said, why = _collect(pid, result_in, said_in, limits, stop_when)
    finally:
        os.close(result_in)
        os.close(said_in)
        with suppress(OSError):
            os.kill(pid, signal.SIGKILL)
        _, status, used = os.wait4(pid, 0)
    if why:
        raise NativeError(*why)
    if os.WIFSIGNALED(status) or not data:
        raise _death(status, used.ru_utime + used.ru_stime, said, limits)
    return _decoded(data)


def _become_worker(
    work: Callable[[], Sequence[TriangleMesh]], limits: NativeLimits, result: int, said: int
) -> NoReturn:
    code = 70
    try:
        os.dup2(said, 1)
        os.dup2(said, 2)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, signal.SIG_DFL)
        _set_limits(limits)
        _write_all(result, _encoded(work()))
        code = 0
    except MemoryError:
        os.write(said, b"\nMemoryError")
    except BaseException as error:
        os.write(said, f"\n{type(error).__name__}: {error}"[:500].encode())
    finally:
        os._exit(code)  # no exit handlers: those of native libraries hang after a fork


def _set_limits(limits: NativeLimits) -> None:
    with open("/proc/self/statm", encoding="ascii") as file:  # noqa: PTH123 - a plain read
        mapped = int(file.read().split()[0]) * resource.getpagesize()
    cpu = max(1, int(np.ceil(limits.cpu_s)))
    memory = mapped + limits.memory_mb * 1024 * 1024
    for kind, soft, hard in (
        (resource.RLIMIT_AS, memory, memory),
        # Above the soft limit SIGXCPU comes, which nothing else sends: SIGKILL would say no cause.
        (resource.RLIMIT_CPU, cpu, cpu + 2),
        (resource.RLIMIT_CORE, 0, 0),
    ):
        with suppress(ValueError, OSError):  # a lower limit of the step's own stays
            resource.setrlimit(kind, (soft, hard))


def _collect(
    pid: int,
    result: int,
    said: int,
    limits: NativeLimits,
    stop_when: Callable[[bytes], bool] | None,
) -> tuple[bytes, bytes, tuple[str, str] | None]:
    """What it wrote and printed, until both ends are closed; and why it had to be ended."""
    deadline = time.monotonic() + WALL_PER_CPU * limits.cpu_s + WALL_EXTRA_S
    data, text, line = bytearray(), bytearray(), b""
    open_ends = {result, said}
    while open_ends:
        left = deadline - time.monotonic()
        ready, _, _ = select.select(list(open_ends), [], [], max(0.0, left))
        if not ready:
            return bytes(data), bytes(text), ("time", f"no end after {limits.cpu_s:g} s")
        for end in ready:
            piece = os.read(end, CHUNK)
            if not piece:
                open_ends.discard(end)
            elif end == result:
                data += piece
            else:
                text = (text + piece)[-4 * CHUNK :]
                *lines, line = (line + piece).split(b"\n")
                line = line[-CHUNK:]
                for told in lines:
                    if stop_when is not None and stop_when(told):
                        return bytes(data), bytes(text), ("stopped", told.decode(errors="replace"))
    return bytes(data), bytes(text), None


def _death(status: int, cpu_s: float, said: bytes, limits: NativeLimits) -> NativeError:
    words = said.decode(errors="replace").strip().splitlines()
    last = words[-1].strip()[:200] if words else ""
    if b"MemoryError" in said or b"bad_alloc" in said:
        return NativeError("memory", f"needs more than {limits.memory_mb} MB")
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        if number == signal.SIGXCPU or (number == signal.SIGKILL and cpu_s >= limits.cpu_s):
            return NativeError("time", f"no end after {limits.cpu_s:g} CPU s")
        if number == signal.SIGKILL:  # no library sends it
            return NativeError("memory", "was killed by the system, which ran out of memory")
        name = signal.Signals(number).name
        return NativeError("crash", f"crashed ({name})" + (f": {last}" if last else ""))
    return NativeError("error", last or f"ended with code {os.WEXITSTATUS(status)}")


def _encoded(meshes: Sequence[TriangleMesh]) -> bytes:
    counts = np.array([(len(m.vertices), len(m.faces)) for m in meshes], dtype=np.int64)
    file = io.BytesIO()
    for array in (
        counts.reshape(-1, 2),
        np.concatenate([np.zeros((0, 3)), *(m.vertices for m in meshes)]),
        np.concatenate([np.zeros((0, 3), dtype=np.int64), *(m.faces for m in meshes)]),
    ):
        np.save(file, array, allow_pickle=False)
    return file.getvalue()


def _decoded(data: bytes) -> list[TriangleMesh]:
    file = io.BytesIO(data)
    counts, vertices, faces = (np.load(file, allow_pickle=False) for _ in range(3))
    ends = np.cumsum(counts, axis=0)
    return [
        TriangleMesh(vertices[v - dv : v], faces[f - df : f])
        for (v, f), (dv, df) in zip(ends.tolist(), counts.tolist(), strict=True)
    ]


def _write_all(end: int, data: bytes) -> None:
    while data:
        data = data[os.write(end, data) :]
