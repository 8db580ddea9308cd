"""What the steps of a graph cost: for the order in which they start, and the time that is left."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from assetbuild.engine.graph import Graph
from assetbuild.engine.journal import Journal


@dataclass(frozen=True)
class Costs:
    """Seconds by label.

    seconds: of the step itself. chains: of the longest chain of steps that begins with it, each of
    which reads the one before. guessed: steps that never ran here.
    """

    seconds: Mapping[str, float] = field(default_factory=dict)
    chains: Mapping[str, float] = field(default_factory=dict)
    guessed: frozenset[str] = frozenset()


def costs(graph: Graph, journal: Journal) -> Costs:
    """Each step as long as it last took here, else as long as such a step usually takes."""
    noted = {label: journal.last_seconds(label) for label in graph.nodes}
    seconds = {
        label: node.step.usual_s if noted[label] is None else float(noted[label] or 0.0)
        for label, node in graph.nodes.items()
    }
    chains = dict(seconds)
    for label in reversed(list(graph.nodes)):  # each after all that read it
        for maker in graph.predecessors(label):
            chains[maker] = max(chains[maker], seconds[maker] + chains[label])
    guessed = frozenset(label for label, last in noted.items() if last is None)
    return Costs(seconds, chains, guessed)
