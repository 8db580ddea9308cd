"""Digests of files and of JSON, and the cache that saves reading what has not changed."""

from __future__ import annotations

import hashlib
import json
import os
import time
from pathlib import Path

import pytest

from assetbuild.engine import digest, stamps
from assetbuild.engine.digest import canonical_json, digest_file, is_racy, signature_of
from assetbuild.engine.stamps import Stamps


@pytest.fixture
def later(monkeypatch: pytest.MonkeyPatch):
    """A clock an hour ahead: everything written up to now is old enough to be trusted."""
    real = time.time_ns
    monkeypatch.setattr(digest.time, "time_ns", lambda: real() + 3_600_000_000_000)


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Paths that were really read."""
    seen: list[str] = []

    def counted(path):
        seen.append(str(path))
        return digest_file(path)

    monkeypatch.setattr(stamps, "digest_file", counted)
    return seen


def test_canonical_json_does_not_depend_on_the_order_of_keys():
    assert canonical_json({"b": 1, "a": [1.5, None]}) == canonical_json({"a": [1.5, None], "b": 1})
    assert canonical_json({"a": "材质"}) == '{"a":"材质"}'.encode()


def test_digest_of_a_file_is_its_sha256(tmp_path: Path):
    (tmp_path / "a").write_bytes(b"x" * 3_000_000)
    assert digest_file(tmp_path / "a") == hashlib.sha256(b"x" * 3_000_000).hexdigest()


def test_an_unchanged_old_file_is_read_once_and_again_by_a_rehash(tmp_path, later, reads):
    path = tmp_path / "a"
    path.write_text("one")
    cache = Stamps(tmp_path / "cache.json")
    first = cache.digest(path)
    cache.save()
    assert Stamps(tmp_path / "cache.json").digest(path) == first
    assert reads == [str(path)]
    assert Stamps(tmp_path / "cache.json", fresh=True).digest(path) == first
    assert reads == [str(path)] * 2


def test_a_fresh_file_is_never_trusted(tmp_path, reads):
    path = tmp_path / "a"
    path.write_text("one")
    cache = Stamps()
    cache.digest(path)
    cache.digest(path)
    assert len(reads) == 2


def test_stamps_in_the_future_prove_nothing(tmp_path):
    path = tmp_path / "a"
    path.write_text("one")
    os.utime(path, (4e9, 4e9))
    assert is_racy(signature_of(path.stat()))


@pytest.mark.parametrize("step_s", [86_400, -86_400])
def test_a_clock_that_steps_by_a_day_hides_no_edit(tmp_path, monkeypatch, step_s):
    """F11: our clock runs a day ahead of, or behind, that of the file system, from here on."""
    path, cache = tmp_path / "a", Stamps()
    path.write_text("----")
    cache.digest(path)
    plain = time.time_ns
    monkeypatch.setattr(digest.time, "time_ns", lambda: plain() + step_s * 10**9)
    for number in range(60):
        text = f"{number:04}"
        path.write_text(text)
        assert cache.digest(path) == hashlib.sha256(text.encode()).hexdigest()


def test_a_same_size_edit_with_its_mtime_put_back_is_noticed(tmp_path, later):
    path = tmp_path / "a"
    path.write_text("one")
    before = path.stat()
    cache = Stamps()
    first = cache.digest(path)
    path.write_text("two")
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert path.stat().st_mtime_ns == before.st_mtime_ns
    assert cache.digest(path) != first


def test_a_cache_cut_at_any_byte_or_foreign_counts_as_empty(tmp_path, later):
    source, file = tmp_path / "a", tmp_path / "cache.json"
    source.write_text("one")
    cache = Stamps(file)
    right = cache.digest(source)
    cache.save()
    whole = file.read_text()
    wrong = ([1, 2, 3, 4, 5], [1, 2, 3, 4, 5, 6], 1, None)
    foreign = [json.dumps({**json.loads(whole), "files": {str(source): one}}) for one in wrong]
    for text in [*(whole[:end] for end in range(len(whole))), *foreign]:
        file.write_text(text)
        assert Stamps(file).digest(source) == right


def test_two_builds_keep_each_others_entries(tmp_path, later):
    for name in "ab":
        (tmp_path / name).write_text(name)
    one, other = Stamps(tmp_path / "cache.json"), Stamps(tmp_path / "cache.json")
    one.digest(tmp_path / "a")
    other.digest(tmp_path / "b")
    one.save()
    other.save()
    assert len(Stamps(tmp_path / "cache.json")._old) == 2


def test_a_folder_or_device_is_no_source(tmp_path):
    for path in (tmp_path, Path(os.devnull)):
        with pytest.raises(OSError, match="not a regular file"):
            Stamps().digest(path)
