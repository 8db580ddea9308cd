"""File systems without locks or with coarse stamps, clocks that step, pickles in the store."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import pickle
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from builds_for_tests import chain, one
from steps_for_tests import Mix

from assetbuild.engine import digest
from assetbuild.engine.execute import execute
from assetbuild.engine.session import Session
from assetbuild.engine.stamps import Stamps
from assetbuild.engine.store import Store

DAY_NS = 86_400 * 10**9


def test_a_file_system_without_locks_builds_and_rebuilds_nothing(tmp_path, source, monkeypatch):
    """F8: as some network file systems answer."""

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", refuse)
    for status in ("ran", "cached"):
        with Session(Store(tmp_path / "store")) as session:
            results = execute(chain(session, source), session)
            assert {result.status for result in results.values()} == {status}


@pytest.mark.slow
@pytest.mark.parametrize("tick_s", [1, 2])
def test_a_thousand_edits_within_one_coarse_tick_are_all_noticed(tmp_path, monkeypatch, tick_s):
    """F10: stamps as of HFS+ (1 s) and FAT (2 s); edits of one size in one tick look the same."""
    tick = tick_s * 10**9
    plain = os.stat

    def coarse(path: object, **options: object) -> object:
        found = plain(path, **options)
        rounded = {n: getattr(found, n) // tick * tick for n in ("st_mtime_ns", "st_ctime_ns")}
        kept = ("st_mode", "st_size", "st_ino", "st_dev")
        return SimpleNamespace(**rounded, **{n: getattr(found, n) for n in kept})

    monkeypatch.setattr(digest.os, "stat", coarse)
    path, cache = tmp_path / "a", Stamps()
    stale = 0
    for number in range(1000):
        path.write_text(f"{number:04}")
        stale += cache.digest(path) != hashlib.sha256(f"{number:04}".encode()).hexdigest()
    assert stale == 0


@pytest.mark.parametrize("step_ns", [DAY_NS, -DAY_NS])
def test_a_clock_that_steps_by_a_day_hides_no_edit(tmp_path, monkeypatch, step_ns):
    """F11: our clock runs a day ahead of, or behind, that of the file system, from here on."""
    path, cache = tmp_path / "a", Stamps()
    path.write_text("0")
    cache.digest(path)
    plain = time.time_ns
    monkeypatch.setattr(digest.time, "time_ns", lambda: plain() + step_ns)
    for number in range(200):
        text = f"{number:04}"
        path.write_text(text)
        assert cache.digest(path) == hashlib.sha256(text.encode()).hexdigest()


class Bomb:
    """Unpickling it makes a file."""

    def __init__(self, canary: Path) -> None:
        self.canary = str(canary)

    def __reduce__(self) -> tuple[object, ...]:
        return (open, (self.canary, "w"))


def test_a_pickle_anywhere_in_the_store_is_never_loaded(tmp_path, source):
    """F21."""
    canary = tmp_path / "canary"
    bomb = pickle.dumps(Bomb(canary))
    with Session(Store(tmp_path / "store")) as session:
        gold = one(session, Mix(), source).outputs
    for path in [p for p in (tmp_path / "store").rglob("*") if p.is_file()]:
        path.chmod(0o644)
        path.write_bytes(bomb)
    source.write_bytes(source.read_bytes())
    with Session(Store(tmp_path / "store")) as session:
        assert one(session, Mix(), source).outputs == gold
    assert not canary.exists()
    pickle.loads(bomb)  # noqa: S301 - our own
    assert canary.exists()  # it would have
