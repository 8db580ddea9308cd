"""What the store lost is made again; full disks; several builds at once."""

from __future__ import annotations

from pathlib import Path

import pytest
from builds_for_tests import chain
from steps_for_tests import (
    Edit,
    Mix,
    MixInParent,
    flip,
)

from assetbuild.engine.execute import execute
from assetbuild.engine.graph import Graph
from assetbuild.engine.planner import Planner
from assetbuild.engine.session import Session
from assetbuild.engine.store import LostObjectError, Store
from assetbuild.errors import SourceError


@pytest.mark.parametrize(("label", "fault"), [("first", "flip"), ("third", "delete")])
def test_a_lost_object_is_made_again_when_it_is_needed(tmp_path, source, label, fault):
    with Session(Store(tmp_path / "store")) as session:
        graph = chain(session, source)
        gold = execute(graph, session)
        want = session.read(gold["third"]["out"])
    with Session(Store(tmp_path / "store")) as session:
        digest = gold[label]["out"]
        path = session.store.root / "cas" / digest[:2] / digest
        flip(path) if fault == "flip" else path.unlink()
        planner = Planner(session)
        first = planner.add("first", Mix(), {"in": planner.source(source)})
        second = planner.add("second", Mix(salt=1), {"in": first["out"]})
        third = planner.add("third", Mix(salt=2), {"in": second["out"]})
        planner.add("new", Mix(salt=9), {"a": first["out"], "b": second["out"], "c": third["out"]})
        results = execute(planner.graph(), session)
        assert results[label].status == "ran"
        assert results["new"].status == "ran"
        assert "missing or corrupt" in results[label].reason
        assert session.read(results["third"]["out"]) == want


def test_everything_is_made_again_when_the_store_lost_all_of_it(tmp_path, source):
    def plan(session: Session, length: int) -> Graph:
        planner = Planner(session)
        last = planner.add("0", Mix(), {"in": planner.source(source)})
        for number in range(1, length):
            last = planner.add(str(number), Mix(salt=number), {"in": last["out"]})
        return planner.graph()

    with Session(Store(tmp_path / "store")) as session:
        gold = execute(plan(session, 7), session)
        want = session.read(gold["6"]["out"])
    for path in (tmp_path / "store").glob("v1/cas/*/*"):
        flip(path)
    with Session(Store(tmp_path / "store")) as session:
        results = execute(plan(session, 8), session, jobs=3)
        assert [r.status for r in results.values()] == ["ran"] * 8
        assert session.read(results["6"]["out"]) == want


def test_what_was_lost_when_it_is_restored_is_made_again_by_the_next_execution(tmp_path, source):
    with Session(Store(tmp_path / "store")) as session:
        graph = chain(session, source)
        digest = execute(graph, session)["third"]["out"]
        want = session.read(digest)
        flip(session.store.root / "cas" / digest[:2] / digest)
        with pytest.raises(LostObjectError):
            session.store.restore(digest, tmp_path / "dest")
        session.forget()
        execute(graph, session)
        session.store.restore(digest, tmp_path / "dest")
    assert (tmp_path / "dest").read_bytes() == want


def test_a_question_about_a_lost_object_is_open_again(session, source):
    graph = chain(session, source)
    digest = execute(graph, session)["third"]["out"]
    flip(session.store.root / "cas" / digest[:2] / digest)
    planner = Planner(session)
    first = planner.add("first", Mix(), {"in": planner.source(source)})
    second = planner.add("second", Mix(salt=1), {"in": first["out"]})
    third = planner.add("third", Mix(salt=2), {"in": second["out"]})
    assert planner.ask(third["out"]) is None
    execute(planner.graph(), session)
    assert planner.ask(third["out"]) is not None


def test_a_step_that_gives_other_bytes_each_time_is_told_on(tmp_path, session, monkeypatch):
    """The store loses an output, and making it again gives other bytes."""
    planner = Planner(session)
    first = planner.add("first", MixInParent())
    graph = planner.graph()
    digest = execute(graph, session)["first"]["out"]
    planner.add("second", Mix(), {"in": first["out"]})
    monkeypatch.setattr(
        MixInParent, "run", lambda self, files: _write(files.outputs / "out", "new")
    )
    monkeypatch.setattr(session, "object", _lost_once(session, digest))
    error = execute(planner.graph(), session)["first"].error
    assert "step `first` gave other bytes when it was run again" in str(error)


def _write(path: Path, text: str) -> tuple[()]:
    path.write_text(text)
    return ()


def _lost_once(session: Session, digest: str):
    real = session.object

    def lost(wanted: str) -> Path:
        if wanted == digest:
            path = session.store.root / "cas" / digest[:2] / digest
            path.unlink(missing_ok=True)
            raise LostObjectError(digest, "gone")
        return real(wanted)

    return lost


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
