"""Workers that are ready, from which all builds of a process fork theirs.

A build starts a Python, which forks a worker per kind of steps, which imports what they need: most
of what a small test takes. Here each is started once.
"""

from __future__ import annotations

import atexit
import shutil
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from assetbuild.engine import children
from assetbuild.engine.children import Children
from assetbuild.engine.doors import Door, Kind, Origin, Worker
from assetbuild.engine.step import Step

if TYPE_CHECKING:
    import pytest


class Ready:
    """A worker per kind that never runs a step: others are forked from it."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="workers-"))
        # It ends with the thread that starts it, which is not that of a build.
        self._launcher = ThreadPoolExecutor(1)
        self.origin = self._launcher.submit(Origin).result()
        self.workers: dict[Kind, Worker] = {}

    def door(self, kind: Kind) -> Door:
        """The one for steps of this kind."""
        if kind not in self.workers:
            more = replace(kind, preload=(*kind.preload, *_modules_of(kind)))
            self.workers[kind] = self.origin.fork_worker(more, self._new_home())
            self.workers[kind].wait_for_start()
        return self.workers[kind]

    def _new_home(self) -> Path:
        return Path(tempfile.mkdtemp(dir=self.folder))

    def close(self) -> None:
        """End all of them."""
        for worker in self.workers.values():
            worker.end()
        self.origin.end()
        shutil.rmtree(self.folder, ignore_errors=True)


def all_steps() -> list[type[Step]]:
    """All classes of steps that have been imported so far."""
    steps: list[type[Step]] = []
    fresh: list[type[Step]] = [Step]
    while fresh:
        fresh = [derived for step in fresh for derived in step.__subclasses__()]
        steps += fresh
    return steps


def kind_of(step: type[Step]) -> Kind:
    """The kind of worker that a class of steps asks for, whatever its fields."""
    return Kind(step.preload, max(1, step.limits.cpus), step.network)


def _modules_of(kind: Kind) -> list[str]:
    """The package's modules of the steps of a kind."""
    modules = {step.__module__ for step in all_steps() if kind_of(step) == kind}
    return sorted(name for name in modules if name.startswith("assetbuild."))


@cache
def ready() -> Ready:
    """The one of this process."""
    made = Ready()
    atexit.register(made.close)
    return made


def fork_from_ready_workers(patch: pytest.MonkeyPatch) -> None:
    """Have all builds of this process do so."""
    patch.setattr(Children, "door", lambda self, kind: ready().door(kind))
    patch.setattr(children, "begin", lambda **_: None)
