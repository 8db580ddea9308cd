"""A recipe while it is made: its data, the comments beside them, and the one writer of both.

And short patterns for groups of names.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product, takewhile
from pathlib import Path
from typing import Any

from assetbuild.findings import Finding

WIDTH = 100
"""Characters up to which a mapping or list stands in one line."""
LONGEST = 400
"""Characters of a pattern; a recipe takes up to 500."""
_IN_WORD, _IN_WORD_REVERSED = map(re.compile, ("[A-Za-z][a-z]|[0-9]{2}", "[a-z][A-Za-z]|[0-9]{2}"))
"""Two characters that a pattern keeps together: `(left|right)`, not `(lef|righ)t`."""

Keys = tuple[str | int, ...]
NOTHING = object()
"""The value of a key that has comments alone."""


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


@dataclass
class Draft:
    """A recipe; above, beside: comments by path of keys, lines before a key or behind its value."""

    data: dict[str | int, Any] = field(default_factory=dict)  # Any: what YAML holds
    above: dict[Keys, list[str]] = field(default_factory=dict)
    beside: dict[Keys, str] = field(default_factory=dict)

    def put(self, value: object, *keys: str, beside: str = "", above: Iterable[str] = ()) -> None:
        """State a value; sections on the way are made."""
        self._section(keys)[keys[-1]] = value
        if beside:
            self.beside[keys] = plain(beside)
        self.note(*above, at=keys)

    def add(self, value: object, *keys: str, above: Iterable[str] = ()) -> None:
        """Append to the list at these keys."""
        rows = self._section(keys).get(keys[-1], NOTHING)
        if rows is NOTHING:
            rows = self._section(keys)[keys[-1]] = []
        rows.append(value)
        self.note(*above, at=(*keys, len(rows) - 1))

    def note(self, *lines: str, at: Keys) -> None:
        """Comments above a key, which need not have a value."""
        if lines:
            if isinstance(at[-1], str):
                self._section(at).setdefault(at[-1], NOTHING)
            self.above.setdefault(at, []).extend(plain(line) for line in lines)

    def _section(self, keys: Keys) -> dict[str | int, Any]:  # Any: what YAML holds
        """Return the mapping in which the last of the keys stands; sections on the way are made."""
        inside = self.data
        for key in keys[:-1]:
            if inside.get(key, NOTHING) is NOTHING:
                inside[key] = {}
            inside = inside[key]
        return inside

    @property
    def text(self) -> str:
        """The recipe as YAML: what has no comment inside and fits in a line stands in one."""
        blocks = ("\n".join(self._lines((key,), value)) for key, value in self.data.items())
        return "\n\n".join(blocks) + "\n"

    def _lines(self, keys: Keys, value: object) -> Iterator[str]:
        indent = "  " * (len(keys) - 1)
        yield from (f"{indent}# {line}" for line in self.above.get(keys, ()))
        if value is NOTHING:
            return
        head = f"{indent}{inline(keys[-1])}:" if isinstance(keys[-1], str) else f"{indent}-"
        remark = f"   # {self.beside[keys]}" if keys in self.beside else ""
        parts: list[tuple[str | int, object]] = []
        if isinstance(value, Mapping | list):
            parts += value.items() if isinstance(value, Mapping) else enumerate(value)
        inside = (key for key in (*self.above, *self.beside) if key[: len(keys)] == keys != key)
        is_short = len(f"{head} {inline(value)}") <= WIDTH and not any(inside)
        if isinstance(keys[-1], int) or not parts or is_short:
            yield f"{head} {inline(value)}{remark}"
            return
        yield head + remark
        for key, part in parts:
            yield from self._lines((*keys, key), part)


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
    """List at most six names and how many more, for a comment."""
    more = f" and {len(names) - 6} more" if len(names) > 6 else ""
    return plain(", ".join(names[:6]), 200) + more


def with_remedy(finding: Finding) -> str:
    """What is wrong, in a sentence with the edit that mends it."""
    return f"{finding.subject}: {finding.message} ({finding.hint})"


def plain(text: str, longest: int = 500) -> str:
    """Text for a comment: one line."""
    return " ".join(text.split())[:longest]


def patterns_of(group: Sequence[str], everything: Iterable[str]) -> tuple[str, ...]:
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


def _candidates(group: Sequence[str]) -> Iterable[str]:
    yield ".*"
    yield _either(group)
    heads = [name.partition("_") for name in group]
    if all(mark for _, mark, _ in heads):  # `.*_(hip|thigh)_joint`
        yield ".*" + _either([mark + tail for _, mark, tail in heads])
    tails = [name.rpartition("_") for name in group]
    if all(mark and tail for _, mark, tail in tails):  # `(left|right)_wrist_.*`
        yield _either([head + mark for head, mark, _ in tails]) + ".*"
    yield re.escape(_shared(group)) + ".*"
    rows = [name.split("_") for name in group]
    if len({*map(len, rows)}) == 1 and len(rows[0]) < 7:  # `arm_.*_shoulder_(pitch|roll)`
        first, *others = (_either(column) for column in zip(*rows, strict=True))
        free = ([".*", word] if re.search(r"[(\[]", word) else [word] for word in others)
        for words in product([".*", first], *free):
            yield re.sub(r"\.\*(_\.\*)+", ".*", "_".join(words))


def _either(names: Sequence[str]) -> str:
    """One pattern for exactly these texts, what they share at both ends written once."""
    unique = sorted(set(names), key=names.index)
    if len(unique) == 1:
        return re.escape(unique[0])
    head = _shared(unique)
    rest = [text[len(head) :] for text in unique]
    tail = _shared([text[::-1] for text in rest], _IN_WORD_REVERSED)[::-1]
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


def _shared(texts: Sequence[str], in_word: re.Pattern[str] = _IN_WORD) -> str:
    """What all texts begin with, as far as it ends where a word or number of each does."""
    columns = takewhile(lambda letters: len(set(letters)) == 1, zip(*texts, strict=False))
    count = len([*columns])
    while count and any(in_word.fullmatch(text[count - 1 : count + 1]) for text in texts):
        count -= 1
    return texts[0][:count]
