"""The parent's side of child processes: one worker per set of modules, started when needed."""

from __future__ import annotations

import json
import os
import signal
import site
import socket
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
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
        self._workers: dict[Kind, Worker] = {}
        self._lock = threading.Lock()
        # The kernel's parent-death signal is tied to the *thread* that starts a process, so all
        # are started by one thread that lives as long as this object.
        self._launcher = ThreadPoolExecutor(1, thread_name_prefix="assetbuild-launcher")

    def run(self, step: Step, job: Path) -> Ended:
        """Run a job file to its end. A worker that dies under it is replaced once."""
        kind = Kind.of(step)
        ended = None
        for _ in range(2):
            worker = self._worker(kind)
            ended = worker.run(step, job)
            if self.closed:
                raise CancelledError
            if ended is not None:
                return ended
            log = last_line(worker.log)
        return Ended(status=worker.process.poll(), over="worker", log=log)

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
                number = len(os.listdir(self.folder))  # noqa: PTH208 - a count is enough
                home = self.folder / f"worker-{number}"
                worker = self._launcher.submit(Worker, kind, home).result()
                self._workers[kind] = worker
            return worker

    def close(self) -> None:
        """Kill every step that runs and end the workers; two seconds at most."""
        with self._lock:
            self.closed = True
            workers = list(self._workers.values())
            self._workers.clear()
        for worker in workers:
            worker.ask_to_leave()
        for worker in workers:
            worker.end()
        self._launcher.shutdown(wait=False)


class Worker:
    """One worker process. Each job has a socket of its own, which ends when the worker does."""

    def __init__(self, kind: Kind, home: Path) -> None:
        home.mkdir(parents=True)
        self.log = home / "log"
        self._groups: dict[Path, int] = {}
        self._lock = threading.Lock()
        config = {
            "sites": [site.getusersitepackages()] if site.ENABLE_USER_SITE else [],
            "sys_path": [os.path.abspath(p) for p in sys.path if p],  # noqa: PTH100 - strings
            "preload": kind.preload,
            "parent": os.getpid(),
            "log": str(self.log),
        }
        self._door, theirs = socket.socketpair()
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-s", "-c", BOOT, json.dumps(config)],
                stdin=theirs.fileno(),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                cwd=home,
                env=environment(kind, home),
                start_new_session=True,  # Ctrl-C of the terminal is the parent's to handle
            )

    @property
    def dead(self) -> bool:
        """Has the process ended?"""
        return self.process.poll() is not None

    def run(self, step: Step, job: Path) -> Ended | None:
        """Run one job; None when the worker died meanwhile."""
        request = {"job": str(job), "module": type(step).__module__, "wall_s": step.limits.wall_s}
        ours, theirs = socket.socketpair()
        with suppress(OSError), ours:
            with theirs, self._lock:
                socket.send_fds(self._door, [b"."], [theirs.fileno()])
            ours.sendall(json.dumps(request).encode() + b"\n")
            for line in ours.makefile():
                answer = json.loads(line)
                if "pid" not in answer:
                    self._groups.pop(job, None)
                    return Ended(**answer)
                self._groups[job] = answer["pid"]
        self.end()
        return None

    def ask_to_leave(self) -> None:
        """End its input: it kills its steps and ends."""
        with self._lock:
            self._door.close()

    def end(self) -> None:
        """Wait a moment, then kill it."""
        self.ask_to_leave()
        try:
            self.process.wait(CLOSING_S)
        except subprocess.TimeoutExpired:
            for group in list(self._groups.values()):
                with suppress(OSError):
                    os.killpg(group, signal.SIGKILL)
            self.process.kill()
            self.process.wait()


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
    fixed |= cpu_class().environment
    fixed |= {"PYTHONHASHSEED": "0", "PYTHONUTF8": "1", "TZ": "UTC", "LC_ALL": "C"}
    fixed["MESA_SHADER_CACHE_DISABLE"] = "true"  # it lies in the user's home, whatever HOME says
    return kept | fixed


def step_environment(step: Step, home: Path) -> dict[str, str]:
    """What the process of one step sets on top of its worker's environment."""
    return {"TMPDIR": str(home)} if step.network else {"TMPDIR": str(home), "HOME": str(home)}


def last_line(log: Path) -> str:
    """The last line of a log, cut short; nothing where there is none."""
    with suppress(OSError):
        lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return lines[-1].strip()[:300] if lines else ""
    return ""
