"""Words of a recipe: YAML scalars, flow maps, lists and comments."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from assetbuild.init.about import stated_about
from assetbuild.init.licence import licence_lines

WIDTH = 100
"""Characters in a line of a recipe."""


def written(*sections: Iterable[str]) -> str:
    """The recipe of the lines of its sections; one without lines is left out."""
    blocks = ["\n".join(section) for section in sections]
    return "\n\n".join(block for block in blocks if block) + "\n"


def source_section(root: Path, recipe: Path, key: str, file: str, *more: str) -> Iterator[str]:
    """The sections `source:` and `about:` of a recipe that will lie at `recipe`; more: lines."""
    relative = os.path.relpath(root, os.path.realpath(recipe.parent))
    yield "source:"
    yield f"  path: {quoted(Path(relative).as_posix())}   # relative to this file"
    yield f"  {key}: {quoted(file)}"
    yield from more
    yield from licence_lines(root, file)
    if about := stated_about(root, file):
        yield "about:   # as package.xml says"
        yield from (f"  {key}: {quoted(text)}" for key, text in about.items())


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


def inline(value: object) -> str:
    """A value in YAML's flow style; numbers keep all their digits."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{inline(k)}: {inline(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(inline, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return quoted(value) if isinstance(value, str) else repr(value)


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
