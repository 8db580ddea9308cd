"""The store counted, verified and held below a size, also while builds run on it."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path

import pytest
from builds_for_tests import SIZE, calling, chain, count_all, object_file, one
from steps_for_tests import Count, Mix, Split, flip

from assetbuild.engine.execute import execute
from assetbuild.engine.housekeeping import check, collect, stats
from assetbuild.engine.planner import Planner
from assetbuild.engine.session import Session
from assetbuild.engine.store import Store, open_store


def build(root: Path, log: Path, names: str) -> dict[str, str]:
    with Session(Store(root), build=names) as session:
        return count_all(session, log, names)


def gc(root: Path, max_bytes: int) -> int:
    store = Store(root)
    done = collect(store, max_bytes)
    store.close()
    return done.after


def age(root: Path) -> None:
    """Nothing was used within the tick of the clock that `collect` spares."""
    time.sleep(0.1)


def test_stats_count(tmp_path: Path):
    build(tmp_path / "store", tmp_path / "log", "abc")
    found = stats(tmp_path / "store")
    assert (found.objects, found.object_bytes, found.actions) == (3, 3 * SIZE, 3)
    assert found.live_builds == 0
    with Session(Store(tmp_path / "store")):
        assert stats(tmp_path / "store").live_builds == 1


def test_what_was_used_least_lately_goes_first(tmp_path: Path):
    root, log = tmp_path / "store", tmp_path / "log"
    for names in ("a", "b", "c", "a"):  # a is used again last
        build(root, log, names)
        age(root)
    gc(root, int(2.9 * SIZE))
    assert stats(root).total_bytes <= 2.9 * SIZE
    assert build(root, log, "ac") == {"a": "cached", "c": "cached"}
    assert build(root, log, "b") == {"b": "ran"}


@pytest.mark.parametrize("limit", [0, 3 * SIZE])
def test_the_store_is_below_the_limit_afterwards_and_still_right(tmp_path: Path, limit: int):
    root, log = tmp_path / "store", tmp_path / "log"
    build(root, log, "abcdef")
    age(root)
    assert gc(root, limit) == stats(root).total_bytes
    assert stats(root).total_bytes <= max(limit, 2000)  # the stat cache of sources stays
    store = Store(root)
    assert not check(store).corrupt
    assert check(store).incomplete == 0
    store.close()
    build(root, log, "abcdef")


def test_folders_stay_whole_or_go_whole(tmp_path: Path):
    source = tmp_path / "source"
    source.write_text("".join(f"part{i} {i}\n" for i in range(20)))
    for limit in (10**6, 1200, 300):
        with Session(Store(tmp_path / "store")) as session:
            assert one(session, Split(), source).error is None
        age(tmp_path)
        gc(tmp_path / "store", limit)
        store = Store(tmp_path / "store")
        assert check(store).incomplete == 0
        store.close()


def test_check_sets_corrupt_objects_aside_and_the_next_build_makes_them_again(tmp_path, source):
    with Session(Store(tmp_path / "store")) as session:
        gold = execute(chain(session, source), session)
        lost = gold["second"]["out"]
        flip(object_file(session.store, lost))
        key = gold["third"].key
        (session.store.root / "ac" / key[:2] / f"{key}.json").write_text("{torn")
    store = Store(tmp_path / "store")
    found = check(store)
    assert (found.corrupt, found.torn, found.incomplete) == ((lost,), 1, 1)
    assert not check(store).corrupt
    store.close()
    with Session(Store(tmp_path / "store")) as session:
        again = execute(chain(session, source), session)
    assert [r.status for r in again.values()] == ["cached", "ran", "ran"]
    assert {k: r.outputs for k, r in again.items()} == {k: r.outputs for k, r in gold.items()}


def test_a_running_build_keeps_what_it_took_from_the_store(tmp_path: Path):
    root, log = tmp_path / "store", tmp_path / "log"
    build(root, log, "ab")
    age(root)
    with Session(Store(root)) as session:
        planner = Planner(session)
        a = planner.add("a", Count(log=str(log), name="a", text="a" * SIZE))
        assert execute(planner.graph(), session)["a"].status == "cached"
        gc(root, 0)
        planner.add("reader", Mix(), {"in": a["out"]})
        assert execute(planner.graph(), session)["reader"].status == "ran"
    assert log.read_text() == "a\nb\n"  # a was not made again
    assert build(root, log, "b") == {"b": "ran"}


def collect_for_ever(root: str) -> None:
    print("ready", flush=True)
    while True:
        gc(Path(root), 0)


@pytest.mark.slow
def test_builds_are_right_while_everything_is_removed_all_the_time(tmp_path: Path):
    root, log = tmp_path / "store", tmp_path / "log"
    words = calling("test_housekeeping", f"collect_for_ever({str(root)!r})")
    remover = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    try:
        assert remover.stdout is not None
        remover.stdout.readline()
        source = tmp_path / "source"
        for number in range(6):
            source.write_text(str(number % 3))
            with Session(Store(root)) as session:
                results = execute(chain(session, source), session, jobs=2)
                assert [str(r.error) for r in results.values() if r.error] == []
            build(root, log, "ab")
        assert remover.poll() is None
    finally:
        remover.kill()
        remover.communicate()


def test_where_no_store_can_be_the_build_runs_in_a_temporary_one(tmp_path: Path):
    (tmp_path / "file").write_text("")
    for impossible in (tmp_path / "file", tmp_path / "file" / "store", Path("/proc/no/store")):
        store = open_store(impossible)
        assert f"cannot write to the store {impossible}" in store.notice
        with Session(store) as session:
            assert one(session, Mix()).status == "ran"
        assert not store.root.parent.exists()
    assert (tmp_path / "file").read_text() == ""


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_store_is_left_alone(tmp_path: Path):
    build(tmp_path / "store", tmp_path / "log", "a")
    (tmp_path / "store/v1/tmp").chmod(0o500)
    store = open_store(tmp_path / "store")
    assert store.notice
    store.close()
