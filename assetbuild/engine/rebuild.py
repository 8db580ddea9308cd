"""Proof of reproducibility: every step run a second time on the same inputs, digests compared."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from assetbuild.engine.execute import Event, NodeResult, execute
from assetbuild.engine.graph import Graph, Node, Ref
from assetbuild.engine.session import Resolver, Session
from assetbuild.engine.store import Listing, LostObjectError, Store


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


class _SecondSession(Session):
    """Steps read what the first session made, and write into a store of their own."""

    def __init__(self, first: Session) -> None:
        super().__init__(Store(first.store.scratch()), build="second run", sandbox=first.sandbox)
        self._first = first

    def digest_of_source(self, name: str) -> str:
        return name.removesuffix("/")

    def object(self, digest: str) -> Path:
        return self._first.object(digest)

    def tree(self, digest: str) -> Listing:
        try:
            return self._first.tree(digest)
        except LostObjectError:
            return super().tree(digest)

    def check_sources(self, node: Node) -> None:
        """They were checked in the first run."""


def run_again(
    graph: Graph,
    session: Session,
    results: Mapping[str, NodeResult],
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
    with _SecondSession(session) as second:
        again = execute(
            _without_edges(graph, session),
            second,
            jobs=jobs,
            keep_going=True,
            on_event=on_event,
        )
        found = []
        for label, result in again.items():
            for difference in _differences(results[label], result, session, second):
                found.append(difference)
                for store, name, digest in (
                    (session.store, "first", difference.first),
                    (second.store, "second", difference.second),
                ):
                    if digest:
                        place = keep / label.replace("/", "_") / name / difference.file
                        store.restore(digest, place)
    return tuple(found)


def _without_edges(graph: Graph, session: Session) -> Graph:
    """The same steps, each on inputs that are there already: a source is named by its digest."""
    resolver = Resolver(graph.nodes, session)
    nodes = {}
    for label, node in graph.nodes.items():
        key = resolver.key(label)
        if node.step.network or key is None:
            continue
        inputs = {}
        for name, ref in node.inputs.items():
            digest = resolver.digest(ref)
            if digest is None:
                raise LostObjectError("", f"`{ref}` is not built")
            inputs[name] = Ref("", digest + "/" * ref.is_tree)
        nodes[label] = Node(label, node.step, inputs)
    return Graph(nodes)


def _differences(
    first: NodeResult, second: NodeResult, session: Session, scratch: Session
) -> Iterator[Difference]:
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
        before, after = session.tree(digest), scratch.store.tree(other)
        for name in sorted(before.keys() | after.keys()):
            old, new = before.get(name, ("", 0))[0], after.get(name, ("", 0))[0]
            if old != new:
                yield Difference(first.label, output + name, old, new)
    if [f.to_json() for f in first.findings] != [f.to_json() for f in second.findings]:
        yield Difference(first.label, "findings")
