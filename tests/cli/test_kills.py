"""Builds that a signal ends: no orphans, nothing to unlock, and what is finished stays."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from commands import is_alive

from .conftest import Place, hear_ctrl_c, new_go1

pytestmark = pytest.mark.slow
KILL_AT_SWAP = """
import os, signal, sys
from assetbuild.pipeline import publish
publish._at = lambda point: os.kill(os.getpid(), signal.SIGKILL) if point == POINT else None
sys.argv = ["assetbuild", "build", "legs.yaml", "--rehash"]
from assetbuild.__main__ import main
sys.exit(main())
"""


def started(place: Place) -> subprocess.Popen[str]:
    return subprocess.Popen(
        place.command("build", place.name),
        cwd=place.folder,
        env=place.env(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=hear_ctrl_c,
    )


def descendants(pid: int) -> set[int]:
    """Process ids of all children, and of theirs."""
    found = set[int]()
    for task in Path("/proc").glob(f"{pid}/task/*/children"):
        with suppress(OSError):
            found.update(map(int, task.read_text().split()))
    return found.union(*map(descendants, found))


def assert_end_within_two_seconds(children: set[int], began: float) -> None:
    while any(is_alive(pid) for pid in children):
        assert time.monotonic() - began < 2, "a step outlived its build"
        time.sleep(0.02)


def kill_after(place: Place, seconds: float) -> bool:
    """Start a build and kill it; False when it was done before."""
    build = started(place)
    try:
        build.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        children, began = descendants(build.pid), time.monotonic()
        build.kill()
        build.communicate()
        assert_end_within_two_seconds(children, began)
    return build.returncode != 0


def test_killed_eight_times_while_it_builds(legs: Place, built_legs: Place):
    kills = [kill_after(legs, seconds) for seconds in (0.4, 0.8, 1.1, 1.3, 1.5, 1.7, 1.9, 2.1)]
    assert sum(kills) >= 2  # a fast machine is done before the last
    done = legs.build()
    assert done.returncode == 0, done.stdout + done.stderr
    assert legs.manifest() == built_legs.manifest()
    assert list((legs.store / "v1/tmp").iterdir()) == []


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


@pytest.mark.parametrize(
    ("number", "times", "code"), [(signal.SIGINT, 2, 130), (signal.SIGTERM, 1, 143)]
)
def test_an_interrupted_build_leaves_nothing_running(
    tmp_path: Path, go1_root: Path, number: signal.Signals, times: int, code: int
):
    place = new_go1(tmp_path / "cold", go1_root, tmp_path / "store")
    build = started(place)
    assert build.stderr is not None
    assert any("] convert_mesh " in line for line in build.stderr)
    children, began = descendants(build.pid), time.monotonic()
    assert children
    for _ in range(times):
        build.send_signal(number)
        time.sleep(0.05)
    said = build.communicate(timeout=60)[1]
    assert_end_within_two_seconds(children, began)
    assert build.returncode == code, said
    assert "what is finished is kept" in said
    assert "Traceback" not in said
    told = place.build("-n").stdout
    stale, total = map(int, re.findall(r"(\d+) of (\d+) steps would run", told)[0])
    assert stale < total
    assert list((place.store / "v1/tmp").iterdir()) == []
