"""A wheel comes as the lock says, byte for byte; pip's troubles become one sentence.

No network: the user's pip settings point to a folder of wheels, or to a port where nobody listens.
"""

from __future__ import annotations

import hashlib
import shutil
import sys
import zipfile
from pathlib import Path

import pytest

from assetbuild.engine.step import Files
from assetbuild.engine.world import World
from assetbuild.errors import LockError, MachineError, SourceError
from assetbuild.lock import GitPin, Pin
from assetbuild.recipe.source import Source
from assetbuild.source.get import fetch
from assetbuild.source.get.fetch import Fetch, OnLine
from assetbuild.source.plan import resolve

WHEEL = "tiny_robots-1.2.0-py3-none-any.whl"


def write_wheel(folder: Path, version: str = "1.2.0") -> Path:
    path = folder / f"tiny_robots-{version}-py3-none-any.whl"
    info = f"tiny_robots-{version}.dist-info"
    metadata = f"Metadata-Version: 2.1\nName: tiny-robots\nVersion: {version}\n"
    tag = "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    with zipfile.ZipFile(path, "w") as wheel:
        wheel.writestr("share/tiny.urdf", "<robot name='tiny'/>")
        wheel.writestr(f"{info}/METADATA", metadata)
        wheel.writestr(f"{info}/WHEEL", tag)
        wheel.writestr(f"{info}/RECORD", "")
    return path


@pytest.fixture
def index(tmp_path, monkeypatch) -> Path:
    """A folder that the user's pip settings name as the only index; it holds one wheel."""
    folder = tmp_path / "index"
    folder.mkdir()
    write_wheel(folder)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(folder))
    return folder


@pytest.fixture
def files(tmp_path) -> Files:
    (tmp_path / "in").mkdir()
    (tmp_path / "out").mkdir()
    return Files(tmp_path / "in", tmp_path / "out")


def step(path: Path, **changes: str) -> Fetch:
    fields = {
        "name": "tiny-robots",
        "release": "1.2.0",
        "filename": WHEEL,
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
    }
    return Fetch(**(fields | changes))


def pin_of(version: str, on_line: OnLine = print) -> Pin | GitPin:
    source = Source(pypi=f"tiny-robots=={version}", urdf="tiny.urdf", license="MIT")
    return resolve(source, Path(), World(), on_line)


def test_the_archive_is_the_wheel_and_nothing_else_is_left(index, files):
    assert list(step(index / WHEEL).run(files)) == []
    assert (files.outputs / "archive").read_bytes() == (index / WHEEL).read_bytes()
    assert [p.name for p in files.outputs.iterdir()] == ["archive"]


def test_other_bytes_are_refused_with_both_digests(index, files):
    found = hashlib.sha256((index / WHEEL).read_bytes()).hexdigest()
    with pytest.raises(LockError) as caught:
        list(step(index / WHEEL, sha256="0" * 64).run(files))
    assert found in caught.value.message
    assert "0" * 64 in caught.value.message
    assert "assetbuild lock" in caught.value.hint
    assert list(files.outputs.iterdir()) == []


def test_another_file_of_the_same_version_is_refused(index, files):
    with pytest.raises(LockError, match=r"the lock pins `tiny_robots-1\.2\.0-7-py3"):
        list(step(index / WHEEL, filename="tiny_robots-1.2.0-7-py3-none-any.whl").run(files))


def test_resolving_tells_what_a_lock_pins(index):
    lines: list[str] = []
    pin = pin_of("1.2.0", lines.append)
    data = (index / WHEEL).read_bytes()
    assert (pin.pypi, pin.file, pin.size) == ("tiny-robots==1.2.0", WHEEL, len(data))
    assert pin.sha256 == hashlib.sha256(data).hexdigest()
    assert any("tiny" in line for line in lines)


def test_a_missing_version_names_the_nearest_there_is(index):
    with pytest.raises(SourceError) as caught:
        pin_of("1.2.1")
    assert caught.value.message == "no wheel of tiny-robots==1.2.1 on the index"
    assert caught.value.hint == "did you mean `1.2.0`?"
    assert caught.value.exit_code == 2


def test_a_source_distribution_is_not_taken(index):
    (index / WHEEL).unlink()
    source = index / "tiny_robots-1.2.0"
    source.mkdir()
    (source / "setup.py").write_text("raise SystemExit('a source distribution runs code')")
    shutil.make_archive(str(source), "gztar", index, "tiny_robots-1.2.0")
    with pytest.raises(SourceError, match="no wheel of") as caught:
        pin_of("1.2.0")
    assert "only wheels" in caught.value.hint


def test_without_a_network_the_machine_is_named(monkeypatch, tmp_path):
    monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
    for name in ("PIP_FIND_LINKS", "PIP_EXTRA_INDEX_URL", "PIP_NO_INDEX"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PIP_INDEX_URL", "http://127.0.0.1:9/simple")
    monkeypatch.setenv("PIP_RETRIES", "1")
    with pytest.raises(MachineError) as caught:
        pin_of("1.2.0")
    assert "no package index could be reached" in caught.value.message
    assert "refused" in caught.value.message
    assert "\n" not in caught.value.message


def test_a_missing_pip_is_named(monkeypatch, tmp_path):
    fake = tmp_path / "python"
    fake.write_text(f"#!/bin/sh\necho '{sys.executable}: No module named pip' >&2\nexit 1\n")
    fake.chmod(0o755)
    monkeypatch.setattr(fetch.sys, "executable", str(fake))
    with pytest.raises(MachineError, match="pip is not installed"):
        pin_of("1.2.0")
