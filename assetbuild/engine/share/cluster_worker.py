"""What runs in a worker of dask: one step, from the shared cache and back to it."""

from __future__ import annotations

import functools
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from assetbuild.engine.actions import Action, Made
from assetbuild.engine.explain import changes_between, changes_text
from assetbuild.engine.folders import cache_root
from assetbuild.engine.keys import key_parts
from assetbuild.engine.make import HEALING_ROUNDS
from assetbuild.engine.processes import Processes
from assetbuild.engine.session import Session
from assetbuild.engine.share.remote import Budget, Remote
from assetbuild.engine.store import LostObjectError, open_store
from assetbuild.engine.wire import error_to_json, step_from_json
from assetbuild.errors import AssetBuildError, MachineError, StepError


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
def _place(address: str, *, sandbox: bool) -> tuple[Session, Remote, Processes]:
    """One for all actions of this worker, so that its child processes stay warm."""
    key = os.environ.get("ASSETBUILD_CACHE_KEY", "")
    patient = Budget(lost_s=math.inf, errors=1 << 30)  # it lives longer than one build
    remote = Remote(address, key=key, write=True, budget=patient)
    session = Session(open_store(Path(cache_root())), build="cluster", remote=remote)
    return session, remote, Processes(session, sandbox=sandbox)


def _make(spec: Mapping[str, Any]) -> None:  # Any: JSON
    """From this store, from the shared cache, or freshly run. AssetBuildError.

    The machine that plans looks after sources, and holds the turn of the action.
    """
    action = Action.of(spec["label"], step_from_json(spec["step"]), spec["parts"])
    _check_same_key(action)
    # Its address may hold credentials, so that of a worker's own environment comes first.
    address = os.environ.get("ASSETBUILD_REMOTE") or spec["remote"]
    session, remote, processes = _place(address, sandbox=spec["sandbox"])
    made = _made(action, spec["objects"], session, remote, processes)
    session.store.put_action(action.key, made.to_json())
    if not remote.put(action.key, made, session.store):
        raise MachineError("a worker cannot write its results to the shared cache")


def _made(
    action: Action,
    objects: Mapping[str, int],
    session: Session,
    remote: Remote,
    processes: Processes,
) -> Made:
    for _ in range(HEALING_ROUNDS):
        if not remote.fetch(objects, session.store):
            raise MachineError("a worker cannot get its inputs from the shared cache")
        try:
            return session.actions.known(action.key) or processes.run(action)
        except LostObjectError:  # corrupt, or evicted: fetched again
            session.forget()
    raise StepError(f"the store of a worker keeps losing what step `{action.label}` reads")


def _check_same_key(action: Action) -> None:
    """A worker with other versions would make other bytes under the same key."""
    ours = key_parts(action.step, action.inputs)
    if ours != action.parts:
        changed = changes_text(changes_between(action.parts, ours))
        worker = os.uname().nodename
        raise MachineError(
            f"worker {worker} is not installed like the machine that builds: {changed}",
            hint="install the same versions on both",
        )
