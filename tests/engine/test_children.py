"""Steps in child processes, and how they go wrong."""

from __future__ import annotations

import importlib
import json
import os
import signal
import site
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from builds_for_tests import one, together
from commands import is_alive
from steps_for_tests import (
    DiesOnce,
    Hang,
    Meet,
    Misbehave,
    Mix,
    MixInChild,
    Preloaded,
    PreloadedWithThreads,
    Sharing,
)

from assetbuild.checks.stand import Stand
from assetbuild.engine import children
from assetbuild.engine.children import Children
from assetbuild.engine.processes import Processes
from assetbuild.engine.session import Session
from assetbuild.engine.step import Limits
from assetbuild.engine.store import Store
from assetbuild.engine.wire import error_of_exception
from assetbuild.errors import MachineError, SourceError, StepError, Where
from assetbuild.simulators.mujoco import InMujoco

pytestmark = pytest.mark.own_workers


@pytest.mark.parametrize(
    ("how", "message", "tries"),
    [
        ("abort", "crashed with SIGABRT", 2),
        ("segfault", "crashed with SIGSEGV", 2),
        ("exit", "ended without a result (exit status 3)", 1),
        ("system_exit", "a bug in step `it`: SystemExit", 1),
        ("memory", "ran over its memory limit of 300 MB", 1),
        ("big_file", "wrote a file over its limit of 1 MB", 1),
        ("bug", "a bug in step `it`: KeyError: 'no such thing'", 1),
        ("missing_package", "`no_such_package_anywhere`, which is not installed", 1),
    ],
)
def test_a_step_that_goes_wrong_is_named_with_the_reason_and_only_a_crash_is_tried_again(
    session, monkeypatch, how, message, tries
):
    jobs = []
    run = Children.run
    monkeypatch.setattr(Children, "run", lambda *a: jobs.append(a) or run(*a))
    result = one(session, Misbehave(how=how))
    assert type(result.error) is (MachineError if how == "missing_package" else StepError)
    assert message in str(result.error)
    assert "`it`" in str(result.error)
    assert "Traceback" not in str(result.error)
    assert len(jobs) == tries


def test_a_step_that_hangs_is_stopped_though_it_ignores_signals(session):
    began = time.monotonic()
    error = one(session, Hang()).error
    assert "`it` ran over its time limit of 1 s and was stopped" in str(error)
    assert time.monotonic() - began < 15


def test_the_class_of_an_error_survives_the_way_to_the_parent(session):
    error = one(session, Misbehave(how="user_error")).error
    assert type(error) is SourceError
    assert error.exit_code == 2
    assert error.where == Where("a.dae", 7, 3)
    assert error.hint == "export it again"


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
    assert seen.pop("HOME") != os.environ.get("HOME")
    assert seen.pop("cwd") != str(tmp_path)
    assert not {"", str(tmp_path)} & set(seen.pop("path"))
    assert seen == {
        "OMP_NUM_THREADS": "1", "TZ": "UTC", "LC_ALL": "C", "PYTHONHASHSEED": "0", "SECRET": None,
        "home_files": [], "stdin": "",
    }  # fmt: skip


def test_modules_are_imported_once_for_many_steps(session):
    results = together(session, {str(salt): Preloaded(salt=salt) for salt in range(4)}, jobs=2)
    seen = [json.loads(session.read(result["out"])) for result in results.values()]
    assert all(one["loaded"] for one in seen)
    assert len({one["worker"] for one in seen}) == 1


def test_a_process_that_began_before_the_build_forks_its_workers(session, tmp_path):
    for _ in range(2):
        children.begin()
    origin = children._EARLY[0].origin
    assert one(session, MixInChild()).error is None
    assert not children._EARLY
    assert origin.dead, "it ends with the build"


def test_workers_that_are_kept_serve_the_next_build(tmp_path):
    children.begin(keep=True)
    seen = []
    for number in range(2):
        with Session(Store(tmp_path / str(number))) as session:
            assert one(session, Misbehave(how="segfault")).error is not None
            result = one(session, Preloaded(salt=number))
            seen.append(json.loads(session.read(result["out"]))["worker"])
    assert seen[0] == seen[1]
    assert is_alive(seen[0])
    assert len(children._EARLY) == 1, "though a failed build is closed twice"
    children._EARLY[:] = [replace(children._EARLY[0], keep=False)]
    with Session(Store(tmp_path / "last")) as session:
        assert one(session, MixInChild()).error is None
    assert not is_alive(seen[0]), "they end with the last one"
    assert not children._EARLY


def test_a_module_that_starts_threads_is_not_forked(session):
    result = one(session, PreloadedWithThreads())
    seen = json.loads(session.read(result["out"]))
    assert (seen["loaded"], seen["threads"]) == (False, 1)


def test_what_a_step_leaves_running_is_ended(session):
    result = one(session, Misbehave(how="leave_a_child"))
    pid = int(session.read(result["out"]))
    deadline = time.monotonic() + 2
    while is_alive(pid) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not is_alive(pid)


def who(session, result):
    """What a `Sharing` step says of itself."""
    assert result.error is None
    return json.loads(session.read(result["out"]))


