"""SIGKILL at any moment: the next build gives the same bundle, and nothing has to be unlocked."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from .conftest import Workplace

KILL_AT_SWAP = """
import os, signal, sys
from assetbuild.pipeline import publish
publish._at = lambda point: os.kill(os.getpid(), signal.SIGKILL) if point == POINT else None
sys.argv = ["assetbuild", "build", "recipes/go1.yaml", "--rehash"]
from assetbuild.__main__ import main
sys.exit(main())
"""


@pytest.fixture(scope="module")
def undisturbed(built_store: Path, tmp_path_factory: pytest.TempPathFactory, go1_root: Path):
    from .conftest import new_workplace

    place = new_workplace(tmp_path_factory.mktemp("undisturbed"), go1_root, built_store)
    assert place.build().returncode == 0
    return (place.bundle / "manifest.json").read_bytes()


def kill_after(place: Workplace, seconds: float) -> bool:
    """Start a build and kill it with all its children; False when it was done before."""
    child = subprocess.Popen(
        place.command("build", "recipes/go1.yaml"),
        cwd=place.folder,
        env=place.env(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    time.sleep(seconds)
    killed = child.poll() is None
    if killed:
        child.kill()
    child.wait()
    return killed


@pytest.mark.slow
def test_killed_eight_times_while_it_builds(cold_place: Workplace, undisturbed: bytes):
    kills = [kill_after(cold_place, seconds) for seconds in (0.4, 0.8, 1.2, 1.6, 2, 2.5, 3, 2)]
    assert sum(kills) >= 4  # a fast machine is done before the last
    done = cold_place.build()
    assert done.returncode == 0, done.stdout + done.stderr
    assert (cold_place.bundle / "manifest.json").read_bytes() == undisturbed


@pytest.mark.parametrize("point", ["kept the user's files", "exchanged"])
def test_killed_while_the_bundle_is_swapped(place: Workplace, undisturbed: bytes, point: str):
    assert place.build().returncode == 0
    (place.bundle / "model_card.md").unlink()  # a bundle that lies there whole is not swapped
    code = KILL_AT_SWAP.replace("POINT", repr(point))
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=place.folder, env=place.env(), capture_output=True
    )
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert (place.bundle / "manifest.json").is_file()  # old or new, whole
    assert place.build("--rehash").returncode == 0
    assert (place.bundle / "manifest.json").read_bytes() == undisturbed
    assert [p.name for p in place.bundle.parent.iterdir() if ".new-" in p.name] == []
