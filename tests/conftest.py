"""Fixtures that several packages' tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROBOTS = Path(__file__).parent / "robots"


@pytest.fixture(scope="session")
def go1_root() -> Path:
    """The source root of the real Go1: the folder `example-robot-data` of the PyPI package."""
    data = os.environ.get("ASSETBUILD_TEST_DATA")
    if not data:
        pytest.skip("the real Go1 is not here: set ASSETBUILD_TEST_DATA (see docs/contributing.md)")
    root = Path(data) / "example-robot-data"
    if not (root / "robots/go1_description/urdf/go1.urdf").is_file():
        pytest.skip(f"no robots/go1_description in {root}")
    return root


@pytest.fixture(scope="session")
def robots() -> Path:
    """The folder of tiny robots, each named for what it shows."""
    return ROBOTS
