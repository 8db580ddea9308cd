from __future__ import annotations

import json
import os
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from steps_for_tests import (
    LeavesAChild,
    Misbehave,
    Mix,
    MixInChild,
    Preloaded,
    PreloadedWithThreads,
    Slow,
    Split,
    Write,
    flip,
)

from assetbuild.engine import make
from assetbuild.engine.children import CancelledError
from assetbuild.engine.execute import Event, NodeResult, execute, first_error, restore
from assetbuild.engine.graph import Graph, Planner
from assetbuild.engine.session import Session
from assetbuild.engine.step import Step
from assetbuild.engine.store import LostObjectError, Store
from assetbuild.errors import MachineError, SourceError, StepError, Where


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


def statuses(results: dict[str, NodeResult]) -> list[str]:
    return [result.status for result in results.values()]


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "source.txt"
    path.write_text("1")
    return path


@pytest.mark.parametrize("kind", [Mix, MixInChild])
def test_a_second_build_runs_nothing_and_replays_the_findings(tmp_path, source, kind):
    with Session(Store(tmp_path / "store")) as session:
        first = execute(chain(session, source, kind), session)
    with Session(Store(tmp_path / "store")) as session:
        second = execute(chain(session, source, kind), session)
    assert statuses(first) == ["ran"] * 3
    assert statuses(second) == ["cached"] * 3
    for label, result in first.items():
        assert second[label].findings == result.findings != ()
        assert second[label].outputs == result.outputs
        assert result.child == (kind is MixInChild)
        assert (result.cpu_seconds > 0) == (kind is MixInChild)


def test_a_child_makes_what_this_process_makes(tmp_path, source):
    def build(kind: type[Mix]) -> list[object]:
        with Session(Store(tmp_path / kind.__name__)) as session:
            results = execute(chain(session, source, kind), session)
            return [(r.outputs, r.findings) for r in results.values()]

    assert build(Mix) == build(MixInChild)


def test_equal_bytes_stop_the_change_early(session, source):
    execute(chain(session, source, keep=0), session)
    source.write_text("2")
    session._source_digests.clear()
    assert statuses(execute(chain(session, source, keep=0), session)) == ["ran", "cached", "cached"]


def test_each_step_sees_the_source_as_the_build_first_saw_it(session, source):
    graph = chain(session, source)
    source.write_text("edited after planning")
    error = first_error(execute(graph, session))
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
    assert "did you mean" in str(results["lost"].error)
    source.write_text("a changed\nb/c 2\nb/d 3\n")
    session._source_digests.clear()
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
    result = one(session, Write(write=written))
    assert result.status == "failed"
    assert isinstance(result.error, StepError)
    assert message in str(result.error)
    assert "`it`" in str(result.error)


def test_a_failed_step_is_not_cached(session):
    assert one(session, Write(write=())).status == "failed"
    assert one(session, Write(write=())).status == "failed"


def test_writing_to_an_input_fails_the_step_and_the_store_heals(session, source):
    result = one(session, Misbehave(how="touch_input"), source)
    assert "wrote to its input `in`" in str(result.error)
    assert session.read(session.source_digest(source)) == b"1"


# --- children that go wrong


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ("abort", "crashed with SIGABRT"),
        ("segfault", "crashed with SIGSEGV"),
        ("hang", "ran over its time limit of 1 s"),
        ("exit", "ended without a result (exit status 3)"),
        ("system_exit", "a bug in step `it`: SystemExit"),
        ("memory", "ran over its memory limit of 300 MB"),
        ("big_file", "wrote a file over its limit of 1 MB"),
        ("bug", "a bug in step `it`: KeyError: 'no such thing'"),
    ],
)
def test_a_step_that_goes_wrong_is_named_with_the_reason(session, how, message):
    began = time.monotonic()
    result = one(session, Misbehave(how=how))
    assert time.monotonic() - began < 5
    assert isinstance(result.error, StepError)
    assert message in str(result.error)
    assert "`it`" in str(result.error)
    assert "Traceback" not in str(result.error)


def test_a_crash_loses_one_step_only(session):
    planner = Planner(session)
    for how in ("nothing", "abort", "print", "segfault"):
        planner.add(how, Misbehave(how=how))
    planner.add("other", MixInChild())
    results = execute(planner.graph(), session, keep_going=True, jobs=2)
    failed = {label for label, result in results.items() if result.status == "failed"}
    assert failed == {"abort", "segfault"}


def test_the_class_of_an_error_survives_the_way_to_the_parent(session):
    error = one(session, Misbehave(how="user_error")).error
    assert type(error) is SourceError
    assert error.exit_code == 2
    assert error.where == Where("a.dae", 7, 3)
    assert error.hint == "export it again"


def test_a_missing_package_is_the_machines_lack(session):
    error = one(session, Misbehave(how="missing_package")).error
    assert isinstance(error, MachineError)
    assert "`no_such_package_anywhere`, which is not installed" in str(error)


def test_prints_and_tracebacks_go_to_the_log(session):
    log = one(session, Misbehave(how="print")).log
    assert log is not None
    assert log.read_text().splitlines() == ["native message", "printed by the step"]
    result = one(session, Misbehave(how="bug"))
    assert result.log is not None
    assert "Traceback" in result.log.read_text()
    assert str(result.log) in result.error.hint


