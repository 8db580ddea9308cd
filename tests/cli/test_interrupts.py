"""Ctrl-C and SIGTERM: children dead within two seconds, what is finished stays (F30)."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path

import pytest

from .conftest import hear_ctrl_c, new_go1


def descendants(pid: int) -> set[int]:
    """Process ids of all children, and of theirs."""
    found = set[int]()
    for task in Path("/proc").glob(f"{pid}/task/*/children"):
        with suppress(OSError):
            found.update(map(int, task.read_text().split()))
    return found.union(*map(descendants, found))


def is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "times", "code"), [(signal.SIGINT, 2, 130), (signal.SIGTERM, 1, 143)]
)
def test_an_interrupted_build_leaves_nothing_running(
    tmp_path: Path, go1_root: Path, number: signal.Signals, times: int, code: int
):
    place = new_go1(tmp_path / "cold", go1_root, tmp_path / "store")
    build = subprocess.Popen(
        place.command("build", "recipes/go1.yaml"),
        cwd=place.folder,
        env=place.env(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=hear_ctrl_c,
    )
    assert build.stderr is not None
    assert any("] convert_mesh " in line for line in build.stderr)
    children = descendants(build.pid)
    assert children
    began = time.monotonic()
    for _ in range(times):
        os.kill(build.pid, number)
        time.sleep(0.05)
    said = build.communicate(timeout=60)[1]
    while any(is_alive(pid) for pid in children):
        assert time.monotonic() - began < 2
        time.sleep(0.02)
    assert build.returncode == code, said
    assert "what is finished is kept" in said
    assert "Traceback" not in said
    told = place.build("-n").stdout
    stale, total = map(int, re.findall(r"(\d+) of (\d+) steps would run", told)[0])
    assert stale < total
    assert list((place.store / "v1/tmp").iterdir()) == []
