"""Actions and digests of the nodes of a graph, as far as the store can tell them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from assetbuild.engine.actions import Action, Made
from assetbuild.engine.graph import Node, Ref
from assetbuild.engine.keys import key_parts
from assetbuild.engine.session import Session
from assetbuild.engine.store import LostObjectError
from assetbuild.errors import StepError, did_you_mean


class Resolver:
    """Actions and digests of nodes, as far as they are known. The nodes may grow meanwhile."""

    def __init__(self, nodes: Mapping[str, Node], session: Session) -> None:
        self._nodes = nodes
        self._session = session
        self._actions: dict[str, Action] = {}

    def action(self, label: str) -> Action | None:
        """The node on its inputs; None while one of them is not known. StepError."""
        if label not in self._actions:
            node = self._nodes[label]
            inputs: dict[str, str] = {}
            for name, ref in node.inputs.items():
                digest = self.digest(ref)
                if digest is None:
                    return None
                inputs[name] = digest
            parts = key_parts(node.step, inputs, self._session.code)
            self._actions[label] = Action.of(label, node.step, parts)
        return self._actions[label]

    def made(self, label: str) -> Made | None:
        """What the node made, if it was built with its present key. StepError."""
        action = self.action(label)
        made = None if action is None else self._session.actions.known(action.key)
        if made is not None and set(made.outputs) != set(self._nodes[label].step.outputs):
            return None  # a foreign action entry
        return made

    def digest(self, ref: Ref) -> str | None:
        """Digest of a reference; None while it is not built. StepError on an unknown member."""
        if not ref.node:
            whole = self._session.world.digest(Path(ref.output))
        else:
            made = self.made(ref.node)
            if made is None:
                return None
            whole = made.outputs[ref.output]
        return self._member(ref, whole) if ref.member else whole

    def _member(self, ref: Ref, whole: str) -> str | None:
        try:
            listing = self._session.tree(whole)
        except LostObjectError:
            self._session.forget()
            return None
        if ref.member.endswith("/"):
            size = len(ref.member)
            below = {n[size:]: v for n, v in listing.items() if n.startswith(ref.member)}
            if below:
                return self._session.store.put_listing(below)
        elif ref.member in listing:
            return listing[ref.member][0]
        origin = f"step `{ref.node}`" if ref.node else "the source"
        raise StepError(
            f"{origin} has no `{ref.member}` in `{ref.output}`",
            hint=did_you_mean(ref.member, listing),
        )
