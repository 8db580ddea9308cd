"""Small builds that several tests run."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

from steps_for_tests import Count, Mix, Split

from assetbuild.engine.execute import execute
from assetbuild.engine.graph import Graph
from assetbuild.engine.make import NodeResult
from assetbuild.engine.planner import Planner
from assetbuild.engine.session import Session
from assetbuild.engine.share.remote import Remote
from assetbuild.engine.step import Step
from assetbuild.engine.store import Store


def one(session: Session, step: Step, source: Path | None = None, **options: Any) -> NodeResult:
    planner = Planner(session)
    planner.add("it", step, {"in": planner.source(source)} if source else {})
    return execute(planner.graph(), session, **options)["it"]


def together(session: Session, steps: dict[str, Step], **options: Any) -> dict[str, NodeResult]:
    """Steps that read nothing, by label."""
    planner = Planner(session)
    for label, step in steps.items():
        planner.add(label, step)
    return execute(planner.graph(), session, **options)


def chained(session: Session, source: Path, kind: type[Mix] = Mix, keep: int = 16) -> Planner:
    """first -> second -> third, each reading the one before."""
    planner = Planner(session)
    first = planner.add("first", kind(keep=keep), {"in": planner.source(source)})
    second = planner.add("second", kind(salt=1), {"in": first["out"]})
    planner.add("third", kind(salt=2), {"in": second["out"]})
    return planner


def chain(session: Session, source: Path, kind: type[Mix] = Mix, keep: int = 16) -> Graph:
    return chained(session, source, kind, keep).graph()


SIZE = 10_000


def count_all(session: Session, log: Path, names: str) -> dict[str, str]:
    """One action of `SIZE` bytes for each letter; what became of each."""
    steps = {name: Count(log=str(log), name=name, text=name * SIZE) for name in names}
    results = together(session, steps, jobs=1)
    assert [str(r.error) for r in results.values() if r.error] == []
    return {name: result.status for name, result in results.items()}


def three_steps(planner: Planner, source: Path) -> None:
    """split -> mix -> last; of the first, a folder and one file of it are read."""
    split = planner.add("split", Split(), {"in": planner.source(source)})
    mix = planner.add("mix", Mix(), {"all/": split["parts/"], "one": split["parts/"] / "one"})
    planner.add("last", Mix(salt=1), {"in": mix["out"]})


def object_file(store: Store, digest: str) -> Path:
    return store.root / "cas" / digest[:2] / digest


def calling(module: str, call: str) -> list[str]:
    """The command of a Python of its own that calls a function of a module of this folder."""
    here = str(Path(__file__).parent)
    program = f"import sys; sys.path.insert(0, {here!r}); import {module}; {module}.{call}"
    return [sys.executable, "-c", program]


def assert_second_machine_builds_nothing(folder: Path, robot: Path, url: str) -> None:
    """Two stores and a server between them; results are signed."""
    first = Machine(folder / "a", url, write=True, key="k")
    gold = first.build(robot, width=12)
    second = Machine(folder / "b", url, key="k")
    results = second.build(robot, width=12)
    assert {r.status for r in gold.values()} == {"ran"}
    assert {r.status for r in results.values()} == {"cached"}
    for label, result in results.items():
        assert (result.outputs, result.findings) == (gold[label].outputs, gold[label].findings)
    assert (first.warnings, second.warnings) == ([], [])


class Machine:
    """A store of its own, and what it was warned of."""

    def __init__(self, folder: Path, url: str = "", **options: Any) -> None:
        self.folder = folder
        self.warnings: list[str] = []
        self.seconds = 0.0
        self.remote = None
        if url:
            self.remote = Remote(url, warn=self.warnings.append, **options)

    def build(self, robot: Path, width: int = 0) -> dict[str, NodeResult]:
        """Three steps, and `width` more that read the source alone."""
        began = time.monotonic()
        with Session(Store(self.folder), remote=self.remote) as session:
            planner = Planner(session)
            three_steps(planner, robot)
            for number in range(width):
                planner.add(f"wide{number}", Mix(salt=9 + number), {"in": planner.source(robot)})
            results = execute(planner.graph(), session, jobs=2)
            assert [str(r.error) for r in results.values() if r.error] == []
            self.content = session.read(results["last"]["out"])
        self.seconds = time.monotonic() - began
        return results
