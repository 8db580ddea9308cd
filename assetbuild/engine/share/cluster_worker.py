"""What runs in a worker of dask: one step, from the shared cache and back to it."""

from __future__ import annotations

import functools
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from assetbuild.engine.actions import Action, missing_output
from assetbuild.engine.execute import HEALING_ROUNDS
from assetbuild.engine.explain import changes_between, changes_text
from assetbuild.engine.folders import cache_root
from assetbuild.engine.keys import key_parts
from assetbuild.engine.processes import Processes
from assetbuild.engine.session import Session
from assetbuild.engine.share.remote import Budget, Remote
from assetbuild.engine.store import LostObjectError, open_store
from assetbuild.engine.wire import error_to_json, step_from_json
from assetbuild.errors import AssetBuildError, MachineError, StepError


def run_action(text: str) -> str:
    """JSON in and out: what `Cluster.run` asks for -> `{}`, `{error}`, or `{lost}`.

    `{}`: the results are in the shared cache. lost: inputs that the cache has evicted.
    """
    spec = json.loads(text)
    try:
        return json.dumps(_make(spec))
    except AssetBuildError as error:
        if error.hint.startswith("its log: "):
            error.hint = f"its log on {os.uname().nodename}: {error.hint[9:]}"
        return json.dumps({"error": error_to_json(error)})


@functools.lru_cache(maxsize=4)
def _place(address: str) -> tuple[Session, Remote, Processes]:
    """One for all actions of this worker, so that its child processes stay warm."""
    key = os.environ.get("ASSETBUILD_CACHE_KEY", "")
    patient = Budget(lost_s=math.inf, errors=1 << 30)  # it lives longer than one build
    remote = Remote(address, key=key, write=True, budget=patient)
    session = Session(open_store(Path(cache_root())), build="cluster")
    return session, remote, Processes(session)


def _make(spec: Mapping[str, Any]) -> dict[str, object]:  # Any: JSON
    """From this store, from the shared cache, or freshly run. AssetBuildError.

    The machine that plans looks after sources, and holds the turn of the action. Nothing is taken
    for granted that an earlier action saw: this process may have run for a week.
    """
    action = Action.of(spec["label"], step_from_json(spec["step"]), spec["parts"])
    # Its address may hold credentials, so that of a worker's own environment comes first.
    address = os.environ.get("ASSETBUILD_REMOTE") or spec["remote"]
    session, remote, processes = _place(address)
    _check_same_key(action, session)
    store = session.store
    with store.busy():
        remote.forget()
        for _ in range(HEALING_ROUNDS):
            session.forget()
            try:
                made = session.actions.known(action.key) or remote.get(action.key, store)
                if made is None:
                    lost = remote.fetch(spec["objects"], store)
                    if lost:
                        return {"lost": sorted(lost)}
                    if lost is None:
                        raise MachineError("a worker cannot get its inputs from the shared cache")
                    made = processes.run(action)
                store.put_action(action.key, made.to_json())
            except LostObjectError:  # corrupt, or removed to save space: fetched again
                continue
            if remote.put(action.key, made, store):
                return {}
            if not missing_output(store, made):
                raise MachineError("a worker cannot write its results to the shared cache")
    raise StepError(f"the store of a worker keeps losing what step `{action.label}` reads")


def _check_same_key(action: Action, session: Session) -> None:
    """A worker with other code or libraries would make other bytes under the same key."""
    ours = key_parts(action.step, action.inputs, session.code)
    if ours != action.parts:
        changed = changes_text(changes_between(action.parts, ours))
        worker = os.uname().nodename
        raise MachineError(
            f"worker {worker} is not installed like the machine that builds: {changed}",
            hint="install the same versions on both, then start the worker again",
        )
