"""The child processes: a first one imports what all share, workers are its forks, and so are steps.

A door is a socket that brings a socket for each request; on that comes one line of JSON. The first
process has its door as standard input and is asked for workers, `{"worker": CONFIG}`: it answers
`{"pid"}`, and the socket becomes the worker's door. A worker imports the modules of its kind once
and is asked for steps, `{"job", "modules"}`: the path of a job file, and what its step is made of.
Its process says `{"pid"}`, then how that ended: `{"status", "wall_s", "cpu_s", "over"}`, with
`"waits"` where the process takes one more `{"job"}` on the same socket. A crash of a step loses
that step only. When a door ends, because the parent closed it or died, everything that runs behind
it is killed.
"""

from __future__ import annotations

import errno
import gc
import importlib
import json
import math
import os
import resource
import select
import signal
import socket
import sys
import tempfile
import time
import traceback
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from assetbuild.engine.claims import die_with_parent

BOOT = (
    "import json, site, sys; given = json.loads(sys.argv[1]); "
    "[site.addsitedir(folder) for folder in given['sites']]; sys.path[:] = given['sys_path']; "
    "from assetbuild.engine import worker; worker.main()"
)
"""Program text of the first process; its one argument is a JSON object. Nothing comes from the cwd.

`-s` and another HOME hide the user's site folder; the `.pth` files in it may hold the import hook
of an editable installation, so it is one of the `sites`.
"""

LARGE_KB = 250_000
"""A process that needed more memory takes no further step: what is free in it stays with it."""
NO_SPACE = os.EX_IOERR
"""Exit status of a step's process that could not write its result: the disk is full."""


def main() -> None:
    """Serve requests until the input ends; with `once` in the argument, do one job instead."""
    config = json.loads(sys.argv[1])
    if "once" in config:
        _perform_jobs(config["once"])
    _serve(config, socket.socket(fileno=os.dup(0)))


def _serve(config: dict[str, Any], door: socket.socket) -> NoReturn:  # Any: JSON
    die_with_parent(config["parent"], signal.SIGTERM)
    _redirect(config["log"])
    gc.set_threshold(200_000, 20)  # as in the process that builds
    for module in config["preload"]:
        with suppress(ImportError):  # the step that needs it will say so itself
            importlib.import_module(module)
    gc.freeze()
    Zygote(config, door, fresh=_threads_survive_fork()).serve()


def _redirect(log: str) -> None:
    """Nothing on the standard input; prints and native messages go to the log."""
    nothing = os.open(os.devnull, os.O_RDONLY)
    out = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(nothing, 0)
    os.dup2(out, 1)
    os.dup2(out, 2)
    os.close(nothing)
    os.close(out)


def _threads_survive_fork() -> bool:
    """Did an import start threads that are not laid down for a fork? Then forks may lock up.

    OpenBLAS ends its threads before a fork, so one fork is made before they count.
    """
    if _threads() > 1:
        pid = os.fork()
        if pid == 0:
            os._exit(0)
        os.waitpid(pid, 0)
    return _threads() > 1


def _threads() -> int:
    """Threads of this process; 1 where the system does not say."""
    try:
        return len(os.listdir("/proc/self/task"))  # noqa: PTH208 - names are enough
    except OSError:
        return 1


@dataclass
class Running:
    """A process, the leader of its own process group. caller: who waits for a step, not a worker.

    ends_by: the signal after which it takes with it what it has started.
    """

    caller: socket.socket | None
    started: float
    ends_by: signal.Signals = signal.SIGKILL


