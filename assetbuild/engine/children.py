"""The child processes of a session: one worker per set of modules, forked when needed."""

from __future__ import annotations

import os
import threading
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from assetbuild.engine.doors import Door, Ended, Kind, Origin, Worker, last_line
from assetbuild.engine.step import Step


class CancelledError(Exception):
    """The build is being stopped; the step did not fail."""


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
