"""Python text: literals of the generated module."""

from __future__ import annotations

import re
from collections.abc import Iterable


def literal(value: str) -> str:
    """A string literal: raw where a backslash would need two."""
    if "\\" in value and not value.endswith("\\") and '"' not in value and "\n" not in value:
        return f'r"{value}"'
    escaped = repr(value)
    return f'"{escaped[1:-1]}"' if escaped[0] == "'" and '"' not in value else escaped


def block(head: str, items: Iterable[str], indent: int = 0, brackets: str = "()") -> str:
    """`head(` ... `)` on a line indented by so many spaces, with a line for each item."""
    pad = "\n" + " " * indent
    lines = "".join(f"{pad}    {item}," for item in items)
    return f"{head}{brackets[0]}{lines}{pad if lines else ''}{brackets[1]}"


def exactly(name: str) -> str:
    """A literal of the regular expression that matches this name alone."""
    return literal(re.escape(name))
