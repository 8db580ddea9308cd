"""Mutations of JSON and YAML: every leaf, every key, every item."""

from __future__ import annotations

import copy
import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from tests.mutations.change import Mutation, is_same, number_changes, other_text, pools

Plain = Any  # plain data of a JSON or YAML file
BIG = 40
"""Items of a longer list are drawn, not walked."""
NAMED = {"links", "joints", "shapes", "friction"}
"""Tables of dr.yaml whose keys are the robot's own names."""


def load(path: Path) -> Plain:
    """The value of a JSON or YAML file."""
    text = path.read_text(encoding="utf-8")
    return json.loads(text) if path.suffix == ".json" else yaml.safe_load(text)


def save(path: Path, value: Plain) -> None:
    """Writes it in the same language."""
    plain = path.suffix == ".json"
    text = json.dumps(value) if plain else yaml.safe_dump(value, sort_keys=False)
    path.write_text(text, encoding="utf-8")


def walk(path: Path, file: str, random_: random.Random) -> Iterator[Mutation]:
    """All mutations of one file."""
    whole = load(path)
    leaves = [(_label(place), value) for place, value in _values(whole, ())]
    texts = pools([(label, value) for label, value in leaves if isinstance(value, str)])
    for place, value in _values(whole, ()):
        label, where = _label(place), ".".join(map(str, place))
        for what, new in _changes(value, texts.get(label, []), random_):
            shown = _short(value), _short(new)
            yield Mutation(file, where, label, what, *shown, ("set", place, new))
        if place:
            deleted = ("delete", place, None)
            yield Mutation(file, where, label, "deleted", _short(value), "", deleted)
        if place and isinstance(place[-1], int):
            twice = ("double", place, None)
            yield Mutation(file, where, label, "duplicated", _short(value), "", twice)


def _values(
    value: Plain, place: tuple[str | int, ...]
) -> Iterator[tuple[tuple[str | int, ...], Plain]]:
    yield place, value
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _values(part, (*place, key))
    elif isinstance(value, list):
        for index, part in enumerate(value):
            yield from _values(part, (*place, index))


def _changes(value: Plain, pool: list[str], random_: random.Random) -> Iterator[tuple[str, Plain]]:
    if isinstance(value, bool):
        yield "flipped", not value
    elif isinstance(value, int | float):
        yield from number_changes(value).items()
    elif isinstance(value, str):
        yield "another text", other_text(value, pool, random_)
    elif value is None:
        yield "stated", 1.0
    elif isinstance(value, list) and len(value) > 1:
        last = next((i for i, v in enumerate(value) if not _equal(v, value[0])), 0)
        if last and all(isinstance(v, int | float | str) for v in value):
            new = list(value)
            new[0], new[last] = new[last], new[0]
            yield "swapped", new


def _equal(one: Plain, two: Plain) -> bool:
    numbers = isinstance(one, int | float) and isinstance(two, int | float)
    return is_same(one, two) if numbers else bool(one == two)


def apply(path: Path, key: tuple[object, ...]) -> None:
    """Makes the change of a mutation's key in the file."""
    whole = load(path)
    what, place, new = key
    assert isinstance(place, tuple)
    if not place:
        save(path, new)
        return
    around = whole
    for step in place[:-1]:
        around = around[step]
    if what == "set":
        around[place[-1]] = new
    elif what == "delete":
        del around[place[-1]]
    else:
        around.insert(place[-1], copy.deepcopy(around[place[-1]]))
    save(path, whole)


def _label(place: tuple[str | int, ...]) -> str:
    """`links.*.mass.range`: without numbers of items and names of the robot."""
    words: list[str] = []
    for number, step in enumerate(place):
        if isinstance(step, int):
            continue
        words.append("*" if number == 1 and place[0] in NAMED else str(step))
    return ".".join(words)


def _short(value: Plain) -> str:
    return json.dumps(value, default=str)[:200]
