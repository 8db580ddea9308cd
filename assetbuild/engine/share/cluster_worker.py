"""What runs in a worker of dask: one step, from the shared cache and back to it."""

from __future__ import annotations

import functools
import json
import math
import os
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from assetbuild.engine.explain import changes_between, changes_text
from assetbuild.engine.folders import cache_root
from assetbuild.engine.graph import Graph, Node, Ref
from assetbuild.engine.keys import key_parts
from assetbuild.engine.make import Maker, NodeResult
from assetbuild.engine.session import Session
from assetbuild.engine.share.remote import Budget, Remote
from assetbuild.engine.step import Step
from assetbuild.engine.store import open_store
from assetbuild.engine.wire import error_to_json, step_from_json
from assetbuild.errors import AssetBuildError, MachineError


class _ActionSession(Session):
    """Inputs are named by their digests; each came from the shared cache, verified."""

    def digest_of_source(self, name: str) -> str:
        return name.removesuffix("/")

    def check_sources(self, node: Node) -> None:
        """The machine that plans looks after them."""


class _ActionMaker(Maker):
    """The machine that plans holds the turn already, maybe in this very store."""

    def _turn(self, node: Node, key: str) -> AbstractContextManager[None]:
        return nullcontext()


def run_action(text: str) -> str:
    """JSON in and out: what `Cluster.run` asks for -> `{}`, or `{error}`.

    The results are in the shared cache then.
    """
    spec = json.loads(text)
    try:
        _make(spec)
    except AssetBuildError as error:
        if error.hint.startswith("its log: "):
            error.hint = f"its log on {os.uname().nodename}: {error.hint[9:]}"
        return json.dumps({"error": error_to_json(error)})
    return json.dumps({})


@functools.lru_cache(maxsize=4)
def _session(address: str, *, sandbox: bool) -> Session:
    """One for all actions of this worker, so that its child processes stay warm."""
    key = os.environ.get("ASSETBUILD_CACHE_KEY", "")
    patient = Budget(lost_s=math.inf, errors=1 << 30)  # it lives longer than one build
    remote = Remote(address, key=key, write=True, budget=patient)
    return _ActionSession(
        open_store(Path(cache_root())), build="cluster", remote=remote, sandbox=sandbox
    )


def _make(spec: Mapping[str, Any]) -> NodeResult:  # Any: JSON
    step = step_from_json(spec["step"])
    _check_same_key(step, spec)
    # Its address may hold credentials, so that of a worker's own environment comes first.
    address = os.environ.get("ASSETBUILD_REMOTE") or spec["remote"]
    session = _session(address, sandbox=spec["sandbox"])
    remote = session.remote
    if remote is None or not remote.fetch(spec["objects"], session.store):
        raise MachineError("a worker cannot get its inputs from the shared cache")
    inputs = {
        name: Ref("", digest + "/" * name.endswith("/")) for name, digest in spec["inputs"].items()
    }
    label = spec["label"]
    graph = Graph({label: Node(label, step, inputs)})
    result = _ActionMaker(graph, session).make(label)
    if result.error is not None:
        raise result.error
    made = session.known(result.key)
    if made is None or not remote.put(result.key, made.to_json(), session.store):
        raise MachineError("a worker cannot write its results to the shared cache")
    return result


def _check_same_key(step: Step, spec: Mapping[str, Any]) -> None:  # Any: JSON
    """A worker with other versions would make other bytes under the same key."""
    ours = key_parts(step, spec["inputs"])
    if ours != spec["parts"]:
        changed = changes_text(changes_between(spec["parts"], ours))
        worker = os.uname().nodename
        raise MachineError(
            f"worker {worker} is not installed like the machine that builds: {changed}",
            hint="install the same versions on both",
        )
