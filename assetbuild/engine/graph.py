"""The graph of a build: nodes are labelled steps, edges are references to outputs.

A `Planner` collects nodes and answers questions about what is built already; a `Graph` is
the checked result. Nothing mutates a graph: when an answer allows more nodes, one plans again.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import TYPE_CHECKING

from assetbuild.engine.step import Step
from assetbuild.engine.store import Listing, LostObjectError, is_plain_path
from assetbuild.errors import did_you_mean

if TYPE_CHECKING:
    from assetbuild.engine.session import Session


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
    """Checked nodes by label, each after the nodes it reads."""

    nodes: Mapping[str, Node]
    sources: tuple[Ref, ...] = ()

    def predecessors(self, label: str) -> tuple[str, ...]:
        """Labels of the nodes whose outputs this node reads, sorted."""
        return tuple(sorted({r.node for r in self.nodes[label].inputs.values() if r.node}))

    def to_json(self) -> dict[str, object]:
        """The graph as plain data, for `plan --json`."""
        return {
            "nodes": [
                {
                    "label": node.label,
                    "step": node.step.step_name(),
                    "version": node.step.version,
                    "outputs": list(node.step.outputs),
                    "inputs": {name: str(ref) for name, ref in sorted(node.inputs.items())},
                }
                for node in self.nodes.values()
            ]
        }

    def to_text(self) -> str:
        """One line per node in the order of building: its label and what it reads."""
        lines = []
        for node in self.nodes.values():
            reads = ", ".join(str(ref) for _, ref in sorted(node.inputs.items()))
            lines.append(f"{node.label} <- {reads}" if reads else node.label)
        return "\n".join(lines)

    def to_dot(self) -> str:
        """The graph for Graphviz; sources are boxes."""
        lines = ["digraph assetbuild {", "  rankdir=LR;"]
        shown: set[str] = set()
        for node in self.nodes.values():
            lines.append(f"  {json.dumps(node.label)};")
            for name, ref in sorted(node.inputs.items()):
                origin = ref.node or Path(ref.output).name
                if not ref.node and origin not in shown:
                    shown.add(origin)
                    lines.append(f"  {json.dumps(origin)} [shape=box];")
                edge = f"{json.dumps(origin)} -> {json.dumps(node.label)}"
                lines.append(f"  {edge} [label={json.dumps(name)}];")
        return "\n".join([*lines, "}"])


def checked_graph(nodes: Iterable[Node], sources: Iterable[Ref] = ()) -> Graph:
    """Order the nodes; GraphError on duplicate labels, unknown steps or outputs, and cycles."""
    by_label: dict[str, Node] = {}
    for node in nodes:
        if node.label in by_label:
            raise GraphError(f"two steps are labelled `{node.label}`")
        by_label[node.label] = node
    for node in by_label.values():
        _check_inputs(node, by_label)
    return Graph(_in_order(by_label), tuple(sources))


def joined(graphs: Mapping[str, Graph]) -> Graph:
    """Several graphs as one: `calf` of the graph `go1` is labelled `go1:calf`.

    Steps with equal keys run once, whichever graphs they come from.
    """
    nodes: dict[str, Node] = {}
    for name, graph in graphs.items():
        for node in graph.nodes.values():
            inputs = {
                key: Ref(f"{name}:{ref.node}", ref.output, ref.member) if ref.node else ref
                for key, ref in node.inputs.items()
            }
            nodes[f"{name}:{node.label}"] = Node(f"{name}:{node.label}", node.step, inputs)
    return Graph(nodes, tuple(ref for graph in graphs.values() for ref in graph.sources))


def _in_order(by_label: Mapping[str, Node]) -> dict[str, Node]:
    # Of the standard library: networkx alone would cost every build a tenth of a second.
    makers = {
        label: dict.fromkeys(ref.node for ref in node.inputs.values() if ref.node)
        for label, node in by_label.items()
    }
    try:
        order = list(TopologicalSorter(makers).static_order())
    except CycleError as error:
        circle = error.args[1]
        raise GraphError(f"steps need each other: {' -> '.join(circle)}") from None
    return {label: by_label[label] for label in order}


def _check_inputs(node: Node, by_label: Mapping[str, Node]) -> None:
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


def _holds_set(value: object) -> bool:
    if isinstance(value, dict):
        return any(map(_holds_set, value.values()))
    if isinstance(value, list | tuple):
        return any(map(_holds_set, value))
    return isinstance(value, set | frozenset)


class Planner:
    """Collects nodes; answers what the store knows already.

    questions: references that `ask` could not answer yet: build, then plan again.
    """

    def __init__(self, session: Session) -> None:
        from assetbuild.engine.session import Resolver

        self.session = session
        self.questions: list[Ref] = []
        self._nodes: dict[str, Node] = {}
        self._sources: dict[Ref, None] = {}
        self._resolver = Resolver(self._nodes, session)
        self._scope = ""

    def scoped(self, scope: str) -> Planner:
        """The same plan for one part of it: labels of the nodes it adds begin with `scope`."""
        part = copy.copy(self)
        part._scope = self._scope + scope
        return part

    def source(self, path: Path) -> Ref:
        """A file outside the store. SourceError when it cannot be read."""
        self.session.source_digest(path)
        return self._remember(Ref("", str(path.absolute())))

    def source_tree(self, folder: Path, members: Iterable[str]) -> Ref:
        """Named files below a folder outside the store, as one folder. SourceError."""
        return self._remember(Ref("", self.session.source_tree(folder, members)))

    def _remember(self, ref: Ref) -> Ref:
        self._sources[ref] = None
        return ref

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
        _check_inputs(node, self._nodes)
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

    def ask_tree(self, ref: Ref) -> Listing | None:
        """The members of a folder: relative path -> (digest, size in bytes), or None."""
        digest = self._resolver.digest(ref)
        if digest is not None:
            try:
                return self.session.tree(digest)
            except LostObjectError:
                self.session.forget()
        self.questions.append(ref)
        return None

    def graph(self) -> Graph:
        """The checked graph of what was added so far."""
        return checked_graph(self._nodes.values(), self._sources)