def test_steps_that_share_a_process_notice_nothing_of_each_other(session):
    hows = ("burn", "say_who", "say_who")
    steps = {str(n): Sharing(how=how, salt=n) for n, how in enumerate(hows)}
    results = together(session, steps, jobs=1)
    seen = [who(session, result) for result in results.values()]
    assert len({each["pid"] for each in seen}) == 1
    for what in ("inputs", "cwd", "tmp"):
        assert len({each[what] for each in seen}) == 3, what
    assert [each["files"] for each in seen] == [[]] * 3
    spent = [results[name].cpu_seconds for name in steps]
    assert spent[0] > 0.3
    assert max(spent[1:]) < 0.2, "of each step alone"


@pytest.mark.parametrize(
    "how", ["bug", "user_error", "exit", "leave_a_child", "leave_a_thread", "need_much"]
)
def test_a_process_that_is_not_as_new_takes_no_further_step(session, how):
    with Processes(session) as runner:
        first = who(session, one(session, Sharing(how="say_who"), runner=runner))
        result = one(session, Sharing(how=how), runner=runner)
        assert (result.error is None) == how.startswith(("leave", "need"))
        last = who(session, one(session, Sharing(how="say_who", salt=1), runner=runner))
    assert first["pid"] != last["pid"]


@pytest.mark.parametrize(
    ("how", "message"),
    [("hang", "ran over its time limit of 5 s"), ("memory", "over its memory limit of 300 MB")],
)
def test_each_step_of_a_process_has_all_of_its_limits(session, how, message):
    with Processes(session) as runner:
        for salt in range(2):
            assert one(session, Sharing(how="say_who", salt=salt), runner=runner).error is None
        assert message in str(one(session, Sharing(how=how), runner=runner).error)


def test_a_plug_in_does_not_inherit_from_us_that_its_steps_share_a_process():
    class Foreign(InMujoco):
        pass

    assert Foreign.shares
    assert not Foreign.may_share()
    assert Stand.may_share()
    assert Sharing.may_share()


def test_a_process_that_dies_while_it_waits_costs_a_try(session):
    with Processes(session) as runner:
        first = who(session, one(session, Sharing(how="say_who"), runner=runner))
        os.kill(first["pid"], signal.SIGKILL)
        last = who(session, one(session, Sharing(how="say_who", salt=1), runner=runner))
    assert first["pid"] != last["pid"]


def test_a_worker_that_dies_is_replaced(session):
    with Processes(session) as runner:
        one(session, Preloaded(salt=1), runner=runner)
        (worker,) = runner._children._workers.values()
        os.kill(worker.pid, signal.SIGKILL)
        assert one(session, Preloaded(salt=2), runner=runner).status == "ran"


def test_a_step_that_no_child_can_import_is_refused(session):
    class Local(MixInChild):
        pass

    with pytest.raises(ValueError, match="cannot import"):
        one(session, Local())


@pytest.mark.parametrize("number", ["SIGKILL", "SIGSEGV"])
def test_a_child_killed_once_is_run_again_in_clean_folders(session, tmp_path, number):
    result = one(session, DiesOnce(flag=str(tmp_path / "flag"), signal_name=number))
    assert result.status == "ran"
    assert "run again after a crash" in result.reason
    assert session.read(result["out"]) == b"alive"


STEP = """
from assetbuild.engine.step import Step

class Behind(Step):
    outputs = ("out",)

    def run(self, files):
        (files.outputs / "out").write_text("found")
"""
HOOK = """
import importlib.util, sys

class Finder:
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        if name == "behind_a_hook":
            return importlib.util.spec_from_file_location(name, {file!r})

def install():
    sys.meta_path.append(Finder)
"""


def test_a_child_has_the_import_hooks_of_the_user_s_own_site_folder(session, tmp_path, monkeypatch):
    """`pip install --user -e` leaves such a hook; a child with `-s` and another HOME skips it."""
    module, folder = tmp_path / "project/behind_a_hook.py", tmp_path / "site-packages"
    module.parent.mkdir()
    folder.mkdir()
    module.write_text(STEP)
    (folder / "a_hook.py").write_text(HOOK.format(file=str(module)))
    (folder / "a_hook.pth").write_text("import a_hook; a_hook.install()\n")
    monkeypatch.setattr(site, "ENABLE_USER_SITE", True)
    monkeypatch.setattr(site, "USER_SITE", str(folder))
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(sys, "meta_path", list(sys.meta_path))
    site.addsitedir(str(folder))
    assert not any(Path(entry) == module.parent for entry in sys.path)
    step = importlib.import_module("behind_a_hook").Behind()
    try:
        result = one(session, step)
    finally:
        for name in ("behind_a_hook", "a_hook"):
            del sys.modules[name]
    assert result.error is None
    assert session.read(result["out"]) == b"found"


@pytest.mark.parametrize(
    ("memory_mb", "patience_s", "met"), [(6000, 300.0, [b"2", b"2"]), (5999, 0.5, [b"1", b"2"])]
)
def test_declared_memory_bounds_what_runs_at_once(
    session, tmp_path, monkeypatch, memory_mb, patience_s, met
):
    place = tmp_path / "place"
    place.mkdir()
    meeting = {"company": 2, "folder": str(place), "patience_s": patience_s}
    steps = {"0": Meet(number=0, **meeting), "1": Meet(number=1, **meeting), "small": Mix()}
    monkeypatch.setattr(Processes, "memory_mb", memory_mb)
    results = together(session, steps, jobs=3)
    assert sorted(session.read(results[label]["out"]) for label in "01") == met


def test_a_library_without_memory_is_no_bug_of_the_step():
    error = error_of_exception(RuntimeError("Could not allocate memory"), "x", Limits(memory_mb=9))
    assert str(error).startswith("step `x` ran over its memory limit of 9 MB")
