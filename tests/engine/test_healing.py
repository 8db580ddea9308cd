"""What the store lost is made again, and an edit during the build is told."""

from __future__ import annotations

from pathlib import Path

import pytest
from builds_for_tests import chain, chained, object_file
from steps_for_tests import Edit, Irreproducible, Mix, flip

from assetbuild.engine.execute import execute
from assetbuild.engine.graph import Graph
from assetbuild.engine.planner import Planner
from assetbuild.engine.session import Session
from assetbuild.engine.store import LostObjectError, Store
from assetbuild.errors import SourceError

ALL = ("first", "second", "third")


@pytest.mark.parametrize(
    ("labels", "fault"), [(["first"], flip), (["third"], Path.unlink), (ALL, flip)]
)
def test_a_lost_object_is_made_again_when_it_is_needed(tmp_path, source, labels, fault):
    with Session(Store(tmp_path / "store")) as session:
        gold = execute(chain(session, source), session)
        want = session.read(gold["third"]["out"])
        for label in labels:
            fault(object_file(session.store, gold[label]["out"]))
    with Session(Store(tmp_path / "store")) as session:
        planner = chained(session, source)
        made = {label: node["out"] for label, node in planner.graph().nodes.items()}
        planner.add("new", Mix(salt=9), made)
        results = execute(planner.graph(), session, jobs=3)
        assert results["new"].status == "ran"
        for label in labels:
            assert results[label].status == "ran"
            assert "missing or corrupt" in results[label].reason
        assert session.read(results["third"]["out"]) == want


def test_what_was_lost_when_it_is_restored_is_made_again_by_the_next_execution(tmp_path, source):
    with Session(Store(tmp_path / "store")) as session:
        graph = chain(session, source)
        digest = execute(graph, session)["third"]["out"]
        want = session.read(digest)
        flip(object_file(session.store, digest))
        with pytest.raises(LostObjectError):
            session.store.restore(digest, tmp_path / "dest")
        session.forget()
        execute(graph, session)
        session.store.restore(digest, tmp_path / "dest")
    assert (tmp_path / "dest").read_bytes() == want


def test_a_question_about_a_lost_object_is_open_again(session, source):
    digest = execute(chain(session, source), session)["third"]["out"]
    flip(object_file(session.store, digest))
    planner = chained(session, source)
    third = planner.graph().nodes["third"]
    assert planner.ask(third["out"]) is None
    execute(planner.graph(), session)
    assert planner.ask(third["out"]) is not None


def test_a_step_that_gives_other_bytes_each_time_is_told_on(session):
    """The store loses an output, and making it again gives other bytes."""
    planner = Planner(session)
    first = planner.add("first", Irreproducible())
    digest = execute(planner.graph(), session)["first"]["parts/"]
    planner.add("second", Mix(), {"parts/": first["parts/"]})
    object_file(session.store, digest).unlink()
    error = execute(planner.graph(), session)["first"].error
    assert "step `first` gave other bytes when it was run again" in str(error)


def graph_of(session: Session, source: Path) -> Graph:
    planner = Planner(session)
    ref = planner.source(source)
    edit = planner.add("edit", Edit(path=str(source)), {"in": ref})
    planner.add("after", Mix(), {"in": edit["out"]})
    return planner.graph()


def test_an_edit_during_the_build_is_told_and_the_next_build_is_right(tmp_path, source):
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
