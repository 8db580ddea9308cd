"""Archives are listed and unpacked inside one folder, whatever they say."""

from __future__ import annotations

import json
import stat
import zipfile
from pathlib import Path

import pytest

from assetbuild.engine.step import Files
from assetbuild.errors import SourceError
from assetbuild.source.get import archive
from assetbuild.source.get.archive import ListArchive, Unpack


@pytest.fixture
def files(tmp_path) -> Files:
    (tmp_path / "in").mkdir()
    (tmp_path / "out").mkdir()
    return Files(tmp_path / "in", tmp_path / "out")


def write_zip(files: Files, members: dict[str, str | bytes], **kwargs: int) -> Path:
    path = files.inputs / "archive"
    with zipfile.ZipFile(path, "w", **kwargs) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def write_special(files: Files, name: str, mode: int, data: str = "target") -> None:
    with zipfile.ZipFile(files.inputs / "archive", "w") as archive:
        info = zipfile.ZipInfo(name)
        info.create_system = 3
        info.external_attr = (mode | 0o644) << 16
        archive.writestr(info, data)


def unpacked(files: Files, *members: str, root: str = ".") -> None:
    list(Unpack(root=root, members=members).run(files))


def refused(files: Files, *members: str, root: str = ".") -> str:
    with pytest.raises(SourceError) as caught:
        unpacked(files, *members, root=root)
    assert caught.value.exit_code == 2
    return caught.value.message


def everything_below(folder: Path) -> list[str]:
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def listing(files: Files, root: str = ".") -> dict[str, list]:
    list(ListArchive(root=root).run(files))
    return json.loads((files.outputs / "listing.json").read_text())


ROBOT = {
    "share/robots/go/urdf/go.urdf": "<robot/>",
    "share/robots/go/meshes/材质.obj": "v 0 0 0",
    "share/robots/": "",
    "share/other.txt": "x",
    "shared/trap.txt": "x",
    "tiny-1.dist-info/licenses/LICENSE": "MPL",
    "tiny-1.dist-info/COPYING.txt": "MPL",
    "tiny-1.dist-info/METADATA": "m",
}


def test_only_what_was_asked_for_lies_below_the_root(files):
    write_zip(files, ROBOT)
    unpacked(files, "go/urdf/go.urdf", "go/meshes/材质.obj", root="share/robots")
    assert everything_below(files.outputs) == ["files/go/meshes/材质.obj", "files/go/urdf/go.urdf"]
    assert (files.outputs / "files/go/urdf/go.urdf").read_text() == "<robot/>"


def test_the_listing_holds_files_below_the_root_and_the_licences(files):
    write_zip(files, ROBOT)
    assert listing(files, "share/robots") == {
        "files": ["go/meshes/材质.obj", "go/urdf/go.urdf"],
        "licenses": ["tiny-1.dist-info/COPYING.txt", "tiny-1.dist-info/licenses/LICENSE"],
        "links": [],
    }


def test_a_missing_root_or_member_is_named_with_the_nearest(files):
    write_zip(files, ROBOT)
    with pytest.raises(SourceError) as caught:
        listing(files, "share/robot")
    assert caught.value.hint == "did you mean `share/robots`?"
    with pytest.raises(SourceError) as caught:
        unpacked(files, "go/urdf/go1.urdf", root="share/robots")
    assert caught.value.hint == "did you mean `go/urdf/go.urdf`?"


@pytest.mark.parametrize(
    "name", ["../evil", "a/../../evil", "/evil", "a//b", "a/./b", "C:/evil", "a\\..\\evil", "a\nb"]
)
def test_names_that_lead_elsewhere_are_refused_and_nothing_is_written(files, tmp_path, name):
    write_zip(files, {name: "x", "fine": "y"})
    message = refused(files, name)
    assert "archive: member `" in message
    assert everything_below(files.outputs) == []
    assert not (tmp_path / "evil").exists()
    with pytest.raises(SourceError):
        listing(files)


