"""Why a step ran or would run: the part of its key that changed, by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

from assetbuild.engine.actions import Action, Parts, made_from_json, missing_output
from assetbuild.engine.graph import Graph
from assetbuild.engine.journal import Change
from assetbuild.engine.session import Resolver, Session

SHOWN_CHANGES = 12
NAMED_PARTS = {
    "code": "code",
    "library": "libraries",
    "kernel": "kernels",
    "field": "fields",
    "input": "inputs",
}
"""Kind of change -> the part of a key that it is in, by name."""
State = Literal["up to date", "would run", "waits"]


def changes_between(old: Parts | None, new: Parts) -> tuple[Change, ...]:
    """What differs between two keys, by part and name; `first` when there is no old one."""
    if old is None:
        return (Change("first"),)
    return tuple(_changes(old, new))


def _changes(old: Parts, new: Parts) -> Iterator[Change]:
    if old.get("step") != new.get("step"):
        yield Change("step", "", old.get("step"), new.get("step"))
    for part, key in NAMED_PARTS.items():
        before, after = dict(_leaves(old.get(key))), dict(_leaves(new.get(key)))
        for name in sorted(before.keys() | after.keys()):
            if before.get(name) != after.get(name):
                yield Change(part, name, before.get(name), after.get(name))
    for part in ("outputs", "python", "platform", "format"):
        if old.get(part) != new.get(part):
            yield Change(part, "", old.get(part), new.get(part))
    if old.get("order") != new.get("order") and old.get("fields") == new.get("fields"):
        yield Change("order")


def _leaves(value: object, path: str = "") -> Iterator[tuple[str, object]]:
    """Leaves of nested data by their path, `actuators[2].kp`."""
    if isinstance(value, dict) and value:
        for key, item in value.items():
            yield from _leaves(item, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list) and value:
        for index, item in enumerate(value):
            yield from _leaves(item, f"{path}[{index}]")
    elif path:
        yield path, value


def changes_text(changes: tuple[Change, ...]) -> str:
    """All changes in one line; the tail of a long list is counted, not shown."""
    shown = [str(change) for change in changes[:SHOWN_CHANGES]]
    if len(changes) > SHOWN_CHANGES:
        shown.append(f"and {len(changes) - SHOWN_CHANGES} more")
    return "; ".join(shown)


def why_it_runs(session: Session, action: Action) -> tuple[Change, ...]:
    """Why what the action makes is not simply taken from the store."""
    changes = changes_between(session.journal.noted(action.label).parts, action.parts)
    if changes and changes[0].part != "first":
        return changes
    made = made_from_json(session.store.action(action.key))
    if made is not None:
        lost = missing_output(session.store, made) or ", ".join(made.outputs)
        return (Change("lost", lost),)
    return changes or (Change("forgotten"),)


@dataclass(frozen=True)
class Explanation:
    """Why one node would run now, and why it last ran.

    changes: since it was last seen; empty when up to date. last_changes: why it ran `last_at`.
    causes: input name -> the node that makes the changed input.
    waits_for: nodes that must be built before more can be said.
    """

    label: str
    state: State
    changes: tuple[Change, ...] = ()
    last_at: str = ""
    last_changes: tuple[Change, ...] = ()
    causes: Mapping[str, str] = field(default_factory=dict)
    waits_for: tuple[str, ...] = ()

    @property
    def only_first(self) -> bool:
        """Whether it has run for no other reason than that it had never run, if at all."""
        return all(change.part == "first" for change in self.last_changes)

    def to_json(self) -> dict[str, object]:
        """Plain data for `explain --json`."""
        return {
            "label": self.label,
            "state": self.state,
            "changes": [c.to_json() for c in self.changes],
            "last_run": self.last_at or None,
            "last_changes": [c.to_json() for c in self.last_changes],
            "causes": dict(self.causes),
            "waits_for": list(self.waits_for),
        }

    def to_text(self) -> str:
        """A few lines for a terminal."""
        lines = [f"{self.label}: {self.state}"]
        for change in self.changes[:SHOWN_CHANGES]:
            maker = self._maker(change)
            lines.append(f"  {change}, made by `{maker}`" if maker else f"  {change}")
        lines += [f"  after `{label}`, which would run first" for label in self.waits_for]
        if self.last_at:
            lines.append(f"  last ran {self.last_at}: {changes_text(self.last_changes)}")
            made = [(change.name, self._maker(change)) for change in self.last_changes]
            lines += [f"    {name} comes from `{maker}`" for name, maker in made if maker]
        return "\n".join(lines)

    def _maker(self, change: Change) -> str:
        return self.causes.get(change.name, "") if change.part == "input" else ""


def explain(graph: Graph, session: Session, label: str) -> Explanation:
    """Why the node would run now, and why it last ran. KeyError on an unknown label."""
    node = graph.nodes[label]
    resolver = Resolver(graph.nodes, session)
    action = resolver.action(label)
    last = session.journal.noted(label)
    changes: tuple[Change, ...] = ()
    waits: tuple[str, ...] = ()
    if action is None:
        state: State = "waits"
        waits = tuple(p for p in graph.predecessors(label) if resolver.made(p) is None)
    elif resolver.made(label) is not None:
        state = "up to date"
    else:
        state = "would run"
        changes = why_it_runs(session, action)
    return Explanation(
        label=label,
        state=state,
        changes=changes,
        last_at=last.at,
        last_changes=last.why,
        causes={name: ref.node for name, ref in node.inputs.items() if ref.node},
        waits_for=waits,
    )
