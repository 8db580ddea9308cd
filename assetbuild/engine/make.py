"""Making one node: from the store if its key is known, else by running its step."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from assetbuild.engine.actions import Action, Made
from assetbuild.engine.claims import turn
from assetbuild.engine.explain import changes_text, why_it_runs
from assetbuild.engine.graph import Graph
from assetbuild.engine.journal import Change
from assetbuild.engine.processes import ATTEMPTS, Processes
from assetbuild.engine.session import Resolver, Session
from assetbuild.engine.store import LostObjectError
from assetbuild.errors import AssetBuildError, StepError
from assetbuild.findings import Finding

Status = Literal["ran", "cached", "failed", "blocked"]


@dataclass(frozen=True)
class NodeResult:
    """What became of one node.

    key: empty when it was never computed (blocked). outputs: name -> digest.
    seconds: wall clock of its step when it ran just now, else 0. cpu_seconds: of its child
    process. saved_seconds: what a cached step took when it last ran.
    reason: why it ran, or what blocked it.
    log: what the step printed, and the traceback of a bug; None when there is nothing.
    """

    label: str
    status: Status
    key: str = ""
    outputs: dict[str, str] | None = None
    findings: tuple[Finding, ...] = ()
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    saved_seconds: float = 0.0
    error: AssetBuildError | None = None
    reason: str = ""
    log: Path | None = None

    def __getitem__(self, output: str) -> str:
        """Digest of an output; KeyError when there is none (the node failed or was blocked)."""
        return (self.outputs or {})[output]


class Maker:
    """Makes nodes of one graph. `make` may be called from many threads."""

    def __init__(self, graph: Graph, session: Session, runner: Processes) -> None:
        self.graph = graph
        self.session = session
        self.runner = runner
        self.resolver = Resolver(graph.nodes, session)
        self._outputs: dict[str, Mapping[str, str]] = {}

    def make(
        self, label: str, started: Callable[[str], None] = lambda _: None
    ) -> NodeResult | None:
        """The node, from the store or freshly run; its errors are in the result.

        None when the store has lost what it reads: the nodes before it must be looked for again.
        `started` is called when the step really runs.
        """
        began = time.monotonic()
        action = None
        changes: tuple[Change, ...] = ()
        try:
            action = self.resolver.action(label)
            if action is None:
                return None
            made = self.resolver.made(label)
            if made is None:
                # Each action runs once: in this build, and among all that share the store.
                patience_s = action.step.limits.wall_s * ATTEMPTS + 30.0
                place = self.session.store.root / "turns" / action.key
                with turn(place, patience_s=patience_s, done=lambda: self.runner.closed):
                    made = self.resolver.made(label)  # another may have made it meanwhile
                    if made is None:
                        changes = why_it_runs(self.session, action)
                        started(label)
                        return self.ran(action, self._run(action, changes), changes)
            self._outputs.setdefault(action.key, made.outputs)
            self.session.journal.saw(label, action.parts)
            return _cached(action, made)
        except LostObjectError:
            self.session.forget()
            return None
        except AssetBuildError as error:
            return NodeResult(
                label=label,
                status="failed",
                key=action.key if action else "",
                seconds=round(time.monotonic() - began, 4),
                error=error,
                reason=changes_text(changes),
                log=self._log(label),
            )

    def ran(self, action: Action, made: Made, changes: tuple[Change, ...] = ()) -> NodeResult:
        """The result of a step that ran just now."""
        return replace(
            _cached(action, made),
            status="ran",
            seconds=made.seconds,
            cpu_seconds=made.cpu_seconds,
            saved_seconds=0.0,
            reason=changes_text(changes) + ("; run again after a crash" * (made.attempts > 1)),
            log=self._log(action.label),
        )

    def _run(self, action: Action, changes: tuple[Change, ...]) -> Made:
        """Run the step and remember what it made."""
        try:
            made = self.runner.run(action)
        finally:
            refs = self.graph.nodes[action.label].inputs.values()
            self.session.world.check(ref.output for ref in refs if not ref.node)
        if self._outputs.setdefault(action.key, made.outputs) != made.outputs:
            raise StepError(
                f"step `{action.label}` gave other bytes when it was run again",
                hint="run the build again; a step must give the same bytes for the same inputs",
            )
        self.session.actions.learn(action.key, made)
        # The clock also counts what else the machine did; of a download it is all there is.
        by_clock = action.step.network or not made.child
        work_s = made.seconds if by_clock else min(made.seconds, made.cpu_seconds)
        self.session.journal.ran(action.label, action.parts, changes, work_s)
        return made

    def _log(self, label: str) -> Path | None:
        path = self.session.journal.log_path(label)
        return path if path.is_file() else None


def _cached(action: Action, made: Made) -> NodeResult:
    return NodeResult(
        label=action.label,
        status="cached",
        key=action.key,
        outputs=dict(made.outputs),
        findings=made.findings,
        saved_seconds=made.seconds,
    )
