"""Builds killed by SIGKILL, then run again: the same result, nothing to unlock, no orphans."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest
from builds_for_tests import calling, is_alive
from steps_for_tests import Mix, MixInChild, Slow, Split

from assetbuild.engine.planner import Planner, settle
from assetbuild.engine.session import Session
from assetbuild.engine.store import Store

pytestmark = pytest.mark.own_workers


def build(folder: str, pids: str) -> None:
    """What is killed; the pid files are fields of steps, so every run names the same ones."""
    with Session(Store(Path(folder, "store")), build="killed") as session:
        done = settle(lambda planner: add_steps(planner, Path(folder, "source"), pids), session)
        outputs = {label: result.outputs for label, result in done.results.items()}
        print(json.dumps([[str(error) for error in done.errors], outputs]))


def add_steps(planner: Planner, source: Path, pids: str) -> None:
    split = planner.add("split", Split(), {"in": planner.source(source)})
    inputs = {}
    for number, name in enumerate(json.loads(planner.ask(split["names.json"]) or b"[]")):
        step = Slow(seconds=0.15, salt=number, pid_file=f"{pids}-{number}")
        slow = planner.add(f"slow {name}", step)
        mixed = {"a": split["parts/"] / name, "b": slow["out"]}
        inputs[name] = planner.add(f"mix {name}", MixInChild(), mixed)["out"]
    planner.add("all", Mix(), inputs)


def start(folder: Path, pids: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        calling("test_kill", f"build({str(folder)!r}, {pids!r})"),
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )


def finish(folder: Path, pids: str) -> object:
    process = start(folder, pids)
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    return json.loads(out.splitlines()[-1])


@pytest.fixture(scope="module")
def gold(tmp_path_factory: pytest.TempPathFactory) -> tuple[object, float, str]:
    folder = tmp_path_factory.mktemp("gold")
    pids = str(tmp_path_factory.mktemp("pids") / "pid")
    write_source(folder)
    began = time.monotonic()
    return finish(folder, pids), time.monotonic() - began, pids


def write_source(folder: Path) -> None:
    (folder / "source").write_text("".join(f"part{i} {i}\n" for i in range(6)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "share"),
    [(signal.SIGKILL, 0.4), (signal.SIGKILL, 0.8), (signal.SIGTERM, 0.7)],
)
def test_a_killed_build_leaves_a_store_that_just_works(tmp_path, gold, share, number):
    want, seconds, pids = gold
    write_source(tmp_path)
    for file in Path(pids).parent.iterdir():
        file.unlink()
    process = start(tmp_path, pids)
    time.sleep(share * seconds)
    process.send_signal(number)
    process.wait(timeout=5)
    if process.stdout is not None:
        process.stdout.close()
    assert_no_orphans(Path(pids).parent)
    assert finish(tmp_path, pids) == want
    assert os.listdir(tmp_path / "store/v1/tmp") == []  # noqa: PTH208 - names are enough


def assert_no_orphans(folder: Path) -> None:
    found = [int(path.read_text()) for path in folder.iterdir() if path.read_text()]
    deadline = time.monotonic() + 2
    while any(is_alive(pid) for pid in found):
        assert time.monotonic() < deadline, "a step outlived its build by two seconds"
        time.sleep(0.02)
