"""Execution of a graph: in parallel, each node as soon as what it reads is made."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from queue import SimpleQueue
from typing import Literal

from assetbuild.engine.graph import Graph
from assetbuild.engine.journal import Journal
from assetbuild.engine.make import Maker, NodeResult
from assetbuild.engine.processes import Processes
from assetbuild.engine.session import Session
from assetbuild.engine.step import Step
from assetbuild.errors import StepError


@dataclass(frozen=True)
class Costs:
    """Seconds by label, on a machine with nothing else to do.

    seconds: of the step itself. chains: of the longest chain of steps that begins with it, each of
    which reads the one before. guessed: steps that never ran here.
    """

    seconds: Mapping[str, float] = field(default_factory=dict)
    chains: Mapping[str, float] = field(default_factory=dict)
    guessed: frozenset[str] = frozenset()


def costs(graph: Graph, journal: Journal) -> Costs:
    """Each step as long as it last took here, else as long as such a step usually takes."""
    seconds: dict[str, float] = {}
    guessed = set()
    for label, node in graph.nodes.items():
        last = journal.noted(label).seconds
        seconds[label] = node.step.usual_s if last is None else last
        if last is None:
            guessed.add(label)
    chains = dict(seconds)
    for label in reversed(list(graph.nodes)):  # each after all that read it
        for maker in graph.predecessors(label):
            chains[maker] = max(chains[maker], seconds[maker] + chains[label])
    return Costs(seconds, chains, frozenset(guessed))


HEALING_ROUNDS = 3
"""How often what one step reads may be lost and made again."""


@dataclass(frozen=True)
class Event:
    """Progress, for a terminal. Reported by the thread that called `execute`, one at a time.

    planned: once in each round, with the expected `costs` of its steps; `whole`: no later round
    adds steps, so `total` stays.
    started: the step of `label` begins to run (a cached node does not start).
    finished: `result` is there. done counts finished and blocked nodes.
    """

    kind: Literal["planned", "started", "finished"]
    done: int
    total: int
    label: str = ""
    result: NodeResult | None = None
    whole: bool = True
    costs: Costs | None = None


Listener = Callable[[Event], None]
_Message = NodeResult | BaseException | Literal["started", "lost"]


def execute(
    graph: Graph,
    session: Session,
    runner: Processes | None = None,
    *,
    jobs: int | None = None,
    keep_going: bool = False,
    on_event: Listener | None = None,
    maker: Maker | None = None,
    whole: bool = True,
) -> dict[str, NodeResult]:
    """Make every node; a result for each, in the order of the graph.

    Of the nodes that may start, the one with the longest chain of steps behind it comes first.
    runner: where steps run; None = processes of this machine that end with this call.
    jobs: how many steps run at once; a step that declares more `cpus` takes as many places.
    None = the places of the runner. keep_going: after a failure, still make everything that does
    not need the failed node; else only what runs is finished, and steps of the failed one's kind
    where that is `all_told`.
    Child processes together declare no more memory than the runner has left; one always runs.
    maker: makes the nodes; None = from the store or freshly run.
    whole: see `Event`. What the store turns out to have lost is made again.
    Errors of steps are in the results. KeyboardInterrupt passes, with all children killed.
    """
    place = runner or Processes(session)
    schedule = _Schedule(
        graph,
        maker or Maker(graph, session, place),
        places=jobs if jobs and jobs > 0 else place.places,
        memory_mb=place.memory_mb,
        keep_going=keep_going,
        report=on_event or (lambda _: None),
        whole=whole,
    )
    try:
        return schedule.run()
    except BaseException:
        place.close()
        raise
    finally:
        if runner is None:
            place.close()
        session.save()


@dataclass
class _Schedule:
    """The state of one execution; only the calling thread touches it."""

    graph: Graph
    maker: Maker
    places: int
    memory_mb: int
    keep_going: bool
    report: Listener
    whole: bool

    def __post_init__(self) -> None:
        self.results: dict[str, NodeResult] = {}
        self.free = self.places
        self.declared_mb = 0
        self.stopping = False
        self.reported: set[type[Step]] = set()
        self.losses: Counter[str] = Counter()
        self.makers = {label: self.graph.predecessors(label) for label in self.graph.nodes}
        self.readers: dict[str, list[str]] = {label: [] for label in self.graph.nodes}
        for label, makers in self.makers.items():
            for each in makers:
                self.readers[each].append(label)
        self.waiting = {label: set(makers) for label, makers in self.makers.items()}
        self.running: set[str] = set()
        self.costs = costs(self.graph, self.maker.session.journal)
        self.work: SimpleQueue[str | None] = SimpleQueue()
        self.inbox: SimpleQueue[tuple[str, _Message]] = SimpleQueue()

    def run(self) -> dict[str, NodeResult]:
        """The story: start what may start, take what is done, until nothing runs."""
        count = min(self.places, len(self.graph.nodes))
        for _ in range(count):
            threading.Thread(target=self._serve, daemon=True).start()
        self.report(Event("planned", 0, len(self.graph.nodes), whole=self.whole, costs=self.costs))
        try:
            self._start_what_fits()
            while self.running:
                self._take(*self.inbox.get())
                self._start_what_fits()
        finally:
            for _ in range(count):
                self.work.put(None)
        for label in self.graph.nodes:
            if label not in self.results:
                self._block(label, "not started: the build stopped at the first error")
        return {label: self.results[label] for label in self.graph.nodes}

    def _serve(self) -> None:
        """One slot: a thread that makes one node after the other."""
        while (label := self.work.get()) is not None:
            try:
                result = self.maker.make(label, lambda each: self.inbox.put((each, "started")))
                self.inbox.put((label, result or "lost"))
            except BaseException as error:
                self.inbox.put((label, error))

    def _start_what_fits(self) -> None:
        ready = [label for label, missing in self.waiting.items() if not missing]
        for label in sorted(ready, key=lambda label: -self.costs.chains[label]):
            if self.stopping and type(self.graph.nodes[label].step) not in self.reported:
                continue
            need = self._need(label)
            memory_mb = self._memory_mb(label)
            has_memory = not self.declared_mb or self.declared_mb + memory_mb <= self.memory_mb
            if need <= self.free and (has_memory or not memory_mb):
                del self.waiting[label]
                self.running.add(label)
                self.free -= need
                self.declared_mb += memory_mb
                self.work.put(label)

    def _need(self, label: str) -> int:
        return max(1, min(self.places, self.graph.nodes[label].step.limits.cpus))

    def _memory_mb(self, label: str) -> int:
        """What the step declares; steps in this process are small and share its memory."""
        step = self.graph.nodes[label].step
        return step.limits.memory_mb if step.isolated else 0

    def _take(self, label: str, message: _Message) -> None:
        if message == "started":
            self._say("started", label)
            for reader in self.readers[label]:
                self.maker.runner.prepare(self.graph.nodes[reader].step)
            return
        if isinstance(message, BaseException):
            raise message
        self.running.remove(label)
        self.free += self._need(label)
        self.declared_mb -= self._memory_mb(label)
        if message == "lost":
            self.losses[label] += 1
            if self.losses[label] <= HEALING_ROUNDS:
                self._look_again(label)
                return
            error = StepError(f"the store keeps losing what step `{label}` reads")
            message = NodeResult(label=label, status="failed", error=error)
        if label not in self.results or message.status != "cached":  # else it was looked for again
            self._finish(message)
        if message.status == "failed":
            self.stopping = self.stopping or not self.keep_going
            step = type(self.graph.nodes[label].step)
            if step.all_told:
                self.reported.add(step)
            for reader in _reached(label, self.readers):
                if reader not in self.results:
                    self._block(reader, f"`{label}` failed")
            return
        for reader in self.readers[label]:
            self.waiting.get(reader, set()).discard(label)

    def _look_again(self, label: str) -> None:
        """What the node reads was lost: whatever lies before it is looked for, or made, again."""
        for each in (label, *_reached(label, self.makers)):
            if each not in self.running:
                self.waiting.setdefault(each, set(self.makers[each]))

    def _block(self, label: str, reason: str) -> None:
        self._finish(NodeResult(label=label, status="blocked", reason=reason))

    def _finish(self, result: NodeResult) -> None:
        self.results[result.label] = result
        self._say("finished", result.label, result)

    def _say(
        self,
        kind: Literal["started", "finished"],
        label: str,
        result: NodeResult | None = None,
    ) -> None:
        done, total = len(self.results), len(self.graph.nodes)
        self.report(Event(kind, done, total, label, result, self.whole))


def _reached(label: str, edges: Mapping[str, Sequence[str]]) -> dict[str, None]:
    """All nodes that edges lead to from this one, and so on; each once."""
    nodes: dict[str, None] = {}
    waiting = list(edges[label])
    while waiting:
        each = waiting.pop()
        if each not in nodes:
            nodes[each] = None
            waiting += edges[each]
    return nodes
