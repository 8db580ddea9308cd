"""Claims hold without locks: by machine, process and start, and by a stamp from other machines."""

from __future__ import annotations

import errno
import fcntl
import os
import subprocess
import threading
import time
from pathlib import Path

import pytest
from builds_for_tests import calling, count_all

from assetbuild.engine import claims
from assetbuild.engine.claims import (
    EXPIRY_S,
    claim_new_folder,
    claimed_name,
    is_claimed,
    release,
    remove_abandoned,
    turn,
)
from assetbuild.engine.housekeeping import collect, stats
from assetbuild.engine.session import Session
from assetbuild.engine.store import Store


def refuse_locks() -> None:
    """As some network file systems do."""

    def refuse(*_: object) -> None:
        raise OSError(errno.EBADF, os.strerror(errno.EBADF))

    fcntl.flock = fcntl.lockf = refuse


def build(folder: str, names: str, then_s: float) -> None:
    refuse_locks()
    with Session(Store(Path(folder, "store"))) as session:
        count_all(session, Path(folder, "log"), names)
        print("built", flush=True)
        time.sleep(then_s)


def collect_all(folder: str) -> None:
    refuse_locks()
    store = Store(Path(folder, "store"))
    collect(store, 0)
    store.close()
    print(stats(store.root.parent).objects)


def python(call: str) -> subprocess.Popen[str]:
    return subprocess.Popen(calling("test_claims", call), stdout=subprocess.PIPE, text=True)


def start_build(folder: Path, names: str, then_s: float) -> subprocess.Popen[str]:
    started = python(f"build({str(folder)!r}, {names!r}, {then_s})")
    assert started.stdout is not None
    assert started.stdout.readline() == "built\n"
    return started


def objects_after_gc(folder: Path) -> int:
    time.sleep(0.1)  # beyond the tick of the clock that gc spares
    return int(python(f"collect_all({str(folder)!r})").communicate(timeout=60)[0])


def test_without_locks_gc_spares_what_running_builds_made_and_frees_it_when_they_are_killed(
    tmp_path: Path,
):
    start_build(tmp_path, "ab", 0).communicate()
    running = start_build(tmp_path, "c", 60)
    assert objects_after_gc(tmp_path) == 1
    running.kill()
    running.communicate()
    assert objects_after_gc(tmp_path) == 0
    assert list((tmp_path / "store/v1/tmp").iterdir()) == []


def test_gc_frees_beside_a_process_that_builds_now_and_then(tmp_path: Path):
    """As a worker of a cluster does for a week."""
    with Session(Store(tmp_path / "store")) as session:
        for name in "ab":
            with session.store.busy():
                count_all(session, tmp_path / "log", name)
        time.sleep(0.1)
        store = Store(tmp_path / "store")
        assert collect(store, 0).objects == 2
        store.close()
        with session.store.busy():
            session.store.put_bytes(b"of what it builds now")
            store = Store(tmp_path / "store")
            assert collect(store, 0).objects == 0
            store.close()
    assert stats(tmp_path / "store").objects == 1


def elsewhere() -> str:
    """The name of a claim of another machine."""
    return f"01234567{claimed_name()[8:]}"


def of_another_process() -> str:
    """With our number, as numbers are used again."""
    machine, pid, start, number = claimed_name().split("-")
    return f"{machine}-{pid}-{int(start) + 1}-{number}"


def of_a_dead_process() -> str:
    ended = subprocess.Popen(["true"])
    ended.wait()
    machine, _, start, number = claimed_name().split("-")
    return f"{machine}-{ended.pid}-{start}-{number}"


def make_old(path: Path, seconds: float) -> None:
    stamp = time.time() - seconds
    os.utime(path, (stamp, stamp), follow_symlinks=False)


@pytest.mark.parametrize(
    ("name", "age_s", "holds"),
    [
        (claimed_name, 10 * EXPIRY_S, True),
        (of_another_process, 0, False),
        (of_a_dead_process, 0, False),
        (elsewhere, 0, True),
        (elsewhere, EXPIRY_S - 60, True),
        (elsewhere, EXPIRY_S + 60, False),
    ],
)
def test_a_claim_holds_as_long_as_its_owner_may_live(tmp_path, name, age_s, holds):
    folder = tmp_path / name()
    folder.mkdir()
    make_old(folder, age_s)
    assert is_claimed(folder) is holds
    remove_abandoned(tmp_path.iterdir())
    assert folder.exists() is holds


def test_a_claim_is_renewed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder = claim_new_folder(tmp_path)
    make_old(folder, EXPIRY_S)
    monkeypatch.setattr(claims, "RENEW_S", 0.01)
    threading.Thread(target=claims._renew, daemon=True).start()
    deadline = time.monotonic() + 10
    while time.time() - folder.stat().st_mtime > 60:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    monkeypatch.undo()
    release(folder)


@pytest.mark.parametrize("owner", [elsewhere, claimed_name])
def test_nobody_waits_for_ever_and_an_expired_turn_is_taken_at_once(tmp_path: Path, owner):
    link = tmp_path / "k"
    link.symlink_to(owner())
    began = time.monotonic()
    with turn(link, patience_s=0.3):
        assert time.monotonic() - began >= 0.3
    assert link.is_symlink()  # we went on without it
    link.unlink()
    link.symlink_to(elsewhere())
    make_old(link, EXPIRY_S + 60)
    assert_turn_is_taken_at_once(link)


def test_what_an_earlier_version_left_in_the_place_of_a_turn_is_removed(tmp_path: Path):
    (tmp_path / "k").touch()
    assert_turn_is_taken_at_once(tmp_path / "k")


def assert_turn_is_taken_at_once(path: Path) -> None:
    began = time.monotonic()
    with turn(path, patience_s=30):
        assert time.monotonic() - began < 5
    assert list(path.parent.iterdir()) == []
