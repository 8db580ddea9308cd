"""Bundles appear whole or not at all, and what a user edited in one is kept aside."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from assetbuild.engine.claims import release
from assetbuild.engine.digest import digest_bytes, digest_file
from assetbuild.errors import MachineError, UsageError
from assetbuild.pipeline import publish as module
from assetbuild.pipeline.publish import (
    heal,
    lies_there,
    new_staging,
    publish,
)

HERE = Path(__file__).parent
EXCHANGE_POINTS = ["kept the user's files", "exchanged", "removed the old one"]
RENAME_POINTS = [
    "kept the user's files",
    "moved the old one",
    "moved the new one",
    "retired the old one",
    "removed the old one",
]


def fill(folder: Path, text: str) -> None:
    folder.mkdir(exist_ok=True)
    for name in ("manifest.json", "mjcf/go1.xml", "urdf/go1.urdf"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(f"{text} {name}")


def content(folder: Path) -> dict[str, str]:
    files = [p for p in folder.rglob("*") if p.is_file()]
    return {p.relative_to(folder).as_posix(): p.read_text() for p in files}


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def manifest(folder: Path) -> dict[str, str]:
    return {name: digest_file(folder / name) for name in content(folder) if "/" in name}


def make(out: Path, text: str, old: dict[str, str] | None = None) -> tuple[str, ...]:
    staging = new_staging(out)
    fill(staging, text)
    return publish(staging, out, old)


@pytest.fixture(params=["exchange", "two renames"])
def way(request, monkeypatch):
    if request.param == "two renames":
        monkeypatch.setattr(module, "_exchange", lambda one, other: False)
    return request.param


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "build" / "go1"


def test_a_bundle_appears_and_is_replaced_whole(out: Path, way: str):
    out.mkdir(parents=True)  # an empty folder may be taken
    make(out, "one")
    assert content(out)["mjcf/go1.xml"] == "one mjcf/go1.xml"
    assert make(out, "one again", manifest(out)) == ()
    (out / "stale.txt").write_text("of the old bundle")
    make(out, "two")
    assert set(content(out).values()) == {
        "two manifest.json",
        "two mjcf/go1.xml",
        "two urdf/go1.urdf",
    }
    assert names_in(out.parent) == ["go1"]


def test_what_the_user_did_is_kept_and_reported(out: Path, way: str):
    make(out, "one")
    old = manifest(out)
    (out / "mjcf/go1.xml").write_text("edited")
    (out / "notes").mkdir()
    (out / "notes/mine.txt").write_text("mine")
    (out / "mjcf/__pycache__").mkdir()
    (out / "mjcf/__pycache__/go1.cpython-311.pyc").write_text("left by an import")
    found = make(out, "two", old)
    aside = out.with_name("go1.edited")
    assert found == ("mjcf/go1.xml", "notes/mine.txt")
    assert content(aside) == {"mjcf/go1.xml": "edited", "notes/mine.txt": "mine"}
    assert "notes/mine.txt" not in content(out)
    (out / "mjcf/go1.xml").write_text("edited again")
    two = {name: digest_bytes(f"two {name}".encode()) for name in old}
    make(out, "three", two)
    assert content(aside)["mjcf/go1.xml"] == "edited"
    assert content(aside)["mjcf/go1.xml.1"] == "edited again"


def test_a_folder_that_is_no_bundle_is_refused_and_stays(out: Path):
    out.mkdir(parents=True)
    (out / "thesis.tex").write_text("years of work")
    with pytest.raises(UsageError, match=r"no manifest\.json: it is not a bundle, so it stays"):
        new_staging(out)
    staging = out.with_name("staging")
    fill(staging, "new")
    with pytest.raises(UsageError):
        publish(staging, out)
    assert content(out) == {"thesis.tex": "years of work"}


def test_a_file_in_the_way_is_refused(out: Path):
    out.parent.mkdir()
    out.write_text("a file")
    with pytest.raises(UsageError, match="is not a folder"):
        new_staging(out)
    assert out.read_text() == "a file"


def test_a_link_to_the_bundle_stays_a_link(out: Path, tmp_path: Path):
    make(out, "one")
    link = tmp_path / "link"
    link.symlink_to(out)
    make(link, "two")
    assert link.is_symlink()
    assert content(out)["mjcf/go1.xml"].startswith("two")


def test_healing_leaves_running_builds_and_other_folders_alone(out: Path):
    make(out, "one")
    running = new_staging(out)
    (running / "half").write_text("being built")
    similar = out.with_name("go1.new-robot")
    similar.mkdir()
    heal(out)
    make(out, "two")
    assert (running / "half").is_file()
    assert similar.is_dir()
    release(running)
    assert not running.exists()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_the_machines_lack(out: Path):
    out.parent.mkdir()
    out.parent.chmod(0o555)
    with pytest.raises(MachineError, match="no permission"):
        new_staging(out)


def make_and_die(out: str, way: str, point: str, old: dict[str, str]) -> None:
    if way == "two renames":
        module._exchange = lambda one, other: False
    module._at = lambda reached: os._exit(9) if reached == point else None
    make(Path(out), "two", old)


@pytest.mark.parametrize(
    ("way", "point"),
    [("exchange", point) for point in EXCHANGE_POINTS]
    + [("two renames", point) for point in RENAME_POINTS],
)
def test_killed_at_any_point_a_whole_bundle_is_there_after_the_next_call(out, way, point):
    make(out, "one")
    old = manifest(out)
    (out / "urdf/go1.urdf").write_text("edited by the user")
    whole_old = content(out)
    call = f"from test_publish import *; make_and_die(*{(str(out), way, point, old)})"
    words = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(HERE)!r}); {call}"]
    assert subprocess.run(words, check=False).returncode == 9
    if way == "exchange":
        assert out.is_dir()
    if point == "retired the old one":  # what is being removed must never be put back
        assert not [name for name in names_in(out.parent) if ".old-" in name]
    heal(out)
    whole_new = {name: f"two {name}" for name in whole_old}
    assert content(out) in (whole_old, whole_new)
    make(out, "three", None)
    assert all(text.startswith("three") for text in content(out).values())
    assert names_in(out.parent) == ["go1", "go1.edited"]
    assert content(out.with_name("go1.edited")) == {"urdf/go1.urdf": "edited by the user"}


def test_a_bundle_that_lies_there_needs_no_swap(out: Path):
    make(out, "v1")
    wanted = {name: digest_file(out / name) for name in content(out)}
    (out / "python/__pycache__").mkdir(parents=True)
    (out / "python/__pycache__/go1.cpython-311.pyc").write_text("left by an import")
    assert lies_there(out, wanted, digest_file)
    assert not lies_there(out.with_name("absent"), wanted, digest_file)
    assert not lies_there(out.with_name("absent"), {}, digest_file)


@pytest.mark.parametrize("how", ["edited", "added", "lost", "linked", "a folder", "unreadable"])
def test_a_bundle_that_the_user_touched_does_not_lie_there(out: Path, how: str):
    make(out, "v1")
    wanted = {name: digest_file(out / name) for name in content(out)}
    file = out / "mjcf/go1.xml"
    text = file.read_bytes()
    if how == "edited":
        file.write_bytes(text[:-1] + b"!")
    elif how == "added":
        (out / "mjcf/mine.xml").write_text("mine")
    else:
        file.unlink()
        if how == "linked":
            (out.parent / "same.xml").write_bytes(text)
            file.symlink_to(out.parent / "same.xml")
        elif how == "a folder":
            file.mkdir()
        elif how == "unreadable":
            os.mkfifo(file)

    def digest(path: Path) -> str:
        if not path.is_file():
            raise OSError("not a regular file")
        return digest_file(path)

    assert not lies_there(out, wanted, digest)
