"""The parent's side of one child process: what it is like, and what goes through its door."""

from __future__ import annotations

import json
import math
import os
import select
import signal
import site
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from assetbuild.engine.cpu import cpu_class
from assetbuild.engine.step import Step
from assetbuild.engine.worker import BOOT

CLOSING_S = 1.0
"""How long a worker may take to kill its steps and end, before it is killed itself."""

KEPT_ENVIRONMENT = ("PATH", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "VIRTUAL_ENV", "SYSTEMROOT")
KEPT_PREFIXES = ("CUDA_", "NVIDIA_", "__EGL_")
THREAD_COUNTS = (
    "OMP_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "TBB_NUM_THREADS",
    "PXR_WORK_THREAD_LIMIT",
    "RAYON_NUM_THREADS",
)
BLAS_THREAD_COUNTS = (
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
"""Always one: OpenBLAS starts no more than there are cores, and adds in another order then."""
REUSE_MEMORY = dict.fromkeys(("MALLOC_MMAP_THRESHOLD_", "MALLOC_TRIM_THRESHOLD_"), str(1 << 30))
"""What a step frees stays with it (glibc): page faults were a tenth of a build."""


SHARED = (
    "assetbuild.engine.wire",
    "assetbuild.facts.reader",
    "numpy.ma",
    "numpy.random",
    "pydantic.plugin._loader",
)
"""Modules that all workers have: imported once, before the first of them is forked."""


@dataclass(frozen=True)
class Ended:
    """How the process of one step ended.

    status: as `os.wait` gives it; None when it never ran. over: `wall` when it was killed for
    running over its time, or why it could not start. log: last line of a dead worker's log.
    attempts: processes that it took.
    """

    status: int | None
    wall_s: float = 0.0
    cpu_s: float = 0.0
    over: str = ""
    log: str = ""
    attempts: int = 1


@dataclass(frozen=True)
class Kind:
    """What a worker must be like for a step: two steps of one kind share a worker."""

    preload: tuple[str, ...]
    cpus: int
    network: bool

    @classmethod
    def of(cls, step: Step) -> Kind:
        """The kind of worker that a step asks for."""
        return cls(step.modules(), max(1, step.limits.cpus), step.network)


class Door:
    """A process that takes requests, each on a socket of its own. end: our end of its door."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self._lock = threading.Lock()

    def fork_worker(self, kind: Kind, home: Path) -> Worker:
        """Have the process fork a worker, without waiting for it. OSError."""
        config = {
            "sys_path": _search_path(),
            "preload": kind.preload,
            "log": str(home / "log"),
            "home": str(home),
            "environ": environment(kind, home),
        }
        return Worker(self.ask({"worker": config}), home / "log")

    def ask(self, request: object) -> socket.socket:
        """The socket on which the answers come; it ends when the process does. OSError."""
        ours, theirs = socket.socketpair()
        try:
            with theirs, self._lock:
                socket.send_fds(self._end, [b"."], [theirs.fileno()])
            ours.sendall(json.dumps(request).encode() + b"\n")
        except OSError:
            ours.close()
            raise
        return ours

    def ask_to_leave(self) -> None:
        """Ask the process to kill what it has started, and to end."""
        with suppress(OSError):
            self._end.shutdown(socket.SHUT_WR)


class Origin(Door):
    """The first process: it has imported what all workers share, and forks them."""

    def __init__(self) -> None:
        config = {
            "sites": [site.getusersitepackages()] if site.ENABLE_USER_SITE else [],
            "sys_path": _search_path(),
            "preload": SHARED,
            "parent": os.getpid(),
            "log": os.devnull,
        }
        ours, theirs = socket.socketpair()
        super().__init__(ours)
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-s", "-c", BOOT, json.dumps(config)],
                stdin=theirs.fileno(),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                cwd=os.sep,
                env=environment(Kind((), 1, False), Path(os.sep)),
                start_new_session=True,  # Ctrl-C of the terminal is the parent's to handle
            )

    @property
    def dead(self) -> bool:
        """Has the process ended?"""
        return self.process.poll() is not None

    def end(self) -> None:
        """Wait a moment, then kill it."""
        self.ask_to_leave()
        try:
            self.process.wait(CLOSING_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._end.close()


class Worker(Door):
    """One worker. The sockets of its jobs end when it does; at its door it sends its `{"pid"}`.

    pid: 0 until then.
    """

    def __init__(self, end: socket.socket, log: Path) -> None:
        super().__init__(end)
        self.log = log
        self.pid = 0
        self._lines = Lines(end)
        self._reading = threading.Lock()
        self._running: set[Fork] = set()
        self._waiting: list[Fork] = []

    @property
    def busy(self) -> bool:
        """Does it run a step?"""
        return bool(self._running)

    @property
    def dead(self) -> bool:
        """Has the process ended?"""
        return self._ends_within(0.0)

    def wait_for_start(self) -> None:
        """Wait until it listens at its door; a request sent earlier is lost."""
        while not self.pid and not self._ends_within(0.1):
            pass

    def _ends_within(self, seconds: float) -> bool:
        """Whether its process ends; returns early when it says something."""
        with self._reading:
            if self._end.fileno() < 0:
                return True
            said = self._lines.next(seconds)
            self.pid = said["pid"] if said else self.pid
            return said == {}

    def run(self, step: Step, job: Path) -> Ended | None:
        """Run one job; None when the worker died meanwhile."""
        self.wait_for_start()
        with suppress(OSError, IndexError):
            fork = self._waiting.pop() if step.may_share() and self._waiting else Fork(self)
            self._running.add(fork)
            ended = fork.run(step, job)
            self._running.discard(fork)
            if fork.waits:
                self._waiting.append(fork)
            if ended is not None:
                return ended
        self.end()
        return None

    def end(self) -> None:
        """Wait a moment for it to leave, then kill it and its steps."""
        self.ask_to_leave()
        if not self._ends_within(0.0) and not self._ends_within(CLOSING_S):
            for group in filter(None, (*(fork.pid for fork in self._running), self.pid)):
                with suppress(OSError):
                    os.killpg(group, signal.SIGKILL)
        self._end.close()


class Fork:
    """A fork of a worker: it runs one step and, where steps may share a process, the next ones.

    pid: 0 until it runs. waits: it takes another step.
    """

    def __init__(self, worker: Worker) -> None:
        self._worker = worker
        self._lines: Lines | None = None
        self.pid = 0
        self.waits = False

    def run(self, step: Step, job: Path) -> Ended | None:
        """Run a job, and kill what runs over its time; None when the worker died. OSError."""
        request = {"job": str(job), "modules": [type(step).__module__, *step.imports]}
        if self._lines is None:
            self._lines = Lines(self._worker.ask(request))
        else:
            self._lines.end.sendall(json.dumps(request).encode() + b"\n")
        answer = self._lines.next(step.limits.wall_s if self.pid else math.inf)
        if answer and "pid" in answer:  # its time begins when its process does
            self.pid, answer = answer["pid"], self._lines.next(step.limits.wall_s)
        if answer is None:
            with suppress(OSError):
                os.killpg(self.pid, signal.SIGKILL)
            killed = self._lines.next()
            answer = (killed and killed | {"over": "wall"}) or {}
        self.waits = answer.pop("waits", False)
        if not self.waits:
            self._lines.end.close()
        return Ended(**answer) if answer else None


class Lines:
    """What a process says on its socket: lines of JSON. end: ours."""

    def __init__(self, end: socket.socket) -> None:
        self.end = end
        self._received = b""

    def next(self, seconds: float = math.inf) -> dict[str, Any] | None:  # Any: JSON
        """The next one; empty when the process has ended, None when nothing comes for so long."""
        deadline = time.monotonic() + seconds
        while b"\n" not in self._received:
            left_s = None if seconds == math.inf else max(0.0, deadline - time.monotonic())
            if not select.select([self.end], [], [], left_s)[0]:
                return None
            try:
                received = self.end.recv(4096)
            except ConnectionResetError:  # it died with a request that it had not read
                return {}
            if not received:
                return {}
            self._received += received
        line, _, self._received = self._received.partition(b"\n")
        return dict(json.loads(line))


def _search_path() -> list[str]:
    return [os.path.abspath(path) for path in sys.path if path]  # noqa: PTH100 - strings


def environment(kind: Kind, home: Path) -> dict[str, str]:
    """The environment of a worker, complete before it starts: the same on every machine with a CPU
    of this class.

    A step with network access keeps the user's, for proxies, certificates and index settings.
    """
    if kind.network:
        kept = dict(os.environ)
    else:
        kept = {
            name: value
            for name, value in os.environ.items()
            if name in KEPT_ENVIRONMENT or name.startswith(KEPT_PREFIXES)
        }
        kept["HOME"] = str(home)
    fixed = dict.fromkeys(THREAD_COUNTS, str(kind.cpus)) | dict.fromkeys(BLAS_THREAD_COUNTS, "1")
    fixed |= cpu_class().environment | REUSE_MEMORY
    fixed |= {"PYTHONHASHSEED": "0", "PYTHONUTF8": "1", "TZ": "UTC", "LC_ALL": "C"}
    fixed["MESA_SHADER_CACHE_DISABLE"] = "true"  # it lies in the user's home, whatever HOME says
    fixed["GALLIVM_PERF"] = "nopt"  # Mesa would optimize its shaders longer than it draws
    fixed["PYDANTIC_DISABLE_PLUGINS"] = "__all__"  # it would look through all distributions
    fixed["MUJOCO_GL"] = "disable"  # else MuJoCo imports GLFW, which takes longer than MuJoCo
    return kept | fixed


def last_line(log: Path) -> str:
    """The last line of a log, cut short; nothing where there is none."""
    with suppress(OSError):
        lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return lines[-1].strip()[:300] if lines else ""
    return ""
