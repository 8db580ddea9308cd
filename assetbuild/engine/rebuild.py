"""Proof of reproducibility: every step run a second time on the same inputs, digests compared."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from assetbuild.engine.execute import Event, execute
from assetbuild.engine.graph import Graph, Node
from assetbuild.engine.make import Maker, NodeResult
from assetbuild.engine.processes import Processes
from assetbuild.engine.session import Session
from assetbuild.engine.store import Store
from assetbuild.errors import AssetBuildError


@dataclass(frozen=True)
class Difference:
    """A step whose second run gave something else.

    file: output, or file below an output that is a folder; `findings` when only what it said
    differs. first, second: digests, empty where the file is absent. note: why there is no
    second version, if the step failed.
    """

    label: str
    file: str
    first: str = ""
    second: str = ""
    note: str = ""

    def __str__(self) -> str:
        if self.note:
            return f"step `{self.label}`: its second run failed: {self.note}"
        if self.file == "findings":
            return f"step `{self.label}`: its findings differ"
        versions = f"{self.first[:8] or 'absent'}, then {self.second[:8] or 'absent'}"
        return f"step `{self.label}`: `{self.file}` differs: {versions}"


class _Again(Maker):
    """Runs every step, whatever the store knows, and remembers nothing."""

    def make(
        self, label: str, started: Callable[[str], None] = lambda _: None
    ) -> NodeResult | None:
        action = self.resolver.action(label)
        if action is None:
            return None
        started(label)
        try:
            return self.ran(action, self.runner.run(action))
        except AssetBuildError as error:
            return NodeResult(label=label, status="failed", key=action.key, error=error)


def run_again(
    graph: Graph,
    session: Session,
    results: Mapping[str, NodeResult],
    runner: Processes,
    keep: Path,
    *,
    jobs: int | None = None,
    on_event: Callable[[Event], None] | None = None,
) -> tuple[Difference, ...]:
    """Run every step of a built graph again; what differs, in the order of the graph.

    Each step gets the inputs of the first run, so a difference names the step that makes it and
    none after it. Steps with network access are left out: the lock pins what they bring.
    keep: both versions of what differs are put there, `<label>/first|second/<file>`.
    """
    shutil.rmtree(keep, ignore_errors=True)  # of an earlier run
    # What they read is there already, so none waits for another; equal steps run once.
    alone: dict[str, Node] = {}
    for label, node in graph.nodes.items():
        if not node.step.network:
            alone.setdefault(results[label].key, Node(label, node.step, {}))
    again = execute(
        Graph({node.label: node for node in alone.values()}),
        session,
        runner,
        jobs=jobs,
        keep_going=True,
        on_event=on_event,
        maker=_Again(graph, session, runner),
    )
    differences = []
    for label, result in again.items():
        for difference in _differences(results[label], result, session.store):
            differences.append(difference)
            for name, digest in (("first", difference.first), ("second", difference.second)):
                if digest:
                    place = keep / label.replace("/", "_") / name / difference.file
                    session.store.restore(digest, place)
    return tuple(differences)


def _differences(first: NodeResult, second: NodeResult, store: Store) -> Iterator[Difference]:
    if second.error is not None:
        yield Difference(second.label, "", note=second.error.message)
        return
    for output, digest in sorted((first.outputs or {}).items()):
        other = second[output]
        if digest == other:
            continue
        if not output.endswith("/"):
            yield Difference(first.label, output, digest, other)
            continue
        before, after = store.tree(digest), store.tree(other)
        for name in sorted(before.keys() | after.keys()):
            old, new = before.get(name, ("", 0))[0], after.get(name, ("", 0))[0]
            if old != new:
                yield Difference(first.label, output + name, old, new)
    if [f.to_json() for f in first.findings] != [f.to_json() for f in second.findings]:
        yield Difference(first.label, "findings")
