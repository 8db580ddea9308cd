"""Outputs, scheduling, progress."""

from __future__ import annotations

import itertools
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from builds_for_tests import chain, one, together
from commands import is_alive
from steps_for_tests import (
    Misbehave,
    Mix,
    MixInChild,
    MixInParent,
    PassOn,
    Slow,
    Split,
    Write,
)

from assetbuild.engine import make
from assetbuild.engine.actions import Action, Made
from assetbuild.engine.children import CancelledError
from assetbuild.engine.execute import Event, execute
from assetbuild.engine.make import NodeResult
from assetbuild.engine.planner import Planner
from assetbuild.engine.processes import Processes, check_untouched, stage
from assetbuild.engine.session import Session
from assetbuild.engine.step import Step
from assetbuild.engine.store import Store
from assetbuild.errors import SourceError, StepError


def statuses(results: dict[str, NodeResult]) -> list[str]:
    return [result.status for result in results.values()]


def test_a_child_makes_what_this_process_makes_and_a_second_build_replays_it(tmp_path, source):
    made = []
    for kind, status in itertools.product((MixInParent, MixInChild), ("ran", "cached")):
        with Session(Store(tmp_path / kind.__name__)) as session:
            results = execute(chain(session, source, kind), session)
        assert statuses(results) == [status] * 3
        made.append([(result.outputs, result.findings) for result in results.values()])
        in_child = kind is MixInChild and status == "ran"
        assert all((result.cpu_seconds > 0) == in_child for result in results.values())
    assert all(findings for _, findings in made[0])
    assert made == made[:1] * 4


def test_equal_bytes_stop_the_change_early(session, source):
    execute(chain(session, source, keep=0), session)
    source.write_text("2")
    session.world.record.clear()
    assert statuses(execute(chain(session, source, keep=0), session)) == ["ran", "cached", "cached"]


def test_each_step_sees_the_source_as_the_build_first_saw_it(session, source):
    graph = chain(session, source)
    source.write_text("edited after planning")
    error = next(r.error for r in execute(graph, session).values() if r.error)
    assert isinstance(error, SourceError)
    assert "was edited during the build" in str(error)


def test_an_input_may_be_one_file_or_folder_of_a_tree(session, source):
    source.write_text("a 1\nb/c 2\nb/d 3\n")
    planner = Planner(session)
    split = planner.add("split", Split(), {"in": planner.source(source)})
    planner.add("file", Mix(), {"x": split["parts/"] / "b/c"})
    planner.add("folder", Mix(), {"y/": split["parts/"] / "b/"})
    planner.add("lost", Mix(), {"z": split["parts/"] / "b/e"})
    results = execute(planner.graph(), session, keep_going=True)
    assert statuses(results).count("ran") == 3
    assert "has no `b/e` in `parts/`" in str(results["lost"].error)
    assert "known: `a`, `b/c`, `b/d`" in str(results["lost"].error)
    source.write_text("a changed\nb/c 2\nb/d 3\n")
    session.world.record.clear()
    again = execute(planner.graph(), session, keep_going=True)
    assert {k: r.status for k, r in again.items() if k != "lost"} == {
        "split": "ran",
        "file": "cached",
        "folder": "cached",
    }


# --- outputs


@pytest.mark.parametrize(
    ("written", "message"),
    [
        (("out", "more"), "wrote what it does not declare: `more`"),
        (("out", "sub/deep"), "wrote what it does not declare: `sub/deep`"),
        ((), "did not write its output `out`"),
        (("out/file",), "wrote what it does not declare: `out/file`"),
    ],
)
def test_outputs_are_those_declared(session, written, message):
    for _ in range(2):  # a failure is not cached
        result = one(session, Write(write=written))
        assert result.status == "failed"
        assert isinstance(result.error, StepError)
        assert message in str(result.error)
        assert "`it`" in str(result.error)


