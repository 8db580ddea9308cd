"""The graph of a build as text, and in networkx: what depends on what, for other tools.

networkx is imported when somebody asks; a build never does.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from assetbuild.engine.graph import Graph

MARKED = "#ffd9a0"
START = ""
"""Before all steps; no step has an empty label."""


def to_data(graph: Graph) -> dict[str, object]:
    """The steps in the order of building, as plain data."""
    return {
        "nodes": [
            {
                "label": node.label,
                "step": node.step.step_name(),
                "outputs": list(node.step.outputs),
                "inputs": {name: str(ref) for name, ref in sorted(node.inputs.items())},
            }
            for node in graph.nodes.values()
        ]
    }


def to_text(graph: Graph) -> str:
    """The rooms of the house in the order of building, each with its steps."""
    rooms: dict[str, list[str]] = {}
    for node in graph.nodes.values():
        room = type(node.step).__module__.removeprefix("assetbuild.").partition(".")[0]
        rooms.setdefault(room, []).append(node.label)
    lines = []
    for room, labels in rooms.items():
        lines.append(f"{room}: {len(labels)} step{'s' if len(labels) > 1 else ''}")
        lines += [f"  {label}" for label in labels]
    return "\n".join(lines)


def network(graph: Graph, seconds: Mapping[str, float]) -> Any:  # Any: networkx has no types
    """Steps and sources by name, an edge for each input.

    seconds: of steps by label, when they last ran; absent = not known.
    """
    import networkx

    net = networkx.MultiDiGraph()
    for label, node in graph.nodes.items():
        net.add_node(
            label, kind="step", step=node.step.step_name(), seconds=seconds.get(label, 0.0)
        )
        for name, ref in sorted(node.inputs.items()):
            origin = ref.node or Path(ref.output).name
            if not ref.node:
                net.add_node(origin, kind="source", step="", seconds=0.0)
            net.add_edge(origin, label, input=name)
    return net


def behind(net: Any, labels: Iterable[str]) -> frozenset[str]:  # Any: a graph of networkx
    """These steps, and all that read what they make, directly or not."""
    import networkx

    return frozenset().union(*({label} | networkx.descendants(net, label) for label in labels))


def critical_path(net: Any) -> list[str]:  # Any: a graph of networkx
    """The steps, each after what it reads, that take longest one after the other."""
    import networkx

    timed = networkx.DiGraph()
    for label, node in net.nodes(data=True):
        for maker in net.predecessors(label) if net.in_degree(label) else [START]:
            timed.add_edge(maker, label, weight=node["seconds"])
    path = networkx.dag_longest_path(timed)
    return [label for label in path if label != START and net.nodes[label]["kind"] == "step"]


def to_dot(net: Any, marked: Collection[str] = ()) -> str:  # Any: a graph of networkx
    """For Graphviz; sources are boxes, marked steps are filled."""
    lines = ["digraph assetbuild {", "  rankdir=LR;"]
    for label, node in net.nodes(data=True):
        style = " [shape=box]" if node["kind"] == "source" else ""
        style = f' [style=filled, fillcolor="{MARKED}"]' if label in marked else style
        lines.append(f"  {json.dumps(label)}{style};")
    for maker, reader, name in net.edges(data="input"):
        edge = f"{json.dumps(maker)} -> {json.dumps(reader)}"
        lines.append(f"  {edge} [label={json.dumps(name)}];")
    return "\n".join([*lines, "}"])


def to_graphml(net: Any, marked: Collection[str] = ()) -> str:  # Any: a graph of networkx
    """For Gephi, yEd, Cytoscape and the like."""
    import networkx

    networkx.set_node_attributes(net, {label: label in marked for label in net}, "marked")
    return "\n".join(networkx.generate_graphml(net))
