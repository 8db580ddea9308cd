"""The figures of any check as tables: numbers by name, and rows where there are rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TypeGuard

from assetbuild.report.sentences import UNITS
from assetbuild.report.tables import Record, Table, table, text_of
from assetbuild.report.verdict import CheckResult

FIRST = (
    *("", "rank", "row", "of", "name", "robot", "link", "body", "joint", "pair", "a", "b"),
    *("mujoco", "physx", "off", "unit"),
)
"""Columns that stand first in a table, in this order."""


def figures_of(name: str, check: CheckResult) -> Iterator[Table]:
    """All figures of a check: first its plain numbers, then a table or several for each other."""
    figures = dict(sorted(check.figures.items()))
    plain = {k: v for k, v in figures.items() if not (isinstance(v, Mapping) or _is_list(v))}
    if rows := [(words(key), value) for key, value in plain.items() if value is not None]:
        yield table(f"figures of {name}", ("figure", "value"), rows)
    for key, value in figures.items():
        if key not in plain and value not in ([], {}):
            yield from tables_of(key, value)


def tables_of(name: str, value: object) -> Iterator[Table]:
    """Rows of mappings, a mapping of mappings, a mapping of numbers, a plain list: as tables."""
    title = words(name)
    if isinstance(value, Mapping) and value:
        if all(isinstance(v, Mapping) for v in value.values()):
            yield _of_rows(title, [{"name": key, **row} for key, row in value.items()])
        elif any(isinstance(v, Mapping) or _is_rows(v) for v in value.values()):
            for key, inner in value.items():
                yield from tables_of(f"{name}: {key}", inner)
        else:
            yield table(title, ("name", "value"), [(k, _flat(v)) for k, v in value.items()])
    elif _is_rows(value):
        yield _of_rows(title, value)
    elif _is_list(value):
        lists = [v if _is_list(v) else [v] for v in value]
        width = max(map(len, lists), default=1)
        rows = [(*map(_flat, row), *[""] * (width - len(row))) for row in lists]
        head = ("value",) if width == 1 else [f"value {n + 1}" for n in range(width)]
        yield table(title, head, rows)
    else:
        yield table(title, ("value",), [(_flat(value),)])


def _is_list(value: object) -> TypeGuard[Sequence[object]]:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _is_rows(value: object) -> TypeGuard[Sequence[Record]]:
    return _is_list(value) and bool(value) and all(isinstance(row, Mapping) for row in value)


def _of_rows(title: str, rows: Sequence[Record]) -> Table:
    """What names a row stands first, whatever the sorting of the JSON."""
    keys = dict.fromkeys(key for row in rows for key in row)
    head = sorted(keys, key=lambda key: FIRST.index(key) if key in FIRST else len(FIRST))
    return table(title, map(words, head), [[_flat(row.get(key)) for key in head] for row in rows])


def _flat(value: object) -> object:
    if isinstance(value, Mapping):
        return ", ".join(f"{words(k)} {text_of(_flat(v))}" for k, v in value.items())
    if isinstance(value, list | tuple):
        return tuple(_flat(v) for v in value)
    return value


def words(key: str) -> str:
    """`max_outside_m` as `max outside, m`."""
    head, _, last = key.rpartition("_")
    if head and last in UNITS:
        return f"{head.replace('_', ' ')}, {UNITS[last]}"
    return key.replace("_", " ")
