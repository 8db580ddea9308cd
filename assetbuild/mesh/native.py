"""Native libraries in a process of their own: a crash, a hang or an over-run loses one result.

They abort on bad input (there is no exception to catch), run for minutes on some small meshes,
and take gigabytes on others. The caller gets the cause and can go on with another method.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import resource
import signal
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait

from assetbuild.engine.confine import set_limits
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


Answer = list[TriangleMesh] | tuple[str, str]
"""The meshes, or (cause, message)."""


def run_apart(
    work: Callable[[], Iterable[TriangleMesh]],
    limits: NativeLimits,
    *,
    stop_when: Callable[[bytes], bool] | None = None,
) -> list[TriangleMesh]:
    """The meshes that `work` returns, computed in a forked process.

    stop_when: told each line that it prints, in order and all of them, however fast it runs; True
    ends it (cause `stopped`). Raises NativeError.
    """
    fork = multiprocessing.get_context("fork")
    result_in, result_out = fork.Pipe(duplex=False)
    said_in, said_out = os.pipe()
    process = fork.Process(target=_become_worker, args=(work, limits, result_out, said_out))
    process.start()
    result_out.close()
    os.close(said_out)
    try:
        answer, output = _collect(result_in, said_in, limits, stop_when)
    finally:
        result_in.close()
        os.close(said_in)
        process.kill()
        process.join()
    if answer is None:
        answer = _death(process.exitcode or 0, output, limits)
    if isinstance(answer, tuple):
        raise NativeError(*answer)
    return answer


def _become_worker(
    work: Callable[[], Iterable[TriangleMesh]],
    limits: NativeLimits,
    result: Connection,
    output_end: int,
) -> None:
    os.dup2(output_end, 1)
    os.dup2(output_end, 2)
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGXCPU):
        signal.signal(number, signal.SIG_DFL)
    cpu = max(1, math.ceil(limits.cpu_s))
    # Above the soft limit SIGXCPU comes, which nothing else sends: SIGKILL would say no cause.
    set_limits(limits.memory_mb, {resource.RLIMIT_CPU: cpu})
    try:
        result.send(list(work()))
    except MemoryError:
        result.send(_too_large(limits))
    except Exception as error:
        result.send(("error", f"{type(error).__name__}: {error}"[:200]))


def _collect(
    result: Connection,
    output_end: int,
    limits: NativeLimits,
    stop_when: Callable[[bytes], bool] | None,
) -> tuple[Answer | None, bytes]:
    """The answer, if it gave one or has to be ended, and the last of what it printed."""
    deadline = time.monotonic() + WALL_PER_CPU * limits.cpu_s + WALL_EXTRA_S
    answer: Answer | None = None
    text, line = b"", b""
    open_ends: list[Connection | int] = [result, output_end]
    while open_ends:
        ready = wait(open_ends, max(0.0, deadline - time.monotonic()))
        if not ready:
            return ("time", f"no end after {limits.cpu_s:g} s"), text
        if result in ready:
            open_ends.remove(result)
            with suppress(EOFError, OSError):  # it died: `output_end` and its exit code tell why
                answer = result.recv()
        if output_end in ready:
            piece = os.read(output_end, CHUNK)
            if not piece:
                open_ends.remove(output_end)
            text = (text + piece)[-4 * CHUNK :]
            *lines, line = (line + piece).split(b"\n")
            line = line[-CHUNK:]
            for full_line in lines:
                if stop_when is not None and stop_when(full_line):
                    return ("stopped", full_line.decode(errors="replace")), text
    return answer, text


def _death(exit_code: int, output: bytes, limits: NativeLimits) -> tuple[str, str]:
    """(cause, message) of a process that gave no answer. exit_code: minus the signal's number."""
    words = output.decode(errors="replace").strip().splitlines()
    last = words[-1].strip()[:200] if words else ""
    if b"MemoryError" in output or b"bad_alloc" in output:
        return _too_large(limits)
    if exit_code == -signal.SIGXCPU:
        return "time", f"no end after {limits.cpu_s:g} CPU s"
    if exit_code == -signal.SIGKILL:  # no library sends it
        return "memory", "was killed by the system, which ran out of memory"
    if exit_code < 0:
        name = signal.Signals(-exit_code).name
        return "crash", f"crashed ({name})" + (f": {last}" if last else "")
    return "error", last or f"ended with code {exit_code}"


def _too_large(limits: NativeLimits) -> tuple[str, str]:
    return "memory", f"needs more than {limits.memory_mb} MB"
