"""Facts and tables of facts: `(kind, name, quantity) -> value`."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

Value = bool | str | float | tuple[float, ...] | tuple[str, ...] | None
"""SI units, radians, quaternions wxyz. None: unlimited, or "no such thing"."""


def plain_value(stated: object) -> Value:
    """What anybody's file states, as a value; as text where no quantity can have it."""
    if isinstance(stated, list | tuple):
        leaves = tuple(plain_value(item) for item in stated)
        is_row = all(isinstance(leaf, bool | str | float) for leaf in leaves)
        return leaves if is_row else str(stated)[:200]  # type: ignore[return-value] # as looked at
    if stated is None or isinstance(stated, bool | str | float):
        return stated
    try:
        return float(stated) if isinstance(stated, int) else str(stated)[:200]
    except OverflowError:
        return "a number too large to be one"


class Key(NamedTuple):
    """What a fact is about: `Key("joint", "FR_hip_joint", "armature")`.

    kind: body, frame, joint, shape, ...: see `vocabulary`. name: the robot's name for the subject.
    quantity: a name of the vocabulary; one with a colon (`mjcf:solmix`) is a word of one format,
    which the vocabulary does not know.
    """

    kind: str
    name: str
    quantity: str

    @property
    def subject(self) -> str:
        """`joint FR_hip_joint`, as findings name it."""
        return f"{self.kind} {self.name}" if self.name else self.kind

    @property
    def is_foreign(self) -> bool:
        """Whether it is a word of one format rather than of the vocabulary."""
        return ":" in self.quantity


def pair_name(one: str, other: str) -> str:
    """The name of a pair as a subject: both names, sorted; one with a space is quoted."""
    return " ".join(
        json.dumps(name, ensure_ascii=False) if re.search(r'[\s"]', name) or not name else name
        for name in sorted((one, other))
    )


def pair_of(name: str) -> tuple[str, str]:
    """The two names behind `pair_name`."""
    words = re.findall(r'"(?:[^"\\]|\\.)*"|[^\s"]+', name)
    one, other = (json.loads(word) if word.startswith('"') else word for word in words)
    return one, other


@dataclass
class Table:
    """Facts by key, in the order in which they were read.

    places: `file:line` or path of a prim by (kind, name), where the reader knows it.

    >>> table = Table()
    >>> table.put("joint", "hip", {"armature": 0.01})
    >>> table.of("joint", "hip")
    {'armature': 0.01}
    """

    facts: dict[Key, Value] = field(default_factory=dict)
    places: dict[tuple[str, str], str] = field(default_factory=dict)

    def put(self, kind: str, name: str, facts: Mapping[str, Value]) -> None:
        """Notes facts of one subject by their quantities."""
        for quantity, value in facts.items():
            self.facts[Key(kind, name, quantity)] = value

    def drop(self, kind: str, name: str, *quantities: str) -> None:
        """Removes facts of one subject, as far as they are there."""
        for quantity in quantities:
            self.facts.pop(Key(kind, name, quantity), None)

    def place(self, kind: str, name: str, where: str) -> None:
        """Notes where a subject stands."""
        self.places[kind, name] = where

    def names(self, kind: str) -> tuple[str, ...]:
        """The names of all subjects of a kind, in order."""
        return tuple(dict.fromkeys(key.name for key in self.facts if key.kind == kind))

    def of(self, kind: str, name: str) -> dict[str, Value]:
        """The facts of one subject by quantity."""
        return {k.quantity: v for k, v in self.facts.items() if (k.kind, k.name) == (kind, name)}

    def only(self, holds: Callable[[Key], bool]) -> Table:
        """The table without the facts that do not satisfy a condition."""
        kept = {key: value for key, value in self.facts.items() if holds(key)}
        return Table(kept, self.places)

    def plain(self) -> Table:
        """The table of a file that may state anything, with every value made plain."""
        return Table({key: plain_value(value) for key, value in self.facts.items()}, self.places)

    def __or__(self, other: Table) -> Table:
        """Both tables; of facts that both have, the other's."""
        return Table({**self.facts, **other.facts}, {**self.places, **other.places})