class Zygote:
    """One thread, one loop: take requests, fork, reap.

    fresh: every fork becomes a new interpreter, because a plain one is not safe here.
    """

    def __init__(self, config: dict[str, Any], door: socket.socket, *, fresh: bool) -> None:
        self.config = config  # Any: JSON
        self.door = door
        self.fresh = fresh
        self.running: dict[int, Running] = {}
        self._wake, self._waker = os.pipe()
        os.set_blocking(self._wake, False)
        os.set_blocking(self._waker, False)
        signal.set_wakeup_fd(self._waker, warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.signal(signal.SIGTERM, lambda *_: self.leave())
        signal.signal(signal.SIGINT, signal.SIG_IGN)

    def serve(self) -> NoReturn:
        """Serve until the input ends."""
        while True:
            ready, _, _ = select.select([self.door.fileno(), self._wake], [], [])
            if self._wake in ready:
                with suppress(BlockingIOError):
                    os.read(self._wake, 4096)
            self.reap()
            if self.door.fileno() in ready:
                self.start()

    def load(self, modules: list[str]) -> None:
        """Import the step's own modules here, once, so that its forks need not."""
        if self.fresh or all(module in sys.modules for module in modules):
            return
        for module in modules:
            with suppress(Exception):  # the process of the step will meet it again, and say so
                importlib.import_module(module)
        _seed()  # numpy loads its generators when they are first named: once, not in each fork
        gc.freeze()
        self.fresh = _threads_survive_fork()

    def start(self) -> None:
        """Take a request and fork its process; leave when the door has ended."""
        mark, descriptors, _, _ = socket.recv_fds(self.door, 1, 1)
        if not mark:
            self.leave()
        caller = socket.socket(fileno=descriptors[0])
        request = json.loads(caller.makefile("rb").readline())
        if "job" in request:
            self.load(request["modules"])
        me = os.getpid()
        now = time.monotonic()
        try:
            pid = os.fork()
        except OSError as error:  # no process or memory left
            _say(caller, status=None, over=str(error))
            caller.close()
            return
        if pid == 0:
            self._become(request, me, caller)
        with suppress(OSError):  # the child does the same; whoever comes first
            os.setpgid(pid, pid)
        if "job" in request:
            self.running[pid] = Running(caller, now)
        else:
            _say(caller, pid=pid)
            self.running[pid] = Running(None, now, ends_by=signal.SIGTERM)
            caller.close()

    def _become(self, request: dict[str, Any], parent: int, caller: socket.socket) -> NoReturn:
        """Be the step or the worker, in the fork; Any: JSON."""
        try:
            os.setpgid(0, 0)
            signal.set_wakeup_fd(-1)
            for number in (signal.SIGCHLD, signal.SIGTERM, signal.SIGINT):
                signal.signal(number, signal.SIG_DFL)
            for end in (self.door, *(run.caller for run in self.running.values())):
                if end is not None:
                    end.close()
            os.close(self._wake)
            os.close(self._waker)
            if "job" in request:
                die_with_parent(parent, signal.SIGKILL)
                _say(caller, pid=os.getpid())
                if self.fresh:
                    caller.close()
                    _become_python({**self.config, "once": request["job"]})
                _perform_jobs(request["job"], caller)
            self._become_worker({**self.config, **request["worker"], "parent": parent}, caller)
        except BaseException:
            traceback.print_exc()  # to the log
        finally:
            os._exit(70)

    def _become_worker(self, config: dict[str, Any], door: socket.socket) -> NoReturn:  # Any: JSON
        os.environ.clear()
        os.environ.update(config["environ"])
        os.chdir(config["home"])
        if self.fresh:
            os.dup2(door.fileno(), 0)
            _become_python(config)
        sys.path[:] = config["sys_path"]
        _serve(config, door)

    def reap(self) -> None:
        """Report the processes that ended, and end what they left behind."""
        for pid in list(self.running):
            ended_pid, status, used = os.wait4(pid, os.WNOHANG)
            if ended_pid == 0:
                continue
            run = self.running.pop(pid)
            with suppress(OSError):
                os.killpg(pid, signal.SIGKILL)
            if run.caller is None:
                continue
            _say(
                run.caller,
                status=status,
                wall_s=round(time.monotonic() - run.started, 4),
                cpu_s=round(used.ru_utime + used.ru_stime, 4),
            )
            run.caller.close()

    def leave(self) -> NoReturn:
        """Kill everything that runs, and end."""
        for pid, run in self.running.items():
            with suppress(OSError):
                os.killpg(pid, run.ends_by)
        os._exit(0)


def _become_python(config: dict[str, Any]) -> NoReturn:  # Any: JSON
    """A new interpreter in place of this process."""
    argv = [sys.executable, "-P", "-s", "-c", BOOT, json.dumps(config)]
    os.execv(sys.executable, argv)  # noqa: S606 - our own interpreter


def _say(caller: socket.socket, **message: object) -> None:
    """One line of JSON to whoever waits for a job, if anybody does."""
    with suppress(OSError):
        caller.sendall(json.dumps(message).encode() + b"\n")


def _perform_jobs(path: str, caller: socket.socket | None = None) -> NoReturn:
    """Run the step of a job file and write its result; so with those that the caller sends yet, as
    long as this process is as good as new. Then end it.
    """
    try:
        lines = caller.makefile("rb") if caller else None
        while True:
            began, used = time.monotonic(), _cpu_s()
            may_go_on = _run_step(json.loads(Path(path).read_bytes()), used)
            if caller is None or lines is None or not may_go_on or not _is_as_new():
                break
            spent = {"wall_s": time.monotonic() - began, "cpu_s": _cpu_s() - used}
            _say(caller, status=0, waits=True, **{k: round(v, 4) for k, v in spent.items()})
            line = lines.readline()
            if not line:
                break
            path = json.loads(line)["job"]
        os._exit(0)  # no exit handlers: those of native libraries hang or crash after a fork
    except OSError as error:  # the step's own are in its result: this is the log or the result
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            os._exit(NO_SPACE)
        raise


def _cpu_s() -> float:
    """Processor time of this process so far, and of those that it waited for."""
    spent = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(used.ru_utime + used.ru_stime for used in spent)


def _is_as_new() -> bool:
    """Is this process small, and has the step left no thread and no process?"""
    if _threads() > 1 or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss > LARGE_KB:
        return False
    try:
        os.waitpid(-1, os.WNOHANG)
    except ChildProcessError:
        return True
    return False


def _run_step(job: dict[str, Any], used_s: float) -> bool:  # Any: JSON
    """Whether another step may follow here. used_s: processor time of earlier ones."""
    from assetbuild.engine.confine import set_limits
    from assetbuild.engine.step import Files, Limits
    from assetbuild.engine.wire import perform, step_from_json

    _redirect(job["log"])
    os.chdir(job["home"])
    os.environ.update(job["environ"])
    tempfile.tempdir = None  # an import may have looked it up before TMPDIR was ours
    limits = Limits(**job["limits"])
    cpu_s = math.ceil(used_s + limits.wall_s * max(1, limits.cpus)) + 5
    set_limits(
        limits.memory_mb, {resource.RLIMIT_FSIZE: limits.file_mb << 20, resource.RLIMIT_CPU: cpu_s}
    )
    _seed()
    files = Files(Path(job["inputs"]), Path(job["outputs"]))
    result, trace = perform(lambda: step_from_json(job["step"]), files, job["label"], limits)
    sys.stdout.flush()
    sys.stderr.write(trace)
    sys.stderr.flush()
    Path(job["result"]).write_text(json.dumps(result), encoding="utf-8")
    return bool(job["shares"]) and "error" not in result


def _seed() -> None:
    """Forked steps share the generators of the modules loaded before: start them all alike."""
    import random

    random.seed(0)
    numpy = sys.modules.get("numpy")
    if numpy is not None:
        numpy.random.seed(0)
