"""Steps on two workers of dask, each with a store of its own; one server between them."""

from __future__ import annotations

import json
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import pytest
from builds_for_tests import together
from steps_for_tests import Misbehave, MixInChild, Slow, Split

from assetbuild.engine.actions import key_parts
from assetbuild.engine.code import Code
from assetbuild.engine.execute import execute
from assetbuild.engine.make import NodeResult
from assetbuild.engine.planner import Planner
from assetbuild.engine.session import Session
from assetbuild.engine.share import cluster as cluster_module
from assetbuild.engine.share.cluster import Cluster, run_action, scheduler_address
from assetbuild.engine.share.remote import Remote
from assetbuild.engine.store import Store
from assetbuild.engine.wire import step_to_json
from assetbuild.errors import MachineError, StepError, UsageError

pytest.importorskip("distributed", reason="needs assetbuild[dask]")
from clusters_for_tests import LocalCluster, cluster


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory):
    with cluster(tmp_path_factory.mktemp("cluster")) as started:
        yield started


@pytest.fixture
def workers(local: LocalCluster) -> LocalCluster:
    local.revive()
    return local


def build(folder: Path, source: Path, workers=None, server=None, width: int = 4, **options):
    """`width` slow steps on one source, and one that reads them all: results, and contents."""
    with ExitStack() as stack:
        remote = Remote(server.url, key="k", write=True) if workers is not None else None
        session = stack.enter_context(Session(Store(folder), remote=remote))
        if remote is not None:
            options["runner"] = stack.enter_context(Cluster(workers.executor, remote, session))
        planner = Planner(session)
        split = planner.add("split", Split(), {"in": planner.source(source)})
        slow = [
            planner.add(f"slow{n}", Slow(salt=n, seconds=0.3), {"in": split["parts/"] / "one"})
            for n in range(width)
        ]
        inputs = {f"n{n}": node["out"] for n, node in enumerate(slow)} | {"all/": split["parts/"]}
        planner.add("last", MixInChild(), inputs)
        results = execute(planner.graph(), session, **options)
        content = session.read(results["last"]["out"]) if results["last"].outputs else b""
    return results, content


@pytest.fixture(autouse=True)
def same_secret(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ASSETBUILD_CACHE_KEY", "k")


def statuses(results: dict[str, NodeResult]) -> set[str]:
    return {result.status for result in results.values()}


@pytest.mark.slow
def test_two_workers_make_the_same_bytes_whatever_the_cache_evicts(
    tmp_path, robot, workers, server
):
    """The workers have run for long, and know what the cache had then."""
    gold = build(tmp_path / "gold", robot)
    outputs = {label: result.outputs for label, result in gold[0].items()}
    for number, evicted in enumerate(("nothing", "objects", "half", "entries", "all the time")):
        if evicted == "half":
            server.forget(len(server.files) // 2)
        elif evicted in ("objects", "entries"):
            kept = {"objects": "/ac/", "entries": "/cas/"}[evicted]
            server.files = {k: v for k, v in server.files.items() if k.startswith(kept)}
        elif evicted == "all the time":
            server.forgets = 0.3
        results, content = build(tmp_path / str(number), robot, workers, server)
        assert [str(r.error) for r in results.values() if r.error] == []
        assert content == gold[1]
        assert {label: result.outputs for label, result in results.items()} == outputs
    assert server.forgotten > 3
    assert statuses(build(tmp_path / "0", robot)[0]) == {"cached"}


@pytest.mark.slow
def test_a_worker_killed_in_the_middle_costs_nothing_but_time(tmp_path, robot, workers, server):
    gold = build(tmp_path / "gold", robot, width=8)
    timer = threading.Timer(0.8, workers.workers[0].kill)
    timer.start()
    results, content = build(tmp_path / "own", robot, workers, server, width=8)
    timer.cancel()
    assert workers.workers[0].wait(10) != 0
    assert [str(r.error) for r in results.values() if r.error] == []
    assert content == gold[1]


@pytest.mark.slow
def test_a_step_that_crashes_is_one_failed_step(tmp_path, robot, workers, server):
    remote = Remote(server.url, key="k", write=True)
    with (
        Session(Store(tmp_path / "own"), remote=remote) as session,
        Cluster(workers.executor, remote, session) as runner,
    ):
        steps = {how: Misbehave(how=how) for how in ("nothing", "segfault", "abort", "print")}
        results = together(session, steps, runner=runner, keep_going=True)
    assert [r.status for r in results.values()] == ["ran", "failed", "failed", "ran"]
    assert isinstance(results["segfault"].error, StepError)
    assert "step `segfault` crashed with SIGSEGV" in str(results["segfault"].error)
    assert [worker.poll() for worker in workers.workers] == [None, None]


def test_nobody_at_the_address_is_one_error(monkeypatch, server, session):
    monkeypatch.setattr(cluster_module, "CONNECT_S", 0.5)
    began = time.monotonic()
    with pytest.raises(MachineError, match=r"no scheduler answers at tcp://127\.0\.0\.1:9"):
        Cluster("dask://127.0.0.1:9", Remote(server.url, write=True), session)
    assert time.monotonic() - began < 20


@pytest.mark.slow
def test_a_cache_that_fails_is_told(tmp_path, robot, workers, server):
    server.fault = "500"
    results, _ = build(tmp_path / "own", robot, workers, server)
    errors = [r.error for r in results.values() if r.error]
    assert errors
    assert all(isinstance(error, MachineError) for error in errors)
    assert "the shared cache failed while step `slow" in str(errors[0])


@pytest.mark.parametrize(
    ("other", "named"),
    [
        ({"libraries": {"mujoco": "3.0"}}, "library mujoco: 3.0 -> "),
        ({"code": {"assetbuild.mesh.hull": "0"}}, "code assetbuild.mesh.hull is gone"),
    ],
)
def test_a_worker_that_is_installed_differently_refuses_and_says_how(
    tmp_path, monkeypatch, server, other, named
):
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path / "store"))
    step = MixInChild()
    parts = key_parts(step, {}, Code()) | other
    spec = {"label": "it", "parts": parts, "step": step_to_json(step), "objects": {}}
    spec["remote"] = server.url
    answer = json.loads(run_action(json.dumps(spec)))
    assert "is not installed like the machine that builds: " in answer["error"]["message"]
    assert named in answer["error"]["message"]


def test_the_address_of_a_scheduler():
    assert scheduler_address("dask://host") == "tcp://host:8786"
    assert scheduler_address("dask+tls://host:1") == "tls://host:1"
    for wrong in ("dask:/host", "tcp://host:1", "dask://host:port", "dask://host:1/path", "x"):
        with pytest.raises(UsageError, match="is no executor"):
            scheduler_address(wrong)
