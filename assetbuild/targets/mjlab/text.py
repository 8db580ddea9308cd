"""Python text: literals of the generated module."""

from __future__ import annotations

import re


def literal(value: str) -> str:
    """A string literal: raw where a backslash would need two."""
    if "\\" in value and not value.endswith("\\") and '"' not in value and "\n" not in value:
        return f'r"{value}"'
    escaped = repr(value)
    return f'"{escaped[1:-1]}"' if escaped[0] == "'" and '"' not in value else escaped


def tuple_of(values: tuple[str, ...]) -> str:
    """A tuple of strings, a line for each."""
    if not values:
        return "()"
    inner = "".join(f"\n    {literal(value)}," for value in values)
    return f"({inner}\n)"


def dict_of(values: dict[str, float], indent: int = 0, *, escape: bool = False) -> str:
    """A dict of numbers; escape: its keys are regular expressions that match these names."""
    if not values:
        return "{}"
    pad = " " * (indent + 4)
    inner = "".join(
        f"\n{pad}{literal(re.escape(name) if escape else name)}: {value!r},"
        for name, value in values.items()
    )
    return f"{{{inner}\n{' ' * indent}}}"


def exactly(name: str) -> str:
    """A literal of the regular expression that matches this name alone."""
    return literal(re.escape(name))
