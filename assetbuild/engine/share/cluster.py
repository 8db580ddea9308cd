"""Steps on other machines, through dask.distributed; data go through the shared cache.

dask carries plain JSON: what to run and the digests of its inputs one way, findings or an error
the other. A worker fetches what its own store lacks, runs the same child process as a build here
does, and offers the results to the shared cache, from where they are taken, verified.
"""

from __future__ import annotations

import json
import logging
import secrets
from typing import Any
from urllib.parse import urlsplit

from assetbuild.engine.actions import Action, Made
from assetbuild.engine.children import CancelledError
from assetbuild.engine.processes import Processes
from assetbuild.engine.runner import Runner
from assetbuild.engine.session import Session
from assetbuild.engine.share.remote import Remote
from assetbuild.engine.step import Step
from assetbuild.engine.wire import error_from_json, step_to_json
from assetbuild.errors import MachineError, UsageError

CONNECT_S = 10.0
TRIES = 4
"""How often a step is given to the workers before it is run here, if the cache evicts so fast."""
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


class Cluster(Runner):
    """A connection to a scheduler: isolated steps run on its workers, all others here.

    remote: must be written to. MachineError when nobody answers at the address.
    """

    def __init__(self, executor: str, remote: Remote, session: Session) -> None:
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
        self._session = session
        self._here = Processes(session)

    @property
    def places(self) -> int:
        """Steps that all workers together run at once; at least 1, as workers may still come."""
        return max(1, sum(int(count) for count in self._client.nthreads().values()))

    @property
    def memory_mb(self) -> int:
        """The workers' matter, not this machine's."""
        return 1 << 40

    @property
    def closed(self) -> bool:
        """Is nothing started any more?"""
        return self._here.closed

    def prepare(self, step: Step) -> None:
        """Nothing: which worker will run it is not known."""

    def run(self, action: Action) -> Made:
        """Run a step on some worker, as `Runner.run` says."""
        step = action.step
        if step.network or step.cpu_bound or not step.isolated:
            return self._here.run(action)
        for _ in range(TRIES):  # the cache may evict inputs and results at any moment
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
            if lost := answer.get("lost"):
                self._remote.lost(lost)
            elif made := self._session.actions.made_elsewhere(action.key):
                return made
        if self._remote.is_given_up:
            raise _cache_failed(action)
        return self._here.run(action)

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

        from assetbuild.engine.share.cluster_worker import run_action

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
        self._here.close()
        self._client.close(timeout=1)


def _cache_failed(action: Action) -> MachineError:
    return MachineError(
        f"the shared cache failed while step `{action.label}` ran on a worker",
        hint="inputs and results go through it; can this machine and the workers write to it?",
    )
