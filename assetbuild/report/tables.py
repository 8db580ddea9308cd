"""A table as data, and written as Markdown."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

Record = Mapping[str, object]
"""Column -> value."""


@dataclass(frozen=True)
class Table:
    """Rows of plain values. note: a sentence above the table; empty: what to say without rows."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...]
    note: str = ""
    empty: str = "None."

    @cached_property
    def numbers(self) -> tuple[bool, ...]:
        """Tell of each column whether it holds only numbers, which are aligned to the right."""
        return tuple(map(_all_numbers, zip(*self.rows, strict=True)))


def _all_numbers(values: Iterable[object]) -> bool:
    stated = [value for value in values if value not in (None, "")]
    numbers = (isinstance(v, int | float) and not isinstance(v, bool) for v in stated)
    return bool(stated) and all(numbers)


def table(
    title: str, head: Iterable[str], rows: Iterable[Sequence[object]], note: str = "", **more: str
) -> Table:
    """A table from any sequences."""
    return Table(title, tuple(head), tuple(tuple(row) for row in rows), note, **more)


def records(title: str, rows: Iterable[Record], note: str = "") -> Table:
    """A table of rows that name their own columns."""
    every = list(rows)
    head = dict.fromkeys(key for row in every for key in row)
    return table(title, tuple(head), [[row.get(key) for key in head] for row in every], note)


def text_of(value: object) -> str:
    """A number with four digits, a list with commas, nothing as a dash."""
    if value is None or value == "":
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return _number(value)
    if isinstance(value, tuple | list):
        return ", ".join(text_of(item) for item in value) or "-"
    return str(value)


def _number(value: float) -> str:
    """Four digits; what rounding left of zero is `about 0`."""
    if not math.isfinite(value):
        return str(value)
    if 0.0 < abs(value) < 1e-13:
        return "about 0"
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e7 else f"{value:.4g}"


def markdown_table(shown: Table) -> str:
    """GitHub's tables."""
    if not shown.rows:
        return shown.empty
    lines = ["| " + " | ".join(shown.head) + " |", "|" + " --- |" * len(shown.head)]
    lines += ["| " + " | ".join(_cell(cell) for cell in row) + " |" for row in shown.rows]
    return "\n".join([*([shown.note, ""] if shown.note else []), *lines])


def text_table(shown: Table) -> str:
    """Columns for a terminal below their title."""
    cells = [shown.head, *(tuple(map(text_of, row)) for row in shown.rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    sides = [">" if is_number else "<" for is_number in shown.numbers] or ["<"] * len(widths)
    lines = [": ".join(filter(None, (shown.title, shown.note)))]
    for row in cells:
        columns = zip(row, sides, widths, strict=True)
        lines.append("  ".join(f"{cell:{side}{width}}" for cell, side, width in columns).rstrip())
    return "\n".join(lines if lines[0] else lines[1:])


def _cell(value: object) -> str:
    return " ".join(text_of(value).replace("|", "\\|").split())
