"""The disk is full at the k-th write, for every k: one clear error, and nothing is lost (F3)."""

from __future__ import annotations

import builtins
import errno
import io
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from builds_for_tests import three_steps

from assetbuild.engine.claims import release
from assetbuild.engine.execute import execute
from assetbuild.engine.housekeeping import check
from assetbuild.engine.planner import Planner
from assetbuild.engine.session import Session
from assetbuild.engine.store import Store, machine_errors
from assetbuild.errors import AssetBuildError, MachineError
from assetbuild.pipeline.publish import new_staging, publish

pytestmark = pytest.mark.own_workers


class Disk:
    """Counts writes; from the `full_at`-th on there is no space."""

    def __init__(self, full_at: int | None) -> None:
        self.full_at = full_at
        self.writes = 0

    def take(self, name: Any) -> None:
        if isinstance(name, int):
            return
        self.writes += 1
        if self.full_at is not None and self.writes >= self.full_at:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(name))


class CountedFile:
    """A file opened for writing, whose `write` may fail."""

    def __init__(self, disk: Disk, file: Any) -> None:
        self._disk, self._file = disk, file

    def write(self, data: Any) -> int:
        self._disk.take(self._file.name)
        return int(self._file.write(data))

    def __enter__(self) -> CountedFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


@contextmanager
def disk(full_at: int | None) -> Iterator[Disk]:
    """Opening for writing, writing and making folders count, and fail from `full_at` on."""
    counted = Disk(full_at)
    plain_open, plain_mkdir = io.open, os.mkdir

    def counted_open(file: Any, mode: str = "r", *args: Any, **options: Any) -> Any:
        if not set(mode) & set("wax+"):
            return plain_open(file, mode, *args, **options)
        counted.take(file)
        return CountedFile(counted, plain_open(file, mode, *args, **options))

    def counted_mkdir(path: Any, *args: Any, **options: Any) -> None:
        counted.take(path)
        plain_mkdir(path, *args, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(io, "open", counted_open)
        patch.setattr(builtins, "open", counted_open)
        patch.setattr(os, "mkdir", counted_mkdir)
        yield counted


def build(root: Path, source: Path, dest: Path) -> bytes:
    """Three steps, a folder among their outputs, and one output restored to a user's folder."""
    with Session(Store(root), build="it") as session:
        planner = Planner(session)
        three_steps(planner, source)
        results = execute(planner.graph(), session, jobs=1)
        for result in results.values():
            if result.error is not None:
                raise result.error
        session.store.restore(results["last"]["out"], dest)
        return dest.read_bytes()


def attempt(full_at: int | None, run: Callable[[], bytes]) -> tuple[AssetBuildError | None, int]:
    with disk(full_at) as counted:
        try:
            run()
        except AssetBuildError as error:
            return error, counted.writes
    return None, counted.writes


@pytest.mark.slow
def test_a_full_disk_at_any_write_is_one_error_that_loses_nothing(tmp_path: Path, robot: Path):
    gold = build(tmp_path / "gold", robot, tmp_path / "dest")
    error, writes = attempt(None, lambda: build(tmp_path / "counted", robot, tmp_path / "d"))
    assert error is None
    assert writes > 40
    failed = 0
    tried = range(1, writes + 1, 9)
    for full_at in tried:
        root, dest = tmp_path / f"store-{full_at}", tmp_path / f"dest-{full_at}"
        error, _ = attempt(full_at, lambda root=root, dest=dest: build(root, robot, dest))
        if error is not None:
            failed += 1
            assert isinstance(error, MachineError), (full_at, error)
            assert "no space" in error.message, full_at
            assert error.exit_code == 1
            assert not dest.exists()
        store = Store(root)
        found = check(store)
        assert not found.corrupt and not found.torn, full_at
        store.close()
        assert build(root, robot, dest) == gold, full_at
        assert list((root / "v1/tmp").iterdir()) == []
    assert failed >= len(tried) - 4  # notes such as the journal are given up in silence


def fill(out: Path, content: str) -> None:
    """What a build does with a finished bundle; OSError is its caller's to name."""
    staging = new_staging(out)
    try:
        with machine_errors(out):
            (staging / "folder").mkdir()
            for name in ("manifest.json", "a", "folder/b"):
                with (staging / name).open("w") as file:
                    file.write("{}" if name == "manifest.json" else content)
            publish(staging, out, {})
    finally:
        release(staging)


def test_a_disk_that_fills_up_while_a_bundle_is_written_keeps_the_old_one(tmp_path: Path):
    """The user edited the old one too: that is kept aside, or stays where it is."""
    failed = 0
    for full_at in range(1, 40):
        out = tmp_path / str(full_at) / "out"
        out.parent.mkdir()
        fill(out, "old")
        (out / "mine").write_text("edited by hand")
        error, writes = attempt(full_at, lambda out=out: fill(out, "new"))
        is_new = error is None
        failed += not is_new
        assert (out / "a").read_text() == (out / "folder/b").read_text()
        assert (out / "a").read_text() == ("new" if is_new else "old")
        kept = out / "mine" if (out / "mine").exists() else out.parent / "out.edited/mine"
        assert kept.read_text() == "edited by hand"
        fill(out, "newer")
        assert (out / "a").read_text() == "newer"
        assert not [p for p in out.parent.iterdir() if ".new-" in p.name or ".old-" in p.name]
        if is_new and writes < full_at:
            break
    assert failed > 5
