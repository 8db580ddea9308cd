"""The store gives back what was put into it, or reports that it is lost."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from builds_for_tests import chain, object_file
from steps_for_tests import Mix, flip

from assetbuild.engine import digest
from assetbuild.engine import store as store_module
from assetbuild.engine.execute import execute
from assetbuild.engine.scratch import scratch
from assetbuild.engine.session import Session
from assetbuild.engine.stamps import Stamps
from assetbuild.engine.store import LostObjectError, Store, is_plain_path


def cut(path: Path) -> None:
    path.chmod(0o644)
    path.write_bytes(path.read_bytes()[:-1])


FAULTS = {"flip": flip, "cut": cut, "delete": Path.unlink}


def test_a_tree_comes_back_as_it_was(store: Store, tmp_path: Path):
    source = tmp_path / "source"
    (source / "b/c").mkdir(parents=True)
    (source / "a.txt").write_text("a")
    (source / "b/c/材质.txt").write_text("c")
    digest = store.put_tree(source)
    store.restore_tree(digest, tmp_path / "dest")
    found = {p.relative_to(tmp_path / "dest").as_posix() for p in (tmp_path / "dest").rglob("*.*")}
    assert found == {"a.txt", "b/c/材质.txt"}
    assert store.tree(digest)["a.txt"][1] == 1
    assert store.put_tree(tmp_path / "dest") == digest


def test_a_tree_with_a_link_is_refused(store: Store, tmp_path: Path):
    (tmp_path / "t").mkdir()
    (tmp_path / "t/link").symlink_to("/etc/passwd")
    with pytest.raises(ValueError, match="link"):
        store.put_tree(tmp_path / "t")


def test_a_restored_file_is_a_copy_and_the_object_is_read_only(store: Store, tmp_path: Path):
    digest = store.put_bytes(b"abc")
    assert store.path(digest).stat().st_mode & 0o777 == 0o444
    store.restore(digest, tmp_path / "dest")
    (tmp_path / "dest").write_bytes(b"edited in place")
    assert store.path(digest).read_bytes() == b"abc"


@pytest.mark.parametrize("fault", FAULTS)
def test_a_corrupt_object_is_never_given_out(store: Store, tmp_path: Path, fault: str):
    for use in (store.tree, store.path, lambda d: store.restore(d, tmp_path / "dest")):
        digest = store.put_bytes(b"abcdef")
        store.path(digest)
        FAULTS[fault](object_file(store, digest))
        with pytest.raises(LostObjectError):
            use(digest)
        assert not (tmp_path / "dest").exists()
        assert not store.has(digest)
        if fault != "delete":
            assert any((store.root / "quarantine").iterdir())


def test_putting_the_same_bytes_heals_a_corrupt_object(store: Store):
    digest = store.put_bytes(b"abcdef")
    flip(object_file(store, digest))
    assert store.put_bytes(b"abcdef") == digest
    assert store.path(digest).read_bytes() == b"abcdef"


@pytest.mark.parametrize(("tick_ns", "times"), [(1, 1), (10**9, 2)])
def test_an_object_is_hashed_once_unless_its_stamps_may_hide_an_edit(
    tick_ns: int, times: int, store: Store, monkeypatch: pytest.MonkeyPatch
):
    """0.1 s after it was written: where a clock ticks each second, an edit may leave no trace."""
    hashed: list[Path] = []

    def counted(path: Path) -> str:
        hashed.append(path)
        return digest.digest_file(path)

    def ticking(status: os.stat_result) -> digest.Signature:
        changed, *others = digest.signature_of(status)[1:]
        return (0, changed - changed % tick_ns, *others)

    monkeypatch.setattr(store_module, "digest_file", counted)
    monkeypatch.setattr(store_module, "signature_of", ticking)
    name = store.put_bytes(b"x" * 1000)
    time.sleep(0.1)
    store.path(name)
    store.path(name)
    assert len(hashed) == times


@pytest.mark.parametrize("name", ["../x", "/x", "a/../x", "a//b", "", ".", "./a", "a/."])
def test_a_tree_never_leaves_its_folder(store: Store, tmp_path: Path, name: str):
    assert not is_plain_path(name)
    part = store.put_bytes(b"x")
    evil = store.put_listing({name: (part, 1)})
    with pytest.raises(LostObjectError):
        store.restore_tree(evil, tmp_path / "dest")


def test_an_action_comes_back_and_a_torn_or_swapped_one_is_unknown(store: Store):
    key = "a" * 64
    store.put_action(key, {"outputs": {"x": "y"}})
    assert store.action(key) == {"outputs": {"x": "y"}}
    assert store.action("b" * 64) is None
    path = store.root / "ac" / "aa" / f"{key}.json"
    whole = path.read_bytes()
    for end in range(len(whole)):
        path.write_bytes(whole[:end])
        assert store.action(key) is None
    path.write_bytes(whole.replace(b'"y"', b'"z"'))
    assert store.action(key) is None
    other = store.root / "ac" / "bb" / f"{'b' * 64}.json"
    other.parent.mkdir()
    other.write_bytes(whole)
    assert store.action("b" * 64) is None


def test_an_object_that_another_machine_removes_while_it_is_read_is_lost(store, tmp_path):
    """As a network file system answers."""
    digest = store.put_bytes(b"gone")

    def gone(*_: object) -> str:
        raise OSError(errno.ESTALE, os.strerror(errno.ESTALE))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(store_module, "_copy", gone)
        with pytest.raises(LostObjectError):
            store.restore(digest, tmp_path / "out")


def test_a_step_reads_what_the_one_before_it_wrote():
    with scratch() as ports:
        ports.put("parts/a", b"a")
        (first,) = ports.run(Mix())
        assert ports.read("out") == first.message.encode()
        (second,) = ports.run(Mix())
        assert second.message != first.message
    assert not ports.folder.exists()


def test_a_file_of_the_user_is_read_where_it_lies_and_left_there(tmp_path: Path):
    (tmp_path / "a.xacro").write_bytes(b"robot")
    with scratch() as ports:
        for _ in range(2):
            ports.link("tree/pkg/a.xacro", tmp_path / "a.xacro")
        assert ports.read("tree/pkg/a.xacro") == b"robot"
    assert (tmp_path / "a.xacro").read_bytes() == b"robot"


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
def test_a_thousand_edits_within_one_coarse_tick_are_all_noticed(tmp_path, monkeypatch):
    """F10: stamps as of FAT (2 s); edits of one size in one tick look the same."""
    tick = 2 * 10**9
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