def test_a_child_sees_a_bare_environment(session, monkeypatch, tmp_path):
    monkeypatch.setenv("SECRET", "x")
    monkeypatch.chdir(tmp_path)
    result = one(session, Misbehave(how="read_environment"))
    seen = json.loads(session.read(result["out"]))
    assert seen["OMP_NUM_THREADS"] == "1"
    assert (seen["TZ"], seen["LC_ALL"], seen["PYTHONHASHSEED"]) == ("UTC", "C", "0")
    assert seen["SECRET"] is None
    assert seen["HOME"] != os.environ.get("HOME")
    assert seen["home_files"] == []
    assert seen["stdin"] == ""
    assert seen["cwd"] != str(tmp_path)
    assert "" not in seen["path"]
    assert str(tmp_path) not in seen["path"]


def test_modules_are_imported_once_for_many_steps(session):
    planner = Planner(session)
    for salt in range(4):
        planner.add(f"step {salt}", Preloaded(salt=salt))
    results = execute(planner.graph(), session, jobs=2)
    seen = [json.loads(session.read(result["out"])) for result in results.values()]
    assert all(one["loaded"] for one in seen)
    assert len({one["worker"] for one in seen}) == 1


def test_a_module_that_starts_threads_is_not_forked(session):
    result = one(session, PreloadedWithThreads())
    assert json.loads(session.read(result["out"])) == {"loaded": False, "threads": 1}


def test_what_a_step_leaves_running_is_ended(session):
    result = one(session, LeavesAChild())
    pid = int(session.read(result["out"]))
    deadline = time.monotonic() + 2
    while is_alive(pid) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not is_alive(pid)


def test_a_disk_that_fills_up_fails_the_step_not_the_program(session, monkeypatch):
    def full(*args: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(make, "stage", full)
    error = one(session, Mix()).error
    assert isinstance(error, MachineError)
    assert "no space left" in str(error)


def test_a_worker_that_dies_is_replaced(session):
    one(session, Preloaded(salt=1))
    (worker,) = session.children._workers.values()
    worker.process.kill()
    assert one(session, Preloaded(salt=2)).status == "ran"


def test_a_step_that_no_child_can_import_is_refused(session):
    class Local(MixInChild):
        pass

    with pytest.raises(ValueError, match="cannot import"):
        one(session, Local())


# --- scheduling


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
    assert first_error(results) is results["bad"].error


def test_the_first_failure_stops_the_build(session):
    planner = Planner(session)
    planner.add("bad", Write(write=()))
    planner.add("free", Mix())
    results = execute(planner.graph(), session, jobs=1)
    assert results["free"].status == "blocked"
    assert "stopped at the first error" in results["free"].reason


def test_independent_steps_run_side_by_side(session):
    planner = Planner(session)
    for salt in range(4):
        planner.add(str(salt), Slow(salt=salt, seconds=0.5))
    began = time.monotonic()
    execute(planner.graph(), session, jobs=4)
    assert time.monotonic() - began < 1.7


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
    with Session(Store(tmp_path / "store")) as session:
        planner = Planner(session)
        planner.add("slow", Slow(seconds=60, pid_file=str(pid_file)))

        def interrupt(event: Event) -> None:
            if event.kind == "started":
                while not pid_file.is_file() or not pid_file.read_text():
                    time.sleep(0.01)
                raise KeyboardInterrupt

        began = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            execute(planner.graph(), session, on_event=interrupt)
    assert time.monotonic() - began < 3
    assert not is_alive(int(pid_file.read_text()))


def is_alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def test_a_stopped_build_tells_no_step_error(session, monkeypatch):
    monkeypatch.setattr(make.Maker, "make", lambda *_: (_ for _ in ()).throw(CancelledError))
    with pytest.raises(CancelledError):
        one(session, Mix())


# --- faults of the store


@pytest.mark.parametrize("label", ["first", "second", "third"])
@pytest.mark.parametrize("fault", ["flip", "delete"])
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


def test_restore_heals_what_the_store_lost(tmp_path, source):
    with Session(Store(tmp_path / "store")) as session:
        graph = chain(session, source)
        digest = execute(graph, session)["third"]["out"]
        want = session.read(digest)
        flip(session.store.root / "cas" / digest[:2] / digest)
        restore(graph, session, graph.nodes["third"]["out"], tmp_path / "dest")
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
    first = planner.add("first", Mix())
    graph = planner.graph()
    digest = execute(graph, session)["first"]["out"]
    planner.add("second", Mix(), {"in": first["out"]})
    monkeypatch.setattr(Mix, "run", lambda self, files: _write(files.outputs / "out", "new"))
    monkeypatch.setattr(session, "object", _lost_once(session, digest))
    error = execute(planner.graph(), session)["second"].error
    assert "gave other bytes when it was run again" in str(error)


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


def test_a_full_disk_fails_the_step_that_meets_it(session, monkeypatch):
    def full(*args: object, **kwargs: object) -> str:
        raise MachineError("no space left on the disk")

    monkeypatch.setattr(session.store, "put_file", full)
    error = one(session, Mix()).error
    assert isinstance(error, MachineError)


def test_two_builds_at_once_share_a_store(tmp_path, source):
    def build(results: list[object]) -> None:
        with Session(Store(tmp_path / "store")) as session:
            done = execute(chain(session, source, MixInChild), session, jobs=1)
            results.append([r.outputs for r in done.values()])

    found: list[object] = []
    threads = [threading.Thread(target=build, args=(found,)) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 3
    assert found[0] == found[1] == found[2]


def test_the_engine_loads_nothing_heavy():
    program = (
        "import sys, assetbuild.engine.execute, assetbuild.engine.explain, "
        "assetbuild.engine.publish; print(sorted(set(sys.modules) & "
        "{'numpy', 'networkx', 'mujoco', 'pxr', 'trimesh', 'yaml'}))"
    )
    import subprocess

    out = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    assert out.stdout.strip() == b"[]"
