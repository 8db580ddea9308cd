"""`assetbuild cache`, as a user runs it, on a store that needs no robot."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
from pathlib import Path

import commands
import pytest

from assetbuild.cli.parser import size_of_text
from assetbuild.engine.session import Session
from assetbuild.engine.store import Store, open_store
from assetbuild.errors import UsageError
from assetbuild.pipeline import building
from assetbuild.pipeline.opening import remote_cache


def run(cache: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return commands.run(
        ["cache", *words], Path.cwd(), os.environ | {"ASSETBUILD_CACHE": str(cache)}, timeout=60
    )


def test_stats_check_and_gc(tmp_path: Path):
    store = Store(tmp_path / "store")
    digest = store.put_bytes(b"x" * 3000)
    other = store.put_bytes(b"y" * 3000)
    store.close()
    found = json.loads(run(tmp_path / "store", "stats", "--json").stdout)
    assert (found["objects"], found["object_bytes"]) == (2, 6000)
    assert run(tmp_path / "store", "check").returncode == 0
    path = tmp_path / "store/v1/cas" / digest[:2] / digest
    path.chmod(0o644)
    path.write_bytes(b"x")
    done = run(tmp_path / "store", "check")
    assert done.returncode == 1
    assert f"corrupt, set aside: {digest}" in done.stdout
    assert (tmp_path / "store/v1/cas" / other[:2] / other).is_file()
    done = run(tmp_path / "store", "gc", "--max-size", "1kB")
    assert done.returncode == 0, done.stderr
    assert "1 objects removed" in done.stdout
    assert json.loads(run(tmp_path / "store", "stats", "--json").stdout)["total_bytes"] < 1000


def test_without_a_store_there_is_nothing_to_do(tmp_path: Path):
    for words in (("stats",), ("check",), ("gc", "--max-size", "1GB")):
        assert run(tmp_path / "none", *words).returncode == 0
    assert not (tmp_path / "none").exists()


def test_a_build_without_a_store_warns_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "file").touch()
    roots: list[Path] = []
    monkeypatch.setattr(building, "_jobs", lambda *_: [])
    opened = Session(open_store(tmp_path / "file" / "store"))
    monkeypatch.setattr(building, "open_session", lambda *_, **__: opened)

    def build(_: object, session: Session, *__: object) -> list[object]:
        roots.append(session.store.root)
        return []

    monkeypatch.setattr(building, "_build", build)
    said: list[str] = []
    building.build_all([building.Request(tmp_path / "r.yaml")], lambda _: None, said.append)
    assert len(said) == 1
    assert "warning: cannot write to the store" in said[0]
    assert not roots[0].exists()


def test_sizes_are_read_as_people_write_them():
    texts = ("5GB", "500 MB", "2GiB", "1000", "1.5k")
    assert [size_of_text(t) for t in texts] == [5 * 10**9, 5 * 10**8, 2 * 1024**3, 1000, 1500]
    for wrong in ("", "GB", "5XB", "-1"):
        with pytest.raises(argparse.ArgumentTypeError, match="must be a size"):
            size_of_text(wrong)


def test_a_push_without_a_shared_cache_names_both_ways_to_give_one() -> None:
    with pytest.raises(UsageError, match="give `--remote` or ASSETBUILD_REMOTE"):
        remote_cache("", print, write=True)
