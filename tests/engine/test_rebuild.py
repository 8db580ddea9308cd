"""Every step run twice and compared; several graphs built as one."""

from __future__ import annotations

from pathlib import Path

import pytest
from builds_for_tests import chain
from steps_for_tests import Count, Irreproducible, Mix, MixInChild, MixInParent, Split

from assetbuild.engine.execute import execute
from assetbuild.engine.explain import explain
from assetbuild.engine.graph import Graph, joined
from assetbuild.engine.planner import Planner
from assetbuild.engine.processes import Processes
from assetbuild.engine.rebuild import run_again
from assetbuild.engine.session import Session
from assetbuild.engine.store import Store


def again(graph: Graph, session: Session, results, keep: Path, **options):
    with Processes(session) as runner:
        return run_again(graph, session, results, runner, keep, **options)


@pytest.mark.parametrize("kind", [MixInParent, MixInChild])
def test_steps_that_give_the_same_bytes_pass(session, tmp_path, source, kind):
    graph = chain(session, source, kind)
    results = execute(graph, session)
    assert again(graph, session, results, tmp_path / "keep") == ()
    assert not (tmp_path / "keep").exists()


def test_every_step_runs_a_second_time_on_the_inputs_of_the_first(session, tmp_path, source):
    log = tmp_path / "log"
    planner = Planner(session)
    split = planner.add("split", Split(), {"in": planner.source(source)})
    a = planner.add("a", Count(log=str(log), name="a"), {"in": split["names.json"]})
    planner.add("b", Count(log=str(log), name="b"), {"in": a["out"]})
    planner.add("tree", Mix(), {"t/": split["parts/"]})
    graph = planner.graph()
    results = execute(graph, session)
    assert again(graph, session, results, tmp_path / "keep", jobs=1) == ()
    ran = log.read_text().split()
    assert ran[:2] == ["a", "b"]
    assert sorted(ran[2:]) == ["a", "b"], "in any order: no step waits for another one's second run"


def test_the_step_and_the_file_that_differ_are_named_and_none_after_it(session, tmp_path):
    planner = Planner(session)
    bad = planner.add("bad", Irreproducible())
    planner.add("reader", Mix(), {"t/": bad["parts/"]})
    graph = planner.graph()
    results = execute(graph, session)
    before = session.store.action(results["bad"].key)
    (found,) = again(graph, session, results, tmp_path / "keep")
    assert (found.label, found.file) == ("bad", "parts/clock")
    assert "step `bad`: `parts/clock` differs" in str(found)
    versions = [tmp_path / "keep/bad" / n / "parts/clock" for n in ("first", "second")]
    assert len({path.read_text() for path in versions}) == 2
    assert session.store.action(results["bad"].key) == before  # the store keeps the first


def two(session: Session, tmp_path: Path, source: Path) -> dict[str, Graph]:
    """Two graphs that share their first step."""
    graphs = {}
    for name in ("left", "right"):
        planner = Planner(session)
        step = Count(log=str(tmp_path / "log"), name="shared", seconds=0.05)
        shared = planner.add("shared", step, {"in": planner.source(source)})
        planner.add("own", Mix(salt=len(name)), {"in": shared["out"]})
        graphs[name] = planner.graph()
    return graphs


def test_shared_steps_of_joined_graphs_run_once(tmp_path: Path, source: Path):
    builds = {"left": "l.yaml", "right": "r.yaml"}
    with Session(Store(tmp_path / "store"), builds=builds) as session:
        graph = joined(two(session, tmp_path, source))
        assert list(graph.nodes) == ["left:shared", "left:own", "right:shared", "right:own"]
        results = execute(graph, session, jobs=2)
    assert [r.status for r in results.values()].count("ran") == 3
    assert (tmp_path / "log").read_text() == "shared\n"


def test_each_of_the_joined_builds_has_its_own_journal(tmp_path: Path, source: Path):
    builds = {"left": "l.yaml", "right": "r.yaml"}
    with Session(Store(tmp_path / "store"), builds=builds) as session:
        execute(joined(two(session, tmp_path, source)), session, jobs=1)
    source.write_text("2")
    for name, build in builds.items():
        with Session(Store(tmp_path / "store"), build=build) as session:
            told = explain(two(session, tmp_path, source)[name], session, "shared")
            assert "input in changed" in told.to_text()
