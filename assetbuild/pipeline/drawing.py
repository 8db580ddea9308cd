"""The graph of a build as text, and in networkx: what depends on what, drawn, for other tools.

networkx is imported when somebody asks; a build never does.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape  # only written

from assetbuild.engine.graph import Graph

LETTER, ROW, BOX, BETWEEN, MARGIN = 7.0, 34.0, 22.0, 60.0, 16.0
"""Pixels of the picture: width of a letter, height of a row and of a box, between two columns."""
PLAIN, MARKED = "#eef4fb", "#ffd9a0"
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
    """One line per step in the order of building: its label and what it reads."""
    lines = []
    for node in graph.nodes.values():
        reads = ", ".join(str(ref) for _, ref in sorted(node.inputs.items()))
        lines.append(f"{node.label} <- {reads}" if reads else node.label)
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


def to_svg(net: Any, marked: Collection[str] = ()) -> str:  # Any: a graph of networkx
    """A picture: what a step reads stands to its left. Sources have dashed boxes."""
    import networkx

    columns = _ordered([list(column) for column in networkx.topological_generations(net)], net)
    boxes: dict[str, tuple[float, float, float]] = {}  # left, middle, width
    left = MARGIN
    for column in columns:
        width = LETTER * max(len(label) for label in column) + 2 * LETTER
        for row, label in enumerate(column):
            boxes[label] = (left, MARGIN + ROW * (row + 0.5), width)
        left += width + BETWEEN
    height = 2 * MARGIN + ROW * max((len(column) for column in columns), default=0)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {left:g} {height:g}" '
        'font-family="monospace" font-size="11.5">',
        f'<rect width="{left:g}" height="{height:g}" fill="white"/>',
    ]
    lines += [_arrow(boxes[maker], boxes[reader]) for maker, reader in dict.fromkeys(net.edges())]
    lines += [_box(label, net.nodes[label], boxes[label], label in marked) for label in boxes]
    return "\n".join([*lines, "</svg>"])


def _ordered(columns: list[list[str]], net: Any) -> list[list[str]]:  # Any: a graph of networkx
    """Each column from top to bottom as what it reads: few edges cross then."""
    rows: dict[str, float] = {}
    for column in columns:
        wanted = {}
        for label in column:
            read = [rows[maker] for maker in net.predecessors(label)]
            wanted[label] = (sum(read) / max(1, len(read)), label)
        column.sort(key=wanted.__getitem__)
        rows |= {label: (row + 0.5) / len(column) for row, label in enumerate(column)}
    return columns


def _arrow(maker: tuple[float, float, float], reader: tuple[float, float, float]) -> str:
    (left, y, width), (x2, y2, _) = maker, reader
    x, bend = left + width, BETWEEN / 2
    path = f"M{x:g} {y:g}C{x + bend:g} {y:g} {x2 - bend:g} {y2:g} {x2:g} {y2:g}"
    return f'<path d="{path}" fill="none" stroke="#8899aa"/>'


def _box(
    label: str,
    node: Mapping[str, Any],  # Any: attributes of networkx
    box: tuple[float, float, float],
    marked: bool,
) -> str:
    left, middle, width = box
    is_source = node["kind"] == "source"
    dashes = ' stroke-dasharray="4 3"' if is_source else ""
    fill = "white" if is_source else MARKED if marked else PLAIN
    told = "source" if is_source else f"{node['step']}, {node['seconds']:.1f} s"
    return (
        f'<g><title>{escape(told)}</title><rect x="{left:g}" y="{middle - BOX / 2:g}" '
        f'width="{width:g}" height="{BOX:g}" rx="4" fill="{fill}" stroke="#556677"{dashes}/>'
        f'<text x="{left + LETTER:g}" y="{middle + 4:g}">{escape(label)}</text></g>'
    )
