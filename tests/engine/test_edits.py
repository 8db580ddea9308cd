"""A source edited while its step runs: nothing is kept under the old key (F13)."""

from __future__ import annotations

from pathlib import Path

from steps_for_tests import Edit, Mix

from assetbuild.engine.execute import execute
from assetbuild.engine.graph import Graph
from assetbuild.engine.planner import Planner
from assetbuild.engine.session import Session
from assetbuild.engine.store import Store
from assetbuild.errors import SourceError


def graph_of(session: Session, source: Path) -> Graph:
    planner = Planner(session)
    ref = planner.source(source)
    edit = planner.add("edit", Edit(path=str(source)), {"in": ref})
    planner.add("after", Mix(), {"in": edit["out"]})
    return planner.graph()


def test_an_edit_during_the_build_is_told_and_the_next_build_is_right(tmp_path: Path):
    folder = tmp_path / "robot"
    folder.mkdir()
    source = folder / "source"
    source.write_text("1")
    with Session(Store(tmp_path / "store")) as session:
        results = execute(graph_of(session, source), session)
        error = results["edit"].error
        assert isinstance(error, SourceError)
        assert "was edited during the build" in str(error)
        assert results["after"].status == "blocked"
        assert session.store.action(results["edit"].key) is None
    with Session(Store(tmp_path / "store")) as session:
        results = execute(graph_of(session, source), session)
        assert [r.status for r in results.values()] == ["ran", "ran"]
        assert session.read(results["edit"]["out"]) == b"2"
