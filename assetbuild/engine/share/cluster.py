"""Steps on other machines, through dask.distributed; data go through the shared cache.

dask carries plain JSON: what to run and the digests of its inputs one way, findings or an error
the other. A worker fetches what its own store lacks, runs the same child process as a build here
does, and offers the results to the shared cache, from where they are taken, verified.
"""

from __future__ import annotations

import functools
import json
import logging
import math
import os
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from assetbuild.engine.actions import Action, Made, key_parts, missing_output
from assetbuild.engine.children import CancelledError
from assetbuild.engine.explain import changes_between, changes_text
from assetbuild.engine.machine import cache_root
from assetbuild.engine.processes import Processes
from assetbuild.engine.session import Session
from assetbuild.engine.share.remote import Budget, Remote
from assetbuild.engine.step import Step
from assetbuild.engine.store import LostObjectError, open_store
from assetbuild.engine.wire import error_from_json, error_to_json, step_from_json, step_to_json
from assetbuild.errors import AssetBuildError, MachineError, UsageError

CONNECT_S = 10.0
SCHEMES = {"dask": "tcp", "dask+tls": "tls"}


def scheduler_address(executor: str) -> str:
    """`tcp://host:port` of `dask://host:port`, `tls://...` of `dask+tls://...`. UsageError."""
    parts = urlsplit(executor)
    try:
        address = f"{SCHEMES[parts.scheme]}://{parts.hostname}:{parts.port or 8786}"
    except (KeyError, ValueError):
        address = ""
    if not address or not parts.hostname or parts.path.strip("/"):
        raise UsageError(
            f"`{executor}` is no executor",
            hint="say `local`, `dask://HOST:PORT`, or `dask+tls://HOST:PORT`",
        )
    return address


class Cluster(Processes):
    """A connection to a scheduler: isolated steps run on its workers, all others here.

    remote: must be written to. MachineError when nobody answers at the address.
    """

    def __init__(self, executor: str, remote: Remote, session: Session) -> None:
        super().__init__(session)
        address = scheduler_address(executor)
        try:
            import distributed
        except ImportError:
            raise MachineError(
                "an executor of dask needs the Python package `distributed`",
                hint="pip install 'assetbuild[dask]'",
            ) from None
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        self._remote = remote
        connect: Any = distributed.Client  # Any: distributed has hardly any types
        try:
            self._client = connect(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise MachineError(
                f"no scheduler answers at {address}: {error or 'it took too long'}",
                hint="start one by `dask scheduler`, see docs/how-to/cluster.md",
            ) from None

    @property
    def places(self) -> int:
        """Steps that all workers together run at once; at least 1, as workers may still come."""
        return max(1, sum(int(count) for count in self._client.nthreads().values()))

    @property
    def memory_mb(self) -> int:
        """The workers' matter, not this machine's."""
        return 1 << 40

    def prepare(self, step: Step) -> None:
        """Nothing: which worker will run it is not known."""

    def run(self, action: Action) -> Made:
        """Run a step on some worker, else as `Processes` does."""
        step = action.step
        if step.network or step.cpu_bound or not step.isolated:
            return super().run(action)
        objects = self._objects(action)
        if not self._remote.send(objects, self._session.store):
            raise _cache_failed(action)
        spec = {
            "label": action.label,
            "parts": action.parts,
            "step": step_to_json(action.step),
            "objects": objects,
            "remote": self._remote.address,
        }
        answer = self._answer(action, json.dumps(spec))
        if "error" in answer:
            raise error_from_json(answer["error"])
        if made := self._session.actions.made_elsewhere(action.key):
            return made
        if self._remote.is_given_up:
            raise _cache_failed(action)
        return super().run(action)  # the cache has evicted inputs or results meanwhile

    def _objects(self, action: Action) -> dict[str, int]:
        """Size in bytes by digest of all that the action reads, now in the store."""
        for digest in action.inputs.values():
            self._session.object(digest)  # a source comes into the store first
        objects = self._session.store.sizes(action.inputs)
        for digest in objects:
            self._session.object(digest)
        return objects

    def _answer(self, action: Action, spec: str) -> dict[str, Any]:  # Any: JSON
        from distributed import CancelledError as FutureCancelledError
        from distributed.scheduler import KilledWorker

        # Not `pure`: dask would answer from its own memory, and the store is what is verified.
        name = f"{action.label}-{secrets.token_hex(8)}"
        future = self._client.submit(run_action, spec, pure=False, key=name)
        try:
            answer: dict[str, Any] = json.loads(future.result())
        except KilledWorker:
            raise MachineError(
                f"worker after worker died while step `{action.label}` was on it",
                hint="look at the logs of the workers: were they out of memory?",
            ) from None
        except FutureCancelledError:
            if self.closed:
                raise CancelledError from None
            raise MachineError(f"the scheduler gave up step `{action.label}`") from None
        except (OSError, TimeoutError, ImportError, ValueError) as error:
            raise MachineError(
                f"step `{action.label}` could not run on a worker: {error}"
            ) from None
        finally:
            future.release()
        return answer

    def close(self) -> None:
        """Give up what is not finished; nothing is started any more."""
        super().close()
        self._client.close(timeout=1)


def _cache_failed(action: Action) -> MachineError:
    return MachineError(
        f"the shared cache failed while step `{action.label}` ran on a worker",
        hint="inputs and results go through it; can this machine and the workers write to it?",
    )


def run_action(text: str) -> str:
    """JSON in and out: what `Cluster.run` asks for -> `{error}`, or `{}`.

    `{}`: the results are in the shared cache, unless it has evicted something.
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
    return session, remote, Processes(session, long_lived=True)


def _make(spec: Mapping[str, Any]) -> dict[str, object]:  # Any: JSON
    """Take it from this store or the shared cache, or run it. AssetBuildError.

    The machine that plans looks after sources, and holds the turn of the action. Nothing is taken
    for granted that an earlier action saw: this process may have run for a week.
    """
    action = Action(spec["label"], step_from_json(spec["step"]), spec["parts"])
    # Its address may hold credentials, so that of a worker's own environment comes first.
    address = os.environ.get("ASSETBUILD_REMOTE") or spec["remote"]
    session, remote, processes = _place(address)
    _check_same_key(action, session)
    store = session.store
    with store.busy():
        remote.forget()
        session.forget()
        try:
            made = session.actions.known(action.key) or remote.get(action.key, store)
            if made is None:
                is_whole = remote.fetch(spec["objects"], store)
                if is_whole is None:
                    raise MachineError("a worker cannot get its inputs from the shared cache")
                if not is_whole:
                    return {}
                made = processes.run(action)
            store.put_action(action.key, made.to_json())
        except LostObjectError:  # corrupt, or removed to save space
            return {}
        if not remote.put(action.key, made, store) and not missing_output(store, made):
            raise MachineError("a worker cannot write its results to the shared cache")
    return {}


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
