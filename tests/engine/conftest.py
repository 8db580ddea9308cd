"""Fixtures of the engine's tests. The tiny steps must be importable in child processes too."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from assetbuild.engine.session import Session
from assetbuild.engine.store import Store

sys.path.insert(0, str(Path(__file__).parent))


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


@pytest.fixture(scope="session")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A source of two parts; no test edits it."""
    path = tmp_path_factory.mktemp("source") / "robot"
    path.write_text("one 1\ntwo 2\n")
    return path


@pytest.fixture
def server():
    from servers_for_tests import serving

    with serving() as server:
        yield server
