"""Plan, execute, and plan again, until no question is open."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from steps_for_tests import Count, Mix, Split, Write

from assetbuild.engine.planner import Planner, nothing, planned, settle, settle_all
from assetbuild.engine.session import Session
from assetbuild.engine.store import Store


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    path = tmp_path / "robot"
    path.write_text("one 1\ntwo 2\n")
    return path


def a_step_for_each_part(robot: Path):
    """A plan that learns only from a built file which steps follow."""

    def add(p: Planner) -> list[str]:
        split = p.add("split", Split(), {"in": p.source(robot)})
        names = p.ask(split["names.json"])
        parts = json.loads(names) if names else []
        for name in parts:
            p.add(name, Mix(), {"in": split["parts/"] / name})
        return parts

    return add


def test_what_ran_in_an_earlier_round_has_run(session, robot):
    done = settle(a_step_for_each_part(robot), session)
    assert done.whole
    assert done.outline == ["one", "two"]
    assert {label: r.status for label, r in done.results.items()} == {
        "split": "ran",
        "one": "ran",
        "two": "ran",
    }
    again = settle(a_step_for_each_part(robot), session)
    assert {r.status for r in again.results.values()} == {"cached"}


def test_where_nothing_may_run_the_plan_ends_at_its_first_question(session, robot):
    done = settle(a_step_for_each_part(robot), session, may_run=nothing)
    assert (done.whole, done.results, list(done.graph.nodes)) == (False, {}, ["split"])
    settle(a_step_for_each_part(robot), session)
    known = settle(a_step_for_each_part(robot), session, may_run=nothing)
    assert known.whole
    assert {r.status for r in known.results.values()} == {"cached"}


def test_some_steps_may_run(session, robot):
    done = settle(a_step_for_each_part(robot), session, may_run=lambda node: node.label == "split")
    assert list(done.results) == ["split"]
    assert list(done.graph.nodes) == ["split", "one", "two"]


def test_a_failed_step_ends_the_rounds(session):
    def add(p: Planner) -> None:
        p.ask(p.add("bad", Write(write=()))["out"])

    done = settle(add, session)
    assert "did not write its output" in str(done.errors[0])
    assert not done.whole


def test_several_plans_are_one_graph_with_results_under_their_own_labels(tmp_path, robot):
    log = str(tmp_path / "log")

    def add(p: Planner) -> None:
        shared = p.add("shared", Count(log=log, name="shared"), {"in": p.source(robot)})
        p.add("own", Mix(), {"in": shared["out"]})

    builds = {"left": "l.yaml", "right": "r.yaml"}
    with Session(Store(tmp_path / "store"), builds=builds) as session:
        done = settle_all(dict.fromkeys(builds, add), session)
        assert list(done) == ["left", "right"]
        assert [list(each.results) for each in done.values()] == [["shared", "own"]] * 2
        assert (tmp_path / "log").read_text() == "shared\n"
        assert planned(add, session).results == {}


def test_to_keep_going_is_to_finish_the_plans_in_which_nothing_failed(tmp_path, robot):
    def bad(p: Planner) -> list[str]:
        p.ask(p.add("bad", Write(write=()))["out"])
        return []

    plans = {"bad": bad, "good": a_step_for_each_part(robot)}
    builds = {name: f"{name}.yaml" for name in plans}
    with Session(Store(tmp_path / "store"), builds=builds) as session:
        done = settle_all(plans, session, keep_going=True)
        assert done["bad"].errors and not done["bad"].whole
        assert done["good"].whole
        assert set(done["good"].results) == {"split", "one", "two"}
        stopped = settle_all(plans, session)
        assert stopped["bad"].errors
