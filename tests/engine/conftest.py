"""Fixtures of the engine's tests. The tiny steps must be importable in child processes too."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from assetbuild.engine.children import Children, Origin
from assetbuild.engine.session import Session
from assetbuild.engine.store import Store

sys.path.insert(0, str(Path(__file__).parent))
STARTS_ITS_OWN = {"test_children", "test_cpu", "test_disk_full", "test_kill"}
"""Tests about the process that forks workers."""


@pytest.fixture(scope="session")
def origin(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Origin]:
    started = Origin(tmp_path_factory.mktemp("origin"))
    yield started
    started.end()


@pytest.fixture(autouse=True)
def one_process_forks_the_workers_of_all_tests(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, origin: Origin
) -> None:
    """Else each session starts a Python of its own, which takes most of a small test."""
    if request.path.stem not in STARTS_ITS_OWN:
        monkeypatch.setattr(Children, "door", lambda self, kind: origin.door)


@pytest.fixture
def store(tmp_path: Path):
    store = Store(tmp_path / "store")
    yield store
    store.close()


@pytest.fixture
def session(tmp_path: Path):
    with Session(Store(tmp_path / "store"), build="test") as session:
        yield session


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "source.txt"
    path.write_text("1")
    return path