def test_a_name_cut_by_a_nul_is_refused(files):
    path = write_zip(files, {"goodXevil": "x"})
    path.write_bytes(path.read_bytes().replace(b"goodXevil", b"good\0evil"))
    with pytest.raises(SourceError, match="control character"):
        listing(files)
    assert "no file `good`" in refused(files, "good")


@pytest.mark.parametrize(
    ("mode", "said"),
    [(stat.S_IFLNK, "symbolic link"), (stat.S_IFCHR, "regular"), (stat.S_IFIFO, "regular")],
)
def test_links_and_devices_are_refused(files, mode, said):
    write_special(files, "member", mode, "/etc/passwd")
    assert said in refused(files, "member")
    assert everything_below(files.outputs) == []


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_member_that_is_there_twice_is_refused(files):
    with zipfile.ZipFile(files.inputs / "archive", "w") as archive:
        archive.writestr("a", "one")
        archive.writestr("a", "two")
        archive.writestr("b", "three")
    assert "twice" in refused(files, "a")
    unpacked(files, "b")


@pytest.mark.parametrize(("one", "two"), [("Calf.dae", "calf.DAE"), ("\u00e9.obj", "e\u0301.obj")])
def test_names_that_are_one_file_on_some_disks_are_refused(files, one, two):
    write_zip(files, {one: "1", two: "2"})
    assert "differ only in upper and lower case" in refused(files, one, two)
    unpacked(files, one)


def test_a_file_that_is_also_a_folder_is_refused(files):
    write_zip(files, {"a": "1", "a/b": "2"})
    assert "below what is itself a file" in refused(files, "a", "a/b")


@pytest.mark.parametrize(
    ("count", "megabytes", "words"), [(1, 20, "grows"), (3, 9, "would unpack to 27 MB")]
)
def test_a_bomb_is_refused_before_it_is_unpacked(files, count, megabytes, words):
    members = {f"z{i}": bytes(megabytes << 20) for i in range(count)}
    write_zip(files, members, compression=zipfile.ZIP_DEFLATED)
    assert words in refused(files, *members)
    assert everything_below(files.outputs) == []


def test_too_large_a_file_and_too_large_a_total_are_refused(files, monkeypatch):
    write_zip(files, {"a": "12345", "b": "12345"})
    monkeypatch.setattr(archive, "MAX_FILE", 4)
    assert "is larger than" in refused(files, "a")
    monkeypatch.setattr(archive, "MAX_FILE", 5)
    monkeypatch.setattr(archive, "MAX_TOTAL", 9)
    assert "would unpack to" in refused(files, "a", "b")


def test_a_lie_about_the_size_is_found(files):
    path = write_zip(files, {"a": "x" * 1000}, compression=zipfile.ZIP_DEFLATED)
    data = path.read_bytes()
    real, said = (1000).to_bytes(4, "little"), (10).to_bytes(4, "little")
    assert data.count(real) == 2
    path.write_bytes(data.replace(real, said))
    assert "member `a` cannot be unpacked" in refused(files, "a")


def test_a_wrong_checksum_names_the_member(files):
    path = write_zip(files, {"fine": "fine", "bad": "abcdefgh"})
    path.write_bytes(path.read_bytes().replace(b"abcdefgh", b"abcdefgX", 1))
    assert "member `bad` cannot be unpacked: Bad CRC-32" in refused(files, "bad")
    (files.outputs / "files/bad").unlink()
    unpacked(files, "fine")


def test_an_encrypted_member_is_refused(files):
    path = write_zip(files, {"a": "secret"})
    data = bytearray(path.read_bytes())
    local, central = data.index(b"PK\x03\x04"), data.index(b"PK\x01\x02")
    data[local + 6] |= 1
    data[central + 8] |= 1
    path.write_bytes(bytes(data))
    assert "is encrypted" in refused(files, "a")


@pytest.mark.parametrize("cut", [0, 10, 60])
def test_a_cut_off_or_foreign_archive_is_one_clear_error(files, cut):
    path = write_zip(files, {"a": "x" * 100})
    path.write_bytes(path.read_bytes()[:cut])
    assert "the archive cannot be read" in refused(files, "a")
    with pytest.raises(SourceError, match="the archive cannot be read"):
        listing(files)
