"""Planning and executing by turns, until the plan has all its answers."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from graphlib import TopologicalSorter
from pathlib import Path
from typing import Generic, TypeVar

from assetbuild.engine.execute import Listener, execute
from assetbuild.engine.graph import Graph, GraphError, Node, Ref, check_inputs, joined
from assetbuild.engine.make import NodeResult
from assetbuild.engine.processes import Processes
from assetbuild.engine.session import Resolver, Session
from assetbuild.engine.step import Step
from assetbuild.engine.store import LostObjectError
from assetbuild.engine.world import Record
from assetbuild.errors import AssetBuildError

T = TypeVar("T")


class Planner:
    """Collects nodes; answers what the store knows already.

    world: what the plan asks about files, folders and this machine goes through it.
    questions: references that `ask` could not answer yet: build, then plan again.
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        self.world = session.world.part()
        self.questions: list[Ref] = []
        self._nodes: dict[str, Node] = {}
        self._resolver = Resolver(self._nodes, session)
        self._scope = ""

    def scoped(self, scope: str) -> Planner:
        """The same plan for one part of it: labels of the nodes it adds begin with `scope`."""
        part = copy.copy(self)
        part._scope = self._scope + scope
        return part

    def source(self, path: Path) -> Ref:
        """A file outside the store. SourceError when it cannot be read."""
        self.world.digest(path)
        return Ref("", str(path.absolute()))

    def add(self, label: str, step: Step, inputs: Mapping[str, Ref] | None = None) -> Node:
        """A node that reads the given references under the given names. GraphError.

        A name that ends in a slash takes a folder; names may contain slashes.
        """
        label = self._scope + label
        if label in self._nodes or not label:
            raise GraphError(f"two steps are labelled `{label}`" if label else "a label is empty")
        if _holds_set(step.model_dump()):
            raise GraphError(f"step `{label}` has a set in its fields: its order is not defined")
        node = Node(label, step, dict(inputs or {}))
        check_inputs(node, self._nodes)
        self._nodes[label] = node
        return node

    def ask(self, ref: Ref) -> bytes | None:
        """The bytes of a file if they are built, else None, and the question stays open.

        StepError when the node was built and has no such member.
        """
        digest = self._resolver.digest(ref)
        if digest is not None:
            try:
                return self.session.read(digest)
            except LostObjectError:
                self.session.forget()
        self.questions.append(ref)
        return None

    def graph(self) -> Graph:
        """The graph of what was added so far, in an order of building."""
        added = Graph(self._nodes)
        makers = {label: added.predecessors(label) for label in added.nodes}
        # The standard library does it: networkx alone would cost every build a tenth of a second.
        order = TopologicalSorter(makers).static_order()
        return Graph({label: added.nodes[label] for label in order})


def _holds_set(value: object) -> bool:
    if isinstance(value, dict):
        return any(map(_holds_set, value.values()))
    if isinstance(value, list | tuple):
        return any(map(_holds_set, value))
    return isinstance(value, set | frozenset)


@dataclass(frozen=True)
class Settled(Generic[T]):
    """The last plan, and what became of its steps; of a failed round what there was.

    whole: the plan has all its answers. asked: what it asked of the world, with the answers.
    """

    outline: T
    graph: Graph
    whole: bool
    asked: Record
    results: dict[str, NodeResult] = field(default_factory=dict)

    @property
    def errors(self) -> tuple[AssetBuildError, ...]:
        """Errors of the steps that failed, in the order of the graph."""
        return tuple(result.error for result in self.results.values() if result.error)


def planned(add: Callable[[Planner], T], session: Session) -> Settled[T]:
    """The plan as far as it is known without running anything.

    add: puts the steps into a planner, as far as the answers reach.
    """
    planner = Planner(session)
    outline = add(planner)
    return Settled(outline, planner.graph(), not planner.questions, planner.world.record)


def settle(
    add: Callable[[Planner], T],
    session: Session,
    runner: Processes | None = None,
    *,
    jobs: int | None = None,
    on_event: Listener | None = None,
    may_run: Callable[[Node], bool] | None = None,
) -> Settled[T]:
    """`settle_all` of one plan."""
    return settle_all({"": add}, session, runner, jobs=jobs, on_event=on_event, may_run=may_run)[""]


def settle_all(
    plans: Mapping[str, Callable[[Planner], T]],
    session: Session,
    runner: Processes | None = None,
    *,
    jobs: int | None = None,
    keep_going: bool = False,
    on_event: Listener | None = None,
    may_run: Callable[[Node], bool] | None = None,
) -> dict[str, Settled[T]]:
    """Rounds until the plans have all answers, or a step failed; several plans are one graph.

    keep_going: a step that fails ends its own plan alone.
    plans: by the names that `joined` gives to their graphs; a single one keeps its labels.
    may_run: of the steps that the store does not know yet; None = all of them. Otherwise it ends
    as well when they answer nothing more.
    """
    results: dict[str, NodeResult] = {}
    with nullcontext(runner) if runner else Processes(session) as place:
        while True:
            done = {name: planned(add, session) for name, add in plans.items()}
            graph = joined({name: each.graph for name, each in done.items()})
            now = execute(
                _part(graph, session, may_run) if may_run else graph,
                session,
                place,
                jobs=jobs,
                keep_going=keep_going,
                on_event=on_event,
                whole=all(each.whole for each in done.values()),
            )
            is_stuck = may_run is not None and now.keys() <= results.keys()
            results = _with_earlier(now, results)
            done = {
                name: replace(each, results=_own(results, name, len(plans)))
                for name, each in done.items()
            }
            is_over = all(each.whole or each.errors for each in done.values())
            has_failed = any(each.errors for each in done.values())
            if is_over or is_stuck or (has_failed and not keep_going):
                return done


def _with_earlier(
    now: Mapping[str, NodeResult], earlier: Mapping[str, NodeResult]
) -> dict[str, NodeResult]:
    """What ran in an earlier round is found in the store in this one; it still has run."""
    return {
        label: earlier[label]
        if result.status == "cached" and label in earlier and earlier[label].status == "ran"
        else result
        for label, result in now.items()
    }


def _own(results: dict[str, NodeResult], name: str, plans: int) -> dict[str, NodeResult]:
    """The results of one plan, under the labels of its own graph."""
    if plans == 1:
        return results
    prefix = f"{name}:"
    return {k.removeprefix(prefix): r for k, r in results.items() if k.startswith(prefix)}


def nothing(_: Node) -> bool:
    """No step may run: what the store and the shared cache know is all."""
    return False


def _part(graph: Graph, session: Session, may_run: Callable[[Node], bool]) -> Graph:
    resolver = Resolver(graph.nodes, session)
    kept: dict[str, Node] = {}
    for label, node in graph.nodes.items():  # each after the nodes it reads
        if all(maker in kept for maker in graph.predecessors(label)) and (
            may_run(node) or resolver.made(label) is not None
        ):
            kept[label] = node
    return Graph(kept)
