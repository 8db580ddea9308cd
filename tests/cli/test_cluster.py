"""`--executor dask://...`: the same bundle as a build on this machine."""

from __future__ import annotations

from pathlib import Path

import pytest
from engine.clusters_for_tests import CACHE_KEY, cluster
from engine.servers_for_tests import serving

from .conftest import Place, new_legs

pytest.importorskip("distributed", reason="needs assetbuild[dask]")


@pytest.mark.slow
def test_a_cluster_builds_the_same_bundle(legs: Place, tmp_path: Path):
    assert legs.build().returncode == 0
    other = new_legs(tmp_path / "other")
    (tmp_path / "cluster").mkdir()
    with serving() as server, cluster(tmp_path / "cluster") as workers:
        workers.revive()
        words = ("--executor", workers.executor, "--remote", server.url, "--cache-write")
        done = other.build(*words, ASSETBUILD_CACHE_KEY=CACHE_KEY)
        assert done.returncode == 0, done.stderr
        assert {path[:4] for verb, path in server.asked if verb == "PUT"} == {"/ac/", "/cas"}
    assert other.manifest() == legs.manifest()
    assert set(other.steps().values()) == {"ran"}
    stores = sorted((tmp_path / "cluster").glob("worker*/v1/ac/*/*.json"))
    assert len(stores) >= 2  # those with a process of their own: read_urdf, urdf_kinematics, ...


def test_a_cluster_without_a_shared_cache_is_a_wrong_command(legs: Place):
    told = legs.refused("build", legs.name, "--executor", "dask://127.0.0.1:9")
    assert "need `--remote URL` and `--cache-write`" in told
