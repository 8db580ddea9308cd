"""The one door to the world: every answer is recorded, and the record notices every change."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from assetbuild.engine import noop_build
from assetbuild.engine.questions import KIND
from assetbuild.engine.world import World, files_in
from assetbuild.errors import SourceError


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Files, a hidden folder, links to a file, to a folder, to nowhere and in a circle."""
    for name in ("robot/r.urdf", "robot/parts/a.xacro", "robot/.git/b.xacro", "other/r.urdf"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)
    (tmp_path / "source").symlink_to("robot")
    (tmp_path / "robot/link.xacro").symlink_to("parts/a.xacro")
    (tmp_path / "robot/twice.xacro").symlink_to("link.xacro")
    (tmp_path / "robot/nowhere.xacro").symlink_to("absent")
    (tmp_path / "robot/folder.xacro").symlink_to(tmp_path / "other")
    (tmp_path / "robot/circle.xacro").symlink_to("circle.xacro")
    return tmp_path


def write(world: World, folder: Path) -> bool:
    """Record a build that asked this, in a file of `folder`."""
    return noop_build.write(
        str(folder / "record"),
        options="",
        asked=world.record,
        exit_code=0,
        summary="",
        began_ns=time.time_ns(),
    )


def recorded(world: World, folder: Path) -> Callable[[], bool]:
    """Record a build that asked this; then: would the same build do nothing now?"""
    assert write(world, folder)
    return lambda: noop_build.check(str(folder / "record"), "") is not None


def test_a_question_is_asked_once_and_parts_share_the_answer(folder: Path):
    world = World()
    first, second = world.part(), world.part()
    digest = first.digest(folder / "robot/r.urdf")
    (folder / "robot/r.urdf").write_text("edited meanwhile")
    assert second.digest(folder / "robot/r.urdf") == digest
    assert first.is_file(folder / "new") is False
    (folder / "new").write_text("")
    assert second.is_file(folder / "new") is False
    assert world.record.keys() == first.record.keys() == second.record.keys()


def test_parts_record_what_each_asked(folder: Path):
    world = World()
    world.part().digest(folder / "robot/r.urdf")
    part = world.part()
    part.digest(folder / "other/r.urdf")
    assert list(files_in(part.record)) == [str(folder / "other/r.urdf")]
    assert len(files_in(world.record)) == 2


def test_a_file_that_cannot_be_read_is_an_error_of_the_source_and_is_waited_for(folder: Path):
    world = World()
    with pytest.raises(SourceError, match=r"cannot read `.*absent`: No such file"):
        world.digest(folder / "absent")
    lines, changed = noop_build.lines_of(world.record, time.time_ns())
    assert not changed
    assert noop_build.renewed(lines)[1] == []
    (folder / "absent").write_text("here")
    assert noop_build.renewed(lines)[1] == [str(folder / "absent")]


@pytest.mark.parametrize(
    "path",
    [
        "source/r.urdf",
        "source/../other/r.urdf",
        "source/twice.xacro",
        "source/folder.xacro/r.urdf",
        "source/nowhere.xacro",
        "absent/../other",
        "source/parts/../../robot",
    ],
)
def test_links_lead_where_the_kernel_says(folder: Path, path: str):
    found = World().real(folder / path)
    assert found == Path(os.path.realpath(folder / path))
    plain = World().plain(folder / path)
    assert ".." not in plain.parts
    assert plain.resolve() == (folder / path).resolve()


def test_a_path_keeps_its_links_so_that_they_are_asked_for_again_and_a_circle_ends(folder: Path):
    world = World()
    assert world.plain(folder / "source/r.urdf") == folder / "source/r.urdf"
    assert world.real(folder / "robot/circle.xacro").is_relative_to(folder)
    assert not world.is_file(folder / "robot/circle.xacro")


def test_below_are_files_and_links_but_nothing_hidden_and_nothing_behind_links(folder: Path):
    found = {
        p.relative_to(folder).as_posix() for p in World().below(folder / "source", (".xacro",))
    }
    links = {f"source/{name}.xacro" for name in ("link", "twice", "nowhere", "folder", "circle")}
    assert found == {"source/parts/a.xacro", *links}


def test_names_match_in_whatever_case(folder: Path):
    for name in ("LICENSE", "Licence.txt", "COPYING", "notes"):
        (folder / name).write_text("")
    names = World().names(folder, starts=("license", "licence", "copying"))
    assert names == ("COPYING", "LICENSE", "Licence.txt")


def ask_all(world: World, folder: Path) -> None:
    """What a build asks of a source behind a link."""
    source = world.plain(folder / "source")
    world.real(source)
    world.digest(source / "r.urdf")
    for path in world.below(source, (".xacro",)):
        if world.is_file(path):
            world.real(path)
            world.digest(path)
    world.names(source, starts=("license",))
    world.is_file(source / "mesh.stl")
    world.variable("WORLD_TEST")


def retarget(link: Path, target: str) -> None:
    link.unlink()
    link.symlink_to(target)


