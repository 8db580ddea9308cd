"""Short patterns for groups of names: what a person would write in the recipe."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import takewhile

LONGEST = 400
"""Characters; a recipe takes patterns of up to 500."""


def patterns_of(group: Sequence[str], everything: Sequence[str]) -> tuple[str, ...]:
    """Patterns that together match every name of `group` once, and no other of `everything`."""
    if len(group) == 1:
        return (re.escape(group[0]),)
    wanted = set(group)
    for pattern in sorted(_candidates(group), key=lambda text: (len(text), text)):
        if len(pattern) <= LONGEST and _matched(pattern, everything) == wanted:
            return (pattern,)
    half = len(group) // 2
    return patterns_of(group[:half], everything) + patterns_of(group[half:], everything)


def pattern_of(group: Sequence[str], everything: Sequence[str]) -> str:
    """The same as one pattern, however long."""
    patterns = patterns_of(group, everything)
    return patterns[0] if len(patterns) == 1 else f"({'|'.join(patterns)})"


def _matched(pattern: str, names: Iterable[str]) -> set[str]:
    return {name for name in names if re.fullmatch(pattern, name)}


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
