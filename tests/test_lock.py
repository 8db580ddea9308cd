"""The lock pins a source to the byte, and says so in text that a review can read."""

from __future__ import annotations

import hashlib

import pytest

from assetbuild.errors import LockError
from assetbuild.lock import (
    Lock,
    Pin,
    check_pin,
    lock_path,
    lock_text,
    place_of_pin,
    read_lock,
    write_lock,
)
from assetbuild.recipe.source import Source

DIGEST = hashlib.sha256(b"wheel").hexdigest()


def pin(pypi: str = "tiny-robots==1.2.0", sha256: str = DIGEST) -> Lock:
    file = "tiny_robots-1.2.0-py3-none-any.whl"
    return Lock(
        schema="assetbuild-lock/v1", source=Pin(pypi=pypi, file=file, sha256=sha256, size=5)
    )


def source(**keys: str) -> Source:
    return Source.model_validate({"urdf": "r.urdf", **keys})


def test_what_is_written_is_read_back(tmp_path):
    path = tmp_path / "r.lock.yaml"
    assert write_lock(path, pin(sha256="1" * 64)) is True  # of digits alone, it stays text
    assert read_lock(path) == pin(sha256="1" * 64)
    assert read_lock(path).source.name == "tiny-robots"
    assert read_lock(path).source.version == "1.2.0"
    assert [p.name for p in tmp_path.iterdir()] == ["r.lock.yaml"]


def test_writing_the_same_lock_again_touches_nothing(tmp_path):
    path = tmp_path / "r.lock.yaml"
    write_lock(path, pin())
    before = path.stat()
    assert write_lock(path, pin()) is False
    assert path.stat().st_ctime_ns == before.st_ctime_ns


def test_the_text_is_the_same_each_time_and_begins_with_who_wrote_it():
    assert lock_text(pin()) == (
        "# Written by `assetbuild lock`; not meant to be edited\n"
        "schema: assetbuild-lock/v1\n"
        "source:\n"
        '  pypi: "tiny-robots==1.2.0"\n'
        '  file: "tiny_robots-1.2.0-py3-none-any.whl"\n'
        f'  sha256: "{DIGEST}"\n'
        "  size: 5\n"
    )


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("size: 5", "size: many", 7),
        ("size: 5", "size: 0", 7),
        (DIGEST, DIGEST[:-1], 6),
        ("  file:", "  fiel:", 3),
        ("tiny_robots-1.2.0-py3-none-any.whl", "../tiny.whl", 5),
        ("lock/v1", "lock/v9", 2),
        ("source:", "source: [", 3),
    ],
)
def test_a_damaged_lock_is_an_error_with_its_line(tmp_path, old, new, line):
    path = tmp_path / "r.lock.yaml"
    path.write_text(lock_text(pin()).replace(old, new))
    with pytest.raises(LockError) as caught:
        read_lock(path)
    assert caught.value.where.line >= line
    assert caught.value.exit_code == 2


@pytest.mark.parametrize("pypi", ["tiny-robots==1.2.0", "Tiny_Robots==1.2.0"])
def test_the_lock_holds_for_the_source_it_was_made_from(tmp_path, pypi):
    check_pin(source(pypi=pypi), pin(), tmp_path / "r.lock.yaml")


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"pypi": "tiny-robots==1.3.0"}, "tiny-robots==1.3.0"),
        ({"pypi": "other-robots==1.2.0"}, "other-robots==1.2.0"),
    ],
)
def test_a_lock_for_another_source_is_refused(tmp_path, keys, said):
    with pytest.raises(LockError, match=said) as caught:
        check_pin(source(**keys), pin(), tmp_path / "r.lock.yaml")
    assert "assetbuild lock" in caught.value.hint


def test_a_lock_that_is_none_no_map_or_a_dangling_link(tmp_path):
    path = lock_path(tmp_path / "r.yaml")
    assert path == tmp_path / "r.lock.yaml"
    assert read_lock(path) is None
    path.write_text("- 1\n")
    with pytest.raises(LockError, match="expected a map"):
        read_lock(path)
    path.unlink()
    path.symlink_to(tmp_path / "gone")
    with pytest.raises(LockError, match="no such file"):
        read_lock(path)


def test_the_place_of_the_digest_is_its_line(tmp_path):
    path = tmp_path / "r.lock.yaml"
    write_lock(path, pin())
    lines = path.read_text().splitlines()
    assert "sha256" in lines[place_of_pin(path).line - 1]
    path.write_text("[")
    assert place_of_pin(path).line == 0


def other_pin(pypi: str) -> Pin:
    return Pin(pypi=pypi, file="arm-1-py3-none-any.whl", sha256="2" * 64, size=7)


def test_sources_of_parts_are_pinned_beside_the_robots_own(tmp_path):
    path = tmp_path / "r.lock.yaml"
    lock = Lock(schema="assetbuild-lock/v1", source=pin().source, parts=(other_pin("arm==1"),))
    write_lock(path, lock)
    assert read_lock(path) == lock
    assert lock.pin_of(source(pypi="arm==1")) == other_pin("arm==1")
    assert lock.pin_of(source(pypi="tiny-robots==1.2.0")) == pin().source
    assert lock.pin_of(source(pypi="arm==2")) is None
    with pytest.raises(LockError, match="names arm==2"):
        check_pin(source(pypi="arm==2"), lock, path)


def test_a_robot_in_a_folder_with_a_part_from_elsewhere_has_a_lock_of_parts_alone(tmp_path):
    path = tmp_path / "r.lock.yaml"
    write_lock(path, Lock(schema="assetbuild-lock/v1", parts=(other_pin("arm==1"),)))
    assert read_lock(path).source is None
    path.write_text("schema: assetbuild-lock/v1\n")
    with pytest.raises(LockError, match="nothing is pinned"):
        read_lock(path)
