"""The parent's side of child processes: one worker per set of modules, forked when needed."""

from __future__ import annotations

import json
import os
import select
import signal
import site
import socket
import subprocess
import sys
import threading
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

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


class CancelledError(Exception):
    """The build is being stopped; the step did not fail."""


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


class Children:
    """All child processes of one session. `run` may be called from many threads.

    folder: private; holds the workers' logs and their home.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.closed = False
        early = _EARLY.pop() if _EARLY else _Early()
        self._origin, self._workers, self._keep = early.origin, dict(early.workers), early.keep
        self._lock = threading.Lock()
        # The kernel's parent-death signal is tied to the *thread* that starts a process, so it is
        # started by one thread that lives as long as this object.
        self._launcher = ThreadPoolExecutor(1, thread_name_prefix="assetbuild-launcher")

    def run(self, step: Step, job: Path) -> Ended:
        """Run a job file to its end. A worker that dies under it is replaced once."""
        kind = Kind.of(step)
        for _ in range(2):
            worker = self._worker(kind)
            ended = worker.run(step, job)
            if self.closed:
                raise CancelledError
            if ended is not None:
                return ended
            log = last_line(worker.log)
        return Ended(status=None, over="worker", log=log)

    def prepare(self, step: Step) -> None:
        """Start the worker of such steps, if there is none and the machine lets us."""
        with suppress(CancelledError, OSError):  # `run` says what is wrong
            self._worker(Kind.of(step))

    def _worker(self, kind: Kind) -> Worker:
        with self._lock:
            if self.closed:
                raise CancelledError
            worker = self._workers.get(kind)
            if worker is None or worker.dead:
                worker = self.door(kind).fork_worker(kind, self._new_home())
                self._workers[kind] = worker
            return worker

    def _new_home(self) -> Path:
        home = self.folder / f"worker-{len(os.listdir(self.folder))}"  # noqa: PTH208 - a count
        home.mkdir(parents=True)
        return home

    def door(self, kind: Kind) -> Door:
        """The process that forks workers of this kind, started if need be."""
        del kind  # one process forks all
        if self._origin is None or self._origin.dead:
            self._origin = self._launcher.submit(Origin).result()
        return self._origin

    def rest(self) -> None:
        """Let the workers go while no step comes; one that comes yet has new ones."""
        if self._keep:
            return
        with self._lock:
            for worker in self._workers.values():
                worker.ask_to_leave()

    def close(self) -> None:
        """Kill every step that runs and end the workers, two seconds at most; or keep those that
        have nothing to do.
        """
        with self._lock:
            if self.closed:
                return
            self.closed = True
            workers = list(self._workers.values())
            stays = self._keep and not any(worker.busy for worker in workers)
            if stays:
                _EARLY.append(_Early(self._origin, dict(self._workers), keep=True))
            self._workers.clear()
        if not stays:
            for worker in workers:
                worker.ask_to_leave()
            for worker in workers:
                worker.end()
            if self._origin is not None:
                self._origin.end()
        self._launcher.shutdown(wait=False)


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


@dataclass(frozen=True)
class _Early:
    """What runs before a build needs it. keep: it serves the build after that one, too."""

    origin: Origin | None = None
    workers: Mapping[Kind, Worker] = field(default_factory=dict)
    keep: bool = False


_EARLY: list[_Early] = []
"""At most one, which the next `Children` of this process takes over."""


def begin(*, keep: bool = False) -> None:
    """Start the first process: it imports while the recipe is read. Called by the main thread.

    keep: what one build has started serves the next one of this process too.
    """
    with suppress(OSError):  # the build says what is wrong
        if not _EARLY:
            _EARLY.append(_Early(Origin(), keep=keep))


class Worker(Door):
    """One worker. The sockets of its jobs end when it does; at its door it sends its `{"pid"}`."""

    def __init__(self, end: socket.socket, log: Path) -> None:
        super().__init__(end)
        self.log = log
        self._received = b""
        self._reading = threading.Lock()
        self._groups: dict[Path, int] = {}

    @property
    def pid(self) -> int:
        """The worker's process ID; 0 until the worker has sent it."""
        return (
            int(json.loads(self._received).get("pid", 0)) if self._received.endswith(b"\n") else 0
        )

    @property
    def busy(self) -> bool:
        """Does it run a step?"""
        return bool(self._groups)

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
            if not select.select([self._end], [], [], seconds)[0]:
                return False
            try:
                received = self._end.recv(4096)
            except ConnectionResetError:  # it died with a request that it had not read
                return True
            self._received += received
            return not received

    def run(self, step: Step, job: Path) -> Ended | None:
        """Run one job; None when the worker died meanwhile."""
        modules = [type(step).__module__, *step.imports]
        request = {"job": str(job), "modules": modules, "wall_s": step.limits.wall_s}
        self.wait_for_start()
        with suppress(OSError), self.ask(request) as answers:
            for line in answers.makefile():
                answer = json.loads(line)
                if "pid" not in answer:
                    self._groups.pop(job, None)
                    return Ended(**answer)
                self._groups[job] = answer["pid"]
        self.end()
        return None

    def end(self) -> None:
        """Wait a moment for it to leave, then kill it and its steps."""
        self.ask_to_leave()
        if not self._ends_within(0.0) and not self._ends_within(CLOSING_S):
            for group in filter(None, (*self._groups.values(), self.pid)):
                with suppress(OSError):
                    os.killpg(group, signal.SIGKILL)
        self._end.close()


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