def test_a_link_to_an_input_is_an_output_that_holds_the_same(session, source):
    source.write_text("a 1\nb/c 2\n")
    planner = Planner(session)
    split = planner.add("split", Split(), {"in": planner.source(source)})
    inputs = {name: split[name] for name in Split.outputs}
    passed = planner.add("pass on", PassOn(), inputs)
    mixes = {"linked": passed["out/"] / "deep/parts/", "whole": passed["out/"]}
    for label, ref in {"split's": split["parts/"], **mixes}.items():
        planner.add(label, Mix(), {"x/": ref})
    results = execute(planner.graph(), session)
    assert results["pass on"]["same"] == results["split"]["names.json"]
    assert results["linked"]["out"] == results["split's"]["out"]
    named = {f"parts/{name}": split["parts/"] / name for name in ("a", "b/c")}
    planner.add("named", PassOn(), {"names.json": split["names.json"]} | named)
    again = execute(planner.graph(), session)
    assert again["named"].outputs == results["pass on"].outputs, "a folder of files, one by one"
    listing = session.tree(results["pass on"]["out/"])
    assert set(listing) == {"own", "deep/parts/a", "deep/parts/b/c"}
    assert (session.view(results["pass on"]["out/"]) / "deep/parts").is_symlink(), (
        "one view of both"
    )

    planner.add("elsewhere", PassOn(place="/etc"), inputs)
    error = execute(planner.graph(), session, keep_going=True)["elsewhere"].error
    assert "output `out/deep/parts` is not a regular file" in str(error)


def test_writing_to_an_input_fails_the_step_and_the_store_heals(session, source):
    result = one(session, Misbehave(how="touch_input"), source)
    assert "wrote to its input `in`" in str(result.error)
    assert session.read(session.world.digest(source)) == b"1"


@pytest.mark.parametrize("long_lived", [False, True])
def test_a_file_put_into_a_folder_that_others_read_reaches_none_of_them(
    session, source, long_lived
):
    source.write_text("one 1\nsub/two 2\n")
    planner = Planner(session)
    split = planner.add("split", Split(), {"in": planner.source(source)})
    planner.add("bad", Misbehave(how="add_to_folder"), {"parts/": split["parts/"]})
    planner.add("good", Mix(), {"parts/": split["parts/"], "again/": split["parts/"]})
    with Processes(session, long_lived=long_lived) as runner:
        results = execute(planner.graph(), session, runner, keep_going=True, jobs=1)
        left = [path for path in session.store.root.rglob("more") if path.is_file()]
    assert "wrote to its input `parts/`" in str(results["bad"].error)
    assert results["good"].error is None
    assert bool(left) != long_lived  # nothing of a step stays where processes run for long


# --- scheduling


class Told(Write):
    """Reads a file of the user's: all broken ones are to be named."""

    all_told = True


def test_a_failure_stops_all_but_those_of_a_kind_that_names_every_file(session):
    steps = {"first": Told(write=()), "other": Mix(), "second": Told(write=("more",))}
    results = together(session, {**steps, "good": Told(write=("out",))}, jobs=1)
    assert statuses(results) == ["failed", "blocked", "failed", "ran"]
    assert "stopped at the first error" in results["other"].reason


def test_nodes_after_a_failure_are_blocked_and_the_others_go_on(session):
    planner = Planner(session)
    bad = planner.add("bad", Write(write=()))
    after = planner.add("after", Mix(), {"in": bad["out"]})
    planner.add("last", Mix(), {"in": after["out"]})
    planner.add("free", Mix(salt=3))
    results = execute(planner.graph(), session, keep_going=True, jobs=1)
    assert {k: r.status for k, r in results.items()} == {
        "bad": "failed",
        "after": "blocked",
        "last": "blocked",
        "free": "ran",
    }
    assert results["last"].reason == "`bad` failed"


class Long(Mix):
    """As `Mix`, and said to take long."""

    in_parent = True
    usual_s = 60.0


