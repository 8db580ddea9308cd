"""The graph of steps: labels, outputs, order, and what a plan may not ask for."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from steps_for_tests import Count, Mix, Split, Write

from assetbuild.cli.plan import to_dot, to_json, to_text
from assetbuild.engine.execute import execute
from assetbuild.engine.graph import GraphError, Node, Ref
from assetbuild.engine.planner import Planner, nothing, planned, settle, settle_all
from assetbuild.engine.session import Session
from assetbuild.engine.store import Store
from assetbuild.errors import SourceError, StepError


@pytest.fixture
def planner(session):
    return Planner(session)


class WithSet(Mix):
    links: frozenset[str] = frozenset({"trunk"})


def split_of(planner: Planner) -> Node:
    return planner.add("split", Split(), {"in": planner.add("mix", Mix())["out"]})


def reads(*names: str) -> Callable[[Planner], object]:
    """A step that reads one output under these names."""
    return lambda p: p.add("n", Mix(), dict.fromkeys(names, p.add("mix", Mix())["out"]))


WRONG: dict[str, tuple[Callable[[Planner], object], str]] = {
    "a label twice": (
        lambda p: (p.add("a", Mix()), p.add("a", Mix())),
        "two steps are labelled `a`",
    ),
    "an unknown output": (lambda p: split_of(p)["part/"], r"no output `part/`.*mean `parts/`"),
    "an unknown output of a reference": (
        lambda p: p.add("b", Mix(), {"x": Ref(p.add("a", Mix()).label, "nothing")}),
        "no output `nothing`",
    ),
    "an unknown step": (
        lambda p: (p.add("read_urdf", Mix()), p.add("b", Mix(), {"x": Ref("read_urd", "out")})),
        "did you mean `read_urdf`",
    ),
    "an input above": (reads("../x"), r"`\.\./x` is no name"),
    "an absolute input": (reads("/x"), "`/x` is no name"),
    "an input below another": (reads("a", "a/b"), "inside another input"),
    "an input without a name": (reads(""), "is no name for an input"),
    "a file as a folder": (reads("x/"), "is a file"),
    "a folder as a file": (lambda p: p.add("n", Mix(), {"x": split_of(p)["parts/"]}), "a folder"),
    "a member of a file": (lambda p: split_of(p)["names.json"] / "x", "a file"),
    "a member above": (lambda p: split_of(p)["parts/"] / "../x", "not a plain relative path"),
    "a field without an order": (lambda p: p.add("a", WithSet()), "has a set in its fields"),
}


@pytest.mark.parametrize("mistake", WRONG)
def test_what_a_plan_may_not_ask_for_is_refused(planner, mistake):
    plan, message = WRONG[mistake]
    with pytest.raises(GraphError, match=message):
        plan(planner)


def test_a_missing_source_is_the_users_error(planner, tmp_path):
    with pytest.raises(SourceError, match=r"cannot read .*gone\.urdf"):
        planner.source(tmp_path / "gone.urdf")


def test_a_graph_is_ordered_and_drawn(planner, tmp_path):
    (tmp_path / "go1.urdf").write_text("x")
    first = planner.add("first", Mix(), {"in": planner.source(tmp_path / "go1.urdf")})
    planner.add("second", Mix(), {"in": first["out"]})
    graph = planner.graph()
    assert list(graph.nodes) == ["first", "second"]
    assert graph.predecessors("second") == ("first",)
    assert '"go1.urdf" -> "first" [label="in"];' in to_dot(graph)
    assert to_text(graph).splitlines()[1:] == ["  first", "  second"]
    assert [row["label"] for row in json.loads(to_json(graph))["nodes"]] == ["first", "second"]


def test_a_question_is_open_until_the_file_is_built(session, tmp_path):
    (tmp_path / "in").write_text("a 1\nb/c 2\nb/d 3\n")

    def plan() -> Planner:
        p = Planner(session)
        split = p.add("split", Split(), {"in": p.source(tmp_path / "in")})
        p.ask(split["parts/"] / "b/c")
        p.ask(split["names.json"])
        return p

    first = plan()
    assert [str(q) for q in first.questions] == ["split:parts/b/c", "split:names.json"]
    execute(first.graph(), session)
    second = plan()
    assert second.questions == []
    split = second.graph().nodes["split"]
    assert second.ask(split["parts/"] / "b/c") == b"2"
    assert json.loads(second.ask(split["names.json"])) == ["a", "b/c", "b/d"]
    with pytest.raises(StepError, match=r"step `split` has no `b/x` in `parts/`"):
        second.ask(split["parts/"] / "b/x")


def test_a_source_can_be_asked_at_once(planner, tmp_path):
    (tmp_path / "in").write_text("text")
    assert planner.ask(planner.source(tmp_path / "in")) == b"text"


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


def test_several_plans_are_one_graph_with_results_under_their_own_labels(tmp_path, robot):
    log = str(tmp_path / "log")

    def add(p: Planner) -> None:
        shared = p.add("shared", Count(log=log, name="shared"), {"in": p.source(robot)})
        p.add("own", Mix(), {"in": shared["out"]})

    builds = {"left": "l.yaml", "right": "r.yaml"}
    with Session(Store(tmp_path / "store"), builds=builds) as session:
        done = settle_all(dict.fromkeys(builds, add), session)
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