CHANGES: dict[str, Callable[[Path], object]] = {
    "the source's link leads elsewhere": lambda f: retarget(f / "source", "other"),
    "the source's link leads elsewhere to the same": lambda f: (
        (f / "robot").rename(f / "moved"),
        retarget(f / "source", "moved"),
    ),
    "a file": lambda f: (f / "robot/r.urdf").write_text("changed"),
    "the file behind two links": lambda f: (f / "robot/parts/a.xacro").write_text("changed"),
    "a link in a chain": lambda f: (
        (f / "robot/b.xacro").write_text("robot/parts/a.xacro"),
        retarget(f / "robot/link.xacro", "b.xacro"),
    ),
    "a link that led nowhere": lambda f: (f / "robot/absent").write_text(""),
    "a link to a folder": lambda f: retarget(f / "robot/folder.xacro", "r.urdf"),
    "a file that becomes a link to the same bytes": lambda f: (
        (f / "robot/parts/a.xacro").rename(f / "aside"),
        (f / "robot/parts/a.xacro").symlink_to(f / "aside"),
    ),
    "a part appears": lambda f: (f / "robot/parts/b.xacro").write_text(""),
    "a part goes": lambda f: (f / "robot/parts/a.xacro").unlink(),
    "a folder with a part appears": lambda f: (
        (f / "robot/more").mkdir(),
        (f / "robot/more/c.xacro").write_text(""),
    ),
    "a licence appears": lambda f: (f / "robot/LICENSE").write_text(""),
    "a file appears that was looked for": lambda f: (f / "robot/mesh.stl").write_text(""),
    "the source goes": lambda f: (f / "robot").rename(f / "gone"),
    "a variable is set": lambda f: os.environ.__setitem__("WORLD_TEST", ""),
}


@pytest.mark.parametrize("proven", [False, True], ids=["fresh", "old"])
@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_every_change_is_noticed(
    folder: Path, change: Callable[[Path], object], proven: bool, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("WORLD_TEST", "x")
    monkeypatch.delenv("WORLD_TEST")
    if proven:
        later = time.time_ns() + 10_000_000_000
        monkeypatch.setattr(noop_build.time, "time_ns", lambda: later)
    world = World()
    ask_all(world, folder)
    is_same = recorded(world, folder)
    assert is_same()
    if proven:
        with monkeypatch.context() as patch:  # stamps prove all: nothing is read or listed
            patch.setattr(noop_build, "digest_file", None)
            patch.setattr(noop_build, "names_text", None)
            assert is_same()
    change(folder)
    assert not is_same()


def test_what_nobody_asked_for_may_change(folder: Path):
    world = World()
    ask_all(world, folder)
    is_same = recorded(world, folder)
    (folder / "robot/notes.txt").write_text("")
    (folder / "robot/.git/c.xacro").write_text("")
    (folder / "other/more.urdf").write_text("")
    (folder / "robot/r.urdf").touch()
    assert is_same()


def test_a_world_that_changed_during_the_build_leaves_no_record(folder: Path):
    for change in (
        lambda: (folder / "robot/LICENSE").write_text(""),
        lambda: (folder / "robot/r.urdf").write_text("edited"),
        lambda: retarget(folder / "source", "other"),
    ):
        world = World()
        ask_all(world, folder)
        change()
        assert not write(world, folder)
        assert not (folder / "record").exists()


def test_what_the_build_itself_writes_is_no_change(folder: Path):
    world = World()
    part, lock = world.part(), folder / "r.lock.yaml"
    assert not part.exists(lock)
    lock.write_bytes(b"pin")
    part.wrote(lock, b"pin")
    assert recorded(world, folder)()
    assert (KIND, str(lock), "") not in world.record


MACHINE: dict[str, tuple[Callable[[World], bool], bool, Callable[[Path], object]]] = {
    "a module is installed": (
        lambda w: w.has_module("nobody_has_this"), False,
        lambda f: (f / "nobody_has_this.py").touch(),
    ),
    "a module is removed": (
        lambda w: w.has_module("somebody_has_this"), True,
        lambda f: (f / "somebody_has_this.py").unlink(),
    ),
    "a library is installed": (
        lambda w: w.can_load("libnobody.so.1"), False, lambda f: (f / "libnobody.so.1").touch()
    ),
    "libraries lie elsewhere": (
        lambda w: w.can_load("libc.so.6"), True,
        lambda _: os.environ.__setitem__("LD_LIBRARY_PATH", "/elsewhere"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", MACHINE)
def test_what_is_installed_or_removed_is_noticed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    ask, found, change = MACHINE[name]
    (tmp_path / "somebody_has_this.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("LD_LIBRARY_PATH", str(tmp_path))
    world = World()
    assert ask(world) is found
    is_same = recorded(world, tmp_path)
    assert is_same()
    change(tmp_path)
    assert not is_same()


def test_names_that_are_no_text_are_recorded(tmp_path: Path):
    odd = tmp_path / "odd\tname\\with\nlines"
    odd.mkdir()
    os.close(os.open(os.fsencode(odd) + b"/\xff.xacro", os.O_CREAT | os.O_WRONLY))
    world = World()
    (path,) = world.below(odd, (".xacro",))
    world.digest(path)
    is_same = recorded(world, tmp_path)
    assert is_same()
    path.write_text("changed")
    assert not is_same()
