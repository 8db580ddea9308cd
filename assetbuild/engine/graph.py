"""The graph of a build: nodes are labelled steps, edges are references to outputs.

Plain data. Each node is checked when it is added to a plan and reads only nodes that were added
before, so there are no cycles. Nothing mutates a graph: when an answer allows more nodes, one plans
again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from assetbuild.engine.step import Step, is_plain_path
from assetbuild.errors import did_you_mean


class GraphError(ValueError):
    """The plan is wrong: a bug in the plan or in a plug-in, not in the user's files."""


@dataclass(frozen=True, slots=True)
class Ref:
    """One output of a node, or a file below an output that is a folder.

    node: label of the node that makes it; empty for a source outside the store.
    output: name of the output; the absolute path of a source. A folder ends in a slash.
    member: path below a folder; ends in a slash when it is a folder itself.
    """

    node: str
    output: str
    member: str = ""

    def __truediv__(self, member: str) -> Ref:
        """`ref / "a/b.dae"`: a file (or, with a slash at its end, a folder) below a folder."""
        if not self.is_tree:
            raise GraphError(f"`{self}` is a file: nothing is below it")
        path = self.member + member
        if not is_plain_path(path.removesuffix("/")):
            raise GraphError(f"`{member}` is not a plain relative path")
        return Ref(self.node, self.output, path)

    @property
    def is_tree(self) -> bool:
        """Does it stand for a folder?"""
        return (self.member or self.output).endswith("/")

    def __str__(self) -> str:
        path = self.output + self.member
        return f"{self.node}:{path}" if self.node else path


@dataclass(frozen=True)
class Node:
    """A step with a label that is unique in its graph, and its inputs by name."""

    label: str
    step: Step
    inputs: Mapping[str, Ref]

    def __getitem__(self, output: str) -> Ref:
        if output not in self.step.outputs:
            hint = did_you_mean(output, self.step.outputs)
            raise GraphError(f"step `{self.label}` has no output `{output}`; {hint}")
        return Ref(self.label, output)


@dataclass(frozen=True)
class Graph:
    """Nodes by label, each after the nodes it reads."""

    nodes: Mapping[str, Node]

    def predecessors(self, label: str) -> tuple[str, ...]:
        """Labels of the nodes whose outputs this node reads, sorted."""
        return tuple(sorted({r.node for r in self.nodes[label].inputs.values() if r.node}))


def joined(graphs: Mapping[str, Graph]) -> Graph:
    """Several graphs as one: `calf` of the graph `go1` is labelled `go1:calf`; one stays as it is.

    Steps with equal keys run once, whichever graphs they come from.
    """
    if len(graphs) == 1:
        return next(iter(graphs.values()))
    nodes: dict[str, Node] = {}
    for name, graph in graphs.items():
        for node in graph.nodes.values():
            inputs = {
                key: Ref(f"{name}:{ref.node}", ref.output, ref.member) if ref.node else ref
                for key, ref in node.inputs.items()
            }
            nodes[f"{name}:{node.label}"] = Node(f"{name}:{node.label}", node.step, inputs)
    return Graph(nodes)


def check_inputs(node: Node, by_label: Mapping[str, Node]) -> None:
    """GraphError when an input has no proper name, or reads what no node makes."""
    taken: set[str] = set()
    for name, ref in sorted(node.inputs.items()):
        if not is_plain_path(name.removesuffix("/")):
            raise GraphError(f"step `{node.label}`: `{name}` is no name for an input")
        if name.endswith("/") != ref.is_tree:
            kind = "a folder" if ref.is_tree else "a file"
            raise GraphError(f"step `{node.label}`: input `{name}` is {kind}: `{ref}`")
        parts = name.removesuffix("/").split("/")
        if any("/".join(parts[:n]) in taken for n in range(1, len(parts) + 1)):
            raise GraphError(f"step `{node.label}`: input `{name}` lies inside another input")
        taken.add("/".join(parts))
        if ref.node:
            maker = by_label.get(ref.node)
            if maker is None:
                hint = did_you_mean(ref.node, by_label)
                raise GraphError(f"step `{node.label}` reads `{ref}`: no such step; {hint}")
            maker[ref.output]  # refuses an unknown output
