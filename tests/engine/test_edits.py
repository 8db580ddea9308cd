"""A source edited while its step runs: nothing is kept under the old key (F13)."""

from __future__ import annotations

from pathlib import Path

import pytest
from steps_for_tests import Edit, Mix

from assetbuild.engine.execute import execute
from assetbuild.engine.graph import Graph
from assetbuild.engine.planner import Planner
from assetbuild.engine.session import Session
from assetbuild.engine.store import Store
from assetbuild.errors import SourceError


def graph_of(session: Session, source: Path, as_member: bool) -> Graph:
    planner = Planner(session)
    ref = planner.source(source)
    if as_member:
        ref = planner.source_tree(source.parent, [source.name, "other"]) / source.name
    edit = planner.add("edit", Edit(path=str(source)), {"in": ref})
    planner.add("after", Mix(), {"in": edit["out"]})
    return planner.graph()


@pytest.mark.parametrize("as_member", [False, True])
def test_an_edit_during_the_build_is_told_and_the_next_build_is_right(tmp_path, as_member):
    folder = tmp_path / "robot"
    folder.mkdir()
    source = folder / "source"
    source.write_text("1")
    (folder / "other").write_text("other")
    with Session(Store(tmp_path / "store")) as session:
        results = execute(graph_of(session, source, as_member), session)
        error = results["edit"].error
        assert isinstance(error, SourceError)
        assert "was edited during the build" in str(error)
        assert results["after"].status == "blocked"
        assert session.store.action(results["edit"].key) is None
    with Session(Store(tmp_path / "store")) as session:
        results = execute(graph_of(session, source, as_member), session)
        assert [r.status for r in results.values()] == ["ran", "ran"]
        assert session.read(results["edit"]["out"]) == b"2"


def test_an_edit_of_a_file_that_the_step_does_not_read_is_no_fault(tmp_path: Path):
    folder = tmp_path / "robot"
    folder.mkdir()
    (folder / "read").write_text("x")
    (folder / "edited").write_text("1")
    with Session(Store(tmp_path / "store")) as session:
        planner = Planner(session)
        tree = planner.source_tree(folder, ["read", "edited"])
        planner.add("edit", Edit(path=str(folder / "edited")), {"in": tree / "read"})
        assert execute(planner.graph(), session)["edit"].status == "ran"
