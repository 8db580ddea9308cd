"""Small builds that several tests run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from steps_for_tests import Mix

from assetbuild.engine.execute import NodeResult, execute
from assetbuild.engine.graph import Graph, Planner
from assetbuild.engine.session import Session
from assetbuild.engine.step import Step


def one(session: Session, step: Step, source: Path | None = None, **options: Any) -> NodeResult:
    planner = Planner(session)
    planner.add("it", step, {"in": planner.source(source)} if source else {})
    return execute(planner.graph(), session, **options)["it"]


def chain(session: Session, source: Path, kind: type[Mix] = Mix, keep: int = 16) -> Graph:
    """first -> second -> third, each reading the one before."""
    planner = Planner(session)
    first = planner.add("first", kind(keep=keep), {"in": planner.source(source)})
    second = planner.add("second", kind(salt=1), {"in": first["out"]})
    planner.add("third", kind(salt=2), {"in": second["out"]})
    return planner.graph()


def is_alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"
