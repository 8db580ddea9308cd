"""Planning: nodes are collected, and questions answered from what the store knows already."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path

from assetbuild.engine.graph import Graph, GraphError, Node, Ref, check_inputs, checked_graph
from assetbuild.engine.resolver import Resolver
from assetbuild.engine.session import Session
from assetbuild.engine.step import Step
from assetbuild.engine.store import LostObjectError


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
        self.world.digest(path)
        ref = Ref("", str(path.absolute()))
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
        """The checked graph of what was added so far."""
        return checked_graph(self._nodes.values(), self._sources)


def _holds_set(value: object) -> bool:
    if isinstance(value, dict):
        return any(map(_holds_set, value.values()))
    if isinstance(value, list | tuple):
        return any(map(_holds_set, value))
    return isinstance(value, set | frozenset)
