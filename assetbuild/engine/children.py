"""The parent's side of child processes: one worker per set of modules, started when needed."""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import threading
from concurrent.futures import Future, ThreadPoolExecutor
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
        return cls(step.preload, max(1, step.limits.cpus), step.network)


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
    """One worker process; the dialogue with it."""

    def __init__(self, kind: Kind, home: Path) -> None:
        home.mkdir(parents=True)
        self.log = home / "log"
        self.dead = False
        self._numbers = itertools.count()
        self._waiting: dict[int, Future[Ended | None]] = {}
        self._groups: dict[int, int] = {}
        self._lock = threading.Lock()
        config = {
            "sys_path": [os.path.abspath(p) for p in sys.path if p],  # noqa: PTH100 - strings
            "preload": kind.preload,
            "parent": os.getpid(),
            "log": str(self.log),
        }
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-s", "-c", BOOT, json.dumps(config)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            cwd=home,
            env=environment(kind, home),
            start_new_session=True,  # Ctrl-C of the terminal is the parent's to handle
        )
        threading.Thread(target=self._listen, daemon=True).start()

    def run(self, step: Step, job: Path) -> Ended | None:
        """Run one job; None when the worker died meanwhile."""
        future: Future[Ended | None] = Future()
        with self._lock:
            if self.dead:
                return None
            number = next(self._numbers)
            self._waiting[number] = future
            request = {"id": number, "job": str(job), "wall_s": step.limits.wall_s}
            request["module"] = type(step).__module__
            with suppress(OSError):  # dead: the listener answers
                self._stdin.write(json.dumps(request).encode() + b"\n")
                self._stdin.flush()
        return future.result()

    @property
    def _stdin(self) -> Any:  # Any: a binary pipe; Popen types it as optional
        return self.process.stdin

    def _listen(self) -> None:
        pipe = self.process.stdout
        if pipe is None:
            raise AssertionError("the worker was started with a pipe")
        with suppress(OSError, ValueError):
            for line in pipe:
                self._take(json.loads(line))
        pipe.close()
        with self._lock:
            self.dead = True
            waiting = list(self._waiting.values())
            self._waiting.clear()
        self.end()
        for future in waiting:
            future.set_result(None)

    def _take(self, message: dict[str, Any]) -> None:  # Any: JSON
        if "pid" in message:
            self._groups[message["id"]] = message["pid"]
        elif "id" in message:
            number = message.pop("id")
            self._groups.pop(number, None)
            with self._lock:
                future = self._waiting.pop(number, None)
            if future is not None:
                future.set_result(Ended(**message))

    def _kill_groups(self) -> None:
        for pid in list(self._groups.values()):
            with suppress(OSError):
                os.killpg(pid, signal.SIGKILL)
        self._groups.clear()

    def ask_to_leave(self) -> None:
        """End its input: it kills its steps and ends."""
        with suppress(OSError):
            self._stdin.close()

    def end(self) -> None:
        """Wait a moment, then kill it."""
        try:
            self.process.wait(CLOSING_S)
        except subprocess.TimeoutExpired:
            self._kill_groups()
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
