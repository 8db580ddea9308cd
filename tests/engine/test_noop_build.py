"""The null build: nothing runs while nothing changed, and every change is noticed."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from assetbuild.engine import noop_build
from assetbuild.engine.digest import digest_file
from assetbuild.engine.questions import BYTES, KIND

OPTIONS = "go1.yaml\t-j2\nx\\y"
SUMMARY = "go1: ready\n\tbundle in build\\go1"


@pytest.fixture
def built(tmp_path: Path) -> Path:
    """A finished build in `tmp_path`: two sources and a bundle of two files, and its record."""
    for name in ("go1.yaml", "mesh 1.stl", "out/manifest.json", "out/mjcf/go1.xml"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)
    assert record(tmp_path)
    return tmp_path


def record(folder: Path) -> bool:
    files = [p for p in folder.rglob("*") if p.is_file() and p.name != "record"]
    out = folder / "out"
    return noop_build.write(
        str(folder / "record"),
        options=OPTIONS,
        asked={(BYTES, str(p), ""): digest_file(p) for p in files if not p.is_relative_to(out)}
        | {(KIND, str(folder / "go1.lock.yaml"), ""): ""},
        made={str(p): digest_file(p) for p in files if p.is_relative_to(out)},
        folders=[str(out)],
        exit_code=0,
        summary=SUMMARY,
        began_ns=time.time_ns(),
    )


def check(folder: Path, options: str = OPTIONS) -> dict[str, object] | None:
    return noop_build.check(str(folder / "record"), options)


def edited_in_secret(path: Path) -> None:
    """The same size, and the same modification time."""
    before = path.stat()
    path.write_text(path.read_text().swapcase())
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert path.stat().st_size == before.st_size


CHANGES: dict[str, Callable[[Path], object]] = {
    "a source is edited": lambda f: edited_in_secret(f / "mesh 1.stl"),
    "the bundle is edited": lambda f: edited_in_secret(f / "out/mjcf/go1.xml"),
    "a file of the bundle goes": lambda f: (f / "out/mjcf/go1.xml").unlink(),
    "a file in the bundle appears": lambda f: (f / "out/mine.txt").write_text("mine"),
    "a source becomes a folder": lambda f: ((f / "go1.yaml").unlink(), (f / "go1.yaml").mkdir()),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_change_is_noticed_however_well_it_hides(built: Path, change: Callable[[Path], object]):
    change(built)
    assert check(built) is None


def test_other_options_another_version_or_another_cpu_build(built: Path, monkeypatch):
    assert check(built, "go1.yaml -j3") is None
    for name, value in (
        ("assetbuild._version.__version__", "99"),
        ("assetbuild.engine.noop_build.machine_text", lambda: "x86_64 glibc2.36 GenuineIntel 6"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(name, value)
            assert check(built) is None
    assert check(built) == {"exit_code": 0, "summary": SUMMARY}


def test_touching_is_no_change_and_the_new_stamps_are_noted(built: Path, monkeypatch):
    os.utime(built / "go1.yaml")
    assert check(built)
    real = time.time_ns
    monkeypatch.setattr(noop_build.time, "time_ns", lambda: real() + 10_000_000_000)
    assert check(built)
    monkeypatch.setattr(noop_build, "digest_file", None)  # from now on `stat` is enough
    assert check(built)


def test_a_fresh_bundle_is_read_again_before_it_is_trusted(built: Path):
    lines = (built / "record").read_text().splitlines()
    (line,) = [line for line in lines if "out/mjcf/go1.xml" in line]
    assert line.endswith(f"\t{noop_build.UNPROVEN}")


@pytest.mark.slow
def test_a_record_cut_or_changed_anywhere_counts_for_nothing(built: Path):
    whole = (built / "record").read_bytes()
    for end in range(len(whole) - 1):
        (built / "record").write_bytes(whole[:end])
        assert check(built) is None
    for place in range(0, len(whole) - 1, 7):
        changed = bytearray(whole)
        changed[place] ^= 4
        (built / "record").write_bytes(changed)
        assert check(built) is None


def test_builds_have_records_of_their_own():
    one = noop_build.record_file("/store", "/a/go1.yaml", "/a/build/go1")
    other = noop_build.record_file("/store", "/a/go1.yaml", "/a/build/go1-train")
    assert one != other
    assert one.startswith("/store/v1/null/go1.yaml-")
