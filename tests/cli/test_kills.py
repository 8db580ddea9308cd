"""SIGKILL at any moment: the next build gives the same bundle, and nothing has to be unlocked."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from .conftest import Place

pytestmark = pytest.mark.slow
KILL_AT_SWAP = """
import os, signal, sys
from assetbuild.pipeline import publish
publish._at = lambda point: os.kill(os.getpid(), signal.SIGKILL) if point == POINT else None
sys.argv = ["assetbuild", "build", "legs.yaml", "--rehash"]
from assetbuild.__main__ import main
sys.exit(main())
"""


def kill_after(place: Place, seconds: float) -> bool:
    """Start a build and kill it with all its children; False when it was done before."""
    child = subprocess.Popen(
        place.command("build", "legs.yaml"),
        cwd=place.folder,
        env=place.env(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        child.wait(seconds)
    except subprocess.TimeoutExpired:
        child.kill()
    return child.wait() != 0


def test_killed_eight_times_while_it_builds(legs: Place, built_legs: Place):
    kills = [kill_after(legs, seconds) for seconds in (0.4, 0.8, 1.1, 1.3, 1.5, 1.7, 1.9, 2.1)]
    assert sum(kills) >= 2  # a fast machine is done before the last
    done = legs.build()
    assert done.returncode == 0, done.stdout + done.stderr
    assert legs.manifest() == built_legs.manifest()


@pytest.mark.parametrize("point", ["kept the user's files", "exchanged"])
def test_killed_while_the_bundle_is_swapped(warm_legs: Place, built_legs: Place, point: str):
    assert warm_legs.build().returncode == 0
    (warm_legs.bundle / "model_card.md").unlink()  # a bundle that lies there whole is not swapped
    code = KILL_AT_SWAP.replace("POINT", repr(point))
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=warm_legs.folder, env=warm_legs.env(), capture_output=True
    )
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert warm_legs.manifest()  # old or new, whole
    assert warm_legs.build("--rehash").returncode == 0
    assert warm_legs.manifest() == built_legs.manifest()
    assert [p.name for p in warm_legs.bundle.parent.iterdir() if ".new-" in p.name] == []