def test_what_takes_longest_with_all_that_waits_for_it_starts_first(session):
    planner = Planner(session)
    planner.add("short", Mix(salt=1))
    first = planner.add("first of a chain", Mix(salt=2))
    planner.add("long", Long(salt=3), {"in": first["out"]})
    planner.add("alone", Long(salt=4))
    begun: list[str] = []

    def note(event: Event) -> None:
        if event.kind == "started":
            begun.append(event.label)

    execute(planner.graph(), session, jobs=1, on_event=note)
    assert (begun[0], begun[-1]) == ("first of a chain", "short")


def test_progress_is_told_in_order(session, source):
    told: list[Event] = []
    graph = chain(session, source)
    main = threading.current_thread()

    def listen(event: Event) -> None:
        assert threading.current_thread() is main
        told.append(event)

    execute(graph, session, on_event=listen)
    assert [(e.kind, e.label) for e in told] == [
        ("planned", ""),
        ("started", "first"),
        ("finished", "first"),
        ("started", "second"),
        ("finished", "second"),
        ("started", "third"),
        ("finished", "third"),
    ]
    assert [e.done for e in told if e.kind == "finished"] == [1, 2, 3]
    assert {e.total for e in told} == {3}
    told.clear()
    execute(graph, session, on_event=listen)
    assert [e.kind for e in told] == ["planned", "finished", "finished", "finished"]


def test_ctrl_c_kills_the_children_in_two_seconds(tmp_path):
    pid_file = tmp_path / "pid"
    interrupted: list[float] = []

    def interrupt(event: Event) -> None:
        if event.kind == "started":
            while not pid_file.is_file() or not pid_file.read_text():
                time.sleep(0.01)
            interrupted.append(time.monotonic())
            raise KeyboardInterrupt

    slow = Slow(seconds=60, pid_file=str(pid_file))
    with Session(Store(tmp_path / "store")) as session, pytest.raises(KeyboardInterrupt):
        one(session, slow, on_event=interrupt)
    while is_alive(int(pid_file.read_text())):  # killed, perhaps not yet gone
        assert time.monotonic() - interrupted[0] < 3
        time.sleep(0.02)
    assert time.monotonic() - interrupted[0] < 3


def test_a_stopped_build_tells_no_step_error(session, monkeypatch):
    monkeypatch.setattr(make.Maker, "make", lambda *_: (_ for _ in ()).throw(CancelledError))
    with pytest.raises(CancelledError):
        one(session, Mix())


class Elsewhere(Processes):
    """Makes every output without running the step."""

    places = 2
    memory_mb = 1024

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self.session = session
        self.seen: list[Action] = []
        self.prepared: list[Step] = []

    def prepare(self, step: Step) -> None:
        self.prepared.append(step)

    def run(self, action: Action) -> Made:
        self.seen.append(action)
        digest = self.session.store.put_bytes(action.label.encode())
        return Made(dict.fromkeys(action.step.outputs, digest))


def test_whatever_runs_actions_is_a_runner(session: Session, source: Path):
    with Elsewhere(session) as runner:
        results = execute(chain(session, source), session, runner)
    assert [action.label for action in runner.seen] == ["first", "second", "third"]
    assert runner.seen[1].inputs == {"in": results["first"]["out"]}
    assert session.read(results["third"]["out"]) == b"third"
    assert runner.closed
    assert len(runner.prepared) == 2, "each reader, while the step before it runs"


def test_steps_that_read_one_folder_at_once_share_its_view(session):
    digest = session.store.put_listing(
        {f"f{n}": (session.store.put_bytes(b"x"), 1) for n in range(300)}
    )
    with ThreadPoolExecutor(8) as threads:
        views = set(threads.map(lambda _: session.view(digest), range(8)))
    assert len(views) == 1
    assert len(list(views.pop().iterdir())) == 300


def test_what_another_step_made_again_is_no_step_that_wrote_to_its_input(session, tmp_path):
    data = b"what two steps make"
    staged = stage(session, {"in": session.store.put_bytes(data)}, tmp_path)
    time.sleep(0.02)  # another stamp
    session.store.put_bytes(data)
    session.forget = None  # nothing was lost
    check_untouched(session, staged, "it")
