"""`--executor dask://...`: the same bundle as a build on this machine."""

from __future__ import annotations

import sys
import threading
import time
from pathlib import Path

import pytest

from .conftest import Legs, Workplace, new_legs

pytest.importorskip("distributed", reason="needs assetbuild[dask]")
sys.path.insert(0, str(Path(__file__).parents[1] / "engine"))
from clusters_for_tests import CACHE_KEY, LocalCluster, cluster
from servers_for_tests import serving


@pytest.mark.slow
def test_a_cluster_builds_the_same_bundle(legs: Legs, tmp_path: Path):
    assert legs.build().returncode == 0
    gold = (legs.bundle / "manifest.json").read_bytes()
    other = new_legs(tmp_path / "other")
    (tmp_path / "cluster").mkdir()
    with serving() as server, cluster(tmp_path / "cluster") as workers:
        workers.revive()
        words = ("--executor", workers.executor, "--remote", server.url, "--cache-write")
        done = other.build(*words, ASSETBUILD_CACHE_KEY=CACHE_KEY)
        assert done.returncode == 0, done.stderr
        assert {path[:4] for verb, path in server.asked if verb == "PUT"} == {"/ac/", "/cas"}
    assert (other.bundle / "manifest.json").read_bytes() == gold
    assert set(other.steps().values()) == {"ran"}
    stores = sorted((tmp_path / "cluster").glob("worker*/v1/ac/*/*.json"))
    assert (
        len(stores) >= 2
    )  # the steps with a process of their own: read_urdf, urdf_kinematics, ...


@pytest.mark.slow
def test_a_real_robot_on_two_workers_of_which_one_is_killed(
    place: Workplace, cold_place: Workplace, tmp_path: Path
):
    assert place.build().returncode == 0
    gold = (place.bundle / "manifest.json").read_bytes()
    (tmp_path / "cluster").mkdir()
    with serving() as server, cluster(tmp_path / "cluster") as workers:
        workers.revive()
        killer = threading.Thread(target=_kill_one_at_work, args=(workers, tmp_path / "cluster"))
        killer.start()
        words = ("--executor", workers.executor, "--remote", server.url, "--cache-write")
        done = cold_place.build(*words, ASSETBUILD_CACHE_KEY=CACHE_KEY)
        killer.join()
        assert done.returncode == 0, done.stderr
        assert [worker.poll() is None for worker in workers.workers] == [False, True]
    assert (cold_place.bundle / "manifest.json").read_bytes() == gold


def _kill_one_at_work(workers: LocalCluster, folder: Path) -> None:
    """The first worker dies when it has stored two results and is at the next."""
    end = time.monotonic() + 300.0
    while time.monotonic() < end and len(list(folder.glob("worker0/v1/ac/*/*.json"))) < 2:
        time.sleep(0.05)
    workers.workers[0].kill()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--executor", "dask://127.0.0.1:9"], "need `--remote URL` and `--cache-write`"),
        (["--executor", "cluster"], "`cluster` is no executor"),
    ],
)
def test_a_wrong_command_is_told(legs: Legs, words: list[str], told: str):
    done = legs.build(*words)
    assert done.returncode == 2
    assert told in done.stderr
