"""Words of a recipe: YAML scalars, flow maps, lists, comments, and short patterns for names."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

WIDTH = 100
"""Characters in a line of a recipe."""


@dataclass(frozen=True)
class Proposal:
    """A recipe that is not written yet. path: where it belongs.

    unmended: what keeps its robot from being ready, each with the edit that mends it.
    undecided: that the robot matches nothing known and what to decide, "" for one that does.
    """

    path: Path
    text: str
    unmended: tuple[str, ...] = ()
    undecided: str = ""


def written(*sections: Iterable[str]) -> str:
    """The recipe of the lines of its sections; one without lines is left out."""
    blocks = ["\n".join(section) for section in sections]
    return "\n\n".join(block for block in blocks if block) + "\n"


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


LONGEST = 400
"""Characters; a recipe takes patterns of up to 500."""


def patterns_of(group: Sequence[str], everything: Sequence[str]) -> tuple[str, ...]:
    """Patterns that together match every name of `group` once, and no other of `everything`."""
    if len(group) == 1:
        return (re.escape(group[0]),)
    wanted = set(group)
    for pattern in sorted(_candidates(group), key=lambda text: (len(text), text)):
        matched = {name for name in everything if re.fullmatch(pattern, name)}
        if len(pattern) <= LONGEST and matched == wanted:
            return (pattern,)
    half = len(group) // 2
    return patterns_of(group[:half], everything) + patterns_of(group[half:], everything)


def pattern_of(group: Sequence[str], everything: Sequence[str]) -> str:
    """The same as one pattern, however long."""
    patterns = patterns_of(group, everything)
    return patterns[0] if len(patterns) == 1 else f"({'|'.join(patterns)})"


def _candidates(group: Sequence[str]) -> Iterable[str]:
    yield ".*"
    yield _either(group)
    heads = [_split(name, first=True) for name in group]
    if all(tail for _, tail in heads):  # `.*_(hip|thigh)_joint`
        yield ".*" + _either([tail for _, tail in heads])
    tails = [_split(name, first=False) for name in group]
    if all(tail for _, tail in tails):  # `(left|right)_wrist_.*`
        yield _either([head for head, _ in tails]) + ".*"
    yield re.escape(_shared(group)) + ".*"


def _split(name: str, *, first: bool) -> tuple[str, str]:
    """The name cut at its first or last `_`, which goes to the other side."""
    if first:
        head, sep, tail = name.partition("_")
        return head, sep + tail if sep else ""
    head, sep, tail = name.rpartition("_")
    return head + sep, tail if sep else ""


def _either(names: Sequence[str]) -> str:
    """One pattern for exactly these texts, what they share at both ends written once."""
    unique = sorted(set(names), key=names.index)
    if len(unique) == 1:
        return re.escape(unique[0])
    head = _shared(unique)
    rest = [text[len(head) :] for text in unique]
    tail = _shared([text[::-1] for text in rest])[::-1]
    middles = [re.escape(text[: len(text) - len(tail)]) for text in rest]
    if len(middles) > 1 and all(len(text) == 1 and text.isalnum() for text in middles):
        inside = f"[{_range(middles)}]"
    else:
        inside = f"({'|'.join(middles)})"
    return f"{re.escape(head)}{inside}{re.escape(tail)}"


def _range(letters: Sequence[str]) -> str:
    """`1-4` for 1, 2, 3, 4; else the letters."""
    codes = sorted(map(ord, letters))
    run = codes == list(range(codes[0], codes[-1] + 1))
    return f"{chr(codes[0])}-{chr(codes[-1])}" if run and len(codes) > 2 else "".join(letters)


def _shared(texts: Sequence[str]) -> str:
    """The letters that all texts begin with."""
    columns = takewhile(lambda letters: len(set(letters)) == 1, zip(*texts, strict=False))
    return "".join(letters[0] for letters in columns)
