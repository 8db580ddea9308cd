"""Words of a recipe: YAML scalars, lists and comments."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence

WIDTH = 100
"""Characters in a line of a recipe."""


def flow(head: str, items: Sequence[str], tail: str) -> list[str]:
    """A flow list, broken into lines below its key."""
    one = head + ", ".join(items) + tail
    if len(one) <= WIDTH:
        return [one]
    indent = " " * (len(head) - len(head.lstrip()) + 2)
    lines, line = [head], indent
    for item in items:
        if len(line) + len(item) > WIDTH and line.strip():
            lines.append(line.rstrip())
            line = indent
        line += item + ", "
    return [*lines, line.rstrip(" ,") + tail]


def quoted(text: str) -> str:
    """JSON's quotes are YAML's, but for characters beyond 16 bits; plain words stay plain."""
    if re.fullmatch(r"[A-Za-z][A-Za-z0-9_./-]*", text) and text.lower() not in _YAML_WORDS:
        return text
    return json.dumps(text, ensure_ascii=not text.isprintable())


_YAML_WORDS = ("y", "n", "yes", "no", "on", "off", "true", "false", "null")


def some(names: Sequence[str]) -> str:
    """At most six names and how many more, for a comment."""
    more = f" and {len(names) - 6} more" if len(names) > 6 else ""
    return plain(", ".join(names[:6]), 200) + more


def plain(text: str, longest: int = 80) -> str:
    """Text for a comment: one line."""
    return " ".join(text.split())[:longest]
