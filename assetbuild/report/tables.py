"""A table as data, written as Markdown or as HTML."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape

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


def _cell(value: object) -> str:
    return " ".join(text_of(value).replace("|", "\\|").split())


def html_table(shown: Table) -> str:
    """With a caption for screen readers; numbers to the right; wide ones scroll by themselves."""
    if not shown.rows:
        return f"<p>{escape(shown.empty)}</p>"
    styles = [_column_style(column) for column in zip(*shown.rows, strict=True)]
    head = "".join(
        f'<th scope="col"{style}>{escape(text)}</th>'
        for text, style in zip(shown.head, styles, strict=True)
    )
    rows = "".join(f"<tr>{''.join(map(_html_cell, row, styles))}</tr>" for row in shown.rows)
    note = f"<caption>{escape(shown.note)}</caption>" if shown.note else ""
    # A part that scrolls must be reachable by the keyboard.
    return (
        f'<div class="scroll" tabindex="0" role="group" aria-label="{escape(shown.title)}">'
        f"<table>{note}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>"
    )


def _column_style(values: Sequence[object]) -> str:
    """A column of numbers stands to the right; one where some happen to be numbers does not."""
    told = [value for value in values if value not in (None, "")]
    numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in told)
    return ' class="number"' if told and numbers else ""


def _html_cell(value: object, style: str) -> str:
    text = text_of(value)
    if text in ("pass", "fail", "skip", "error", "warning"):
        style = f' class="{text}"'
    return f"<td{style}>{escape(text)}</td>"
