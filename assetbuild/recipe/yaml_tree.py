"""YAML text to a tree in which every value knows its place; hostile text is refused early.

Values mean what they look like (YAML 1.2): only `true` and `false` are booleans, only decimal
numbers are numbers, so `no`, `0x10`, `007`, `1_000` and `12:30:45` are text.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import yaml

from assetbuild.errors import AssetBuildError, Where

MAX_BYTES = 4 * 1024 * 1024
MAX_DEPTH = 64
MAX_COST = 50_000
"""Nodes after all aliases are expanded; a scalar counts one more for every 100 characters."""

Scalar = str | int | float | bool | None

_TAG = "tag:yaml.org,2002:"
"""Before the tags of YAML."""
_TOO_DEEP = f"nested deeper than {MAX_DEPTH} levels"
_TOO_MANY = f"more than {MAX_COST} values once all aliases are expanded"
_INT = re.compile(r"[-+]?(0|[1-9][0-9]*)")
_FLOAT = re.compile(r"[-+]?((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
_WORDS: Mapping[str, Scalar] = {
    "": None,
    "~": None,
    "null": None,
    "true": True,
    "false": False,
    ".inf": float("inf"),
    "+.inf": float("inf"),
    "-.inf": float("-inf"),
    ".nan": float("nan"),
}
_TAGGED: Mapping[str, tuple[type, ...]] = {
    "int": (int,),
    "float": (int, float),
    "bool": (bool,),
    "null": (type(None),),
}
_LONGEST_NUMBER = 64
_REMEDIES: Mapping[str, str] = {
    "mapping values": "indent the keys of a map alike, and quote text that holds `: `",
    "did not find expected key": "indent the keys of a map alike",
    "expected ':'": "write a space after each colon, `key: value`, and quote other text",
    "escape character": "`\\` begins an escape in double quotes: put the pattern in single quotes",
}
"""What PyYAML says -> what to do about it."""
_Safe: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # Any: the C one may be missing


@dataclass(frozen=True, slots=True)
class Entry:
    """One key of a map: where the key stands, and its value."""

    where: Where
    node: Node


@dataclass(frozen=True, slots=True)
class Node:
    """A value with its place.

    value: a scalar, a tuple of nodes (list) or a dict of entries (map, in file order).
    text: a scalar as it was written. cost, height: of the expanded tree below, itself included.
    """

    where: Where
    value: Scalar | tuple[Node, ...] | dict[str, Entry]
    text: str = ""
    cost: int = 1
    height: int = 1


def parse(data: bytes, file: str, error: type[AssetBuildError]) -> Node:
    """The tree of one YAML document; `file` is the name for messages.

    Raises `error` with file, line and column for text that is too long, not UTF-8, empty, no
    YAML, nested too deep, has duplicate keys, foreign tags, or aliases that grow too much.
    """
    if len(data) > MAX_BYTES:
        raise error(f"the file is longer than {MAX_BYTES >> 20} MB", where=Where(file))
    return _Builder(_decoded(data, file, error), file, error).document()


def plain(node: Node) -> object:
    """The bare data: dict, tuple, scalars. A float without a fraction becomes an int (1e3)."""
    value = node.value
    if isinstance(value, dict):
        return {key: plain(entry.node) for key, entry in value.items()}
    if isinstance(value, tuple):
        return tuple(plain(item) for item in value)
    if isinstance(value, float) and value.is_integer() and abs(value) < 2**53:
        return int(value)
    return value


def described(node: Node) -> str:
    """What stands there, for a message: "the text `abc`", "a list", "nothing"."""
    value = node.value
    if isinstance(value, dict):
        return "a map"
    if isinstance(value, tuple):
        return "a list"
    if value is None:
        return "nothing"
    text = node.text if len(node.text) <= 60 else f"{node.text[:57]}..."
    kind = "the text" if isinstance(value, str) else ""
    return f"{kind} `{text}`".strip()


def _decoded(data: bytes, file: str, error: type[AssetBuildError]) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        before = data[: problem.start]
        line = before.count(b"\n") + 1
        column = problem.start - (before.rfind(b"\n") + 1) + 1
        where = Where(file, line, column)
        raise error("the file is not UTF-8", where=where, hint="save it as UTF-8") from None


class _Builder:
    """PyYAML's events to nodes, which are counted on the way: its own composer has no bounds."""

    def __init__(self, text: str, file: str, error: type[AssetBuildError]) -> None:
        self._text, self._file, self._error = text, file, error
        self._events = yaml.parse(text, Loader=_Safe)
        self._anchors: dict[str, Node | None] = {}
        """None while the node is made that an anchor names."""

    def document(self) -> Node:
        try:
            next(self._events)  # the stream begins
            is_empty = isinstance(next(self._events), yaml.StreamEndEvent)
            root = None if is_empty else self._node(next(self._events), 1)
            if root is None or (root.value is None and not root.text):
                raise self._error("the file is empty", where=Where(self._file, 1, 1))
            next(self._events)  # the document ends
            after = next(self._events)
        except yaml.YAMLError as problem:
            raise self._refused(problem) from None
        if isinstance(after, yaml.DocumentStartEvent):
            raise self._fail("a second document begins here", after, "keep one per file")
        return root

    def _refused(self, problem: Any) -> AssetBuildError:  # Any: most have marks
        """What PyYAML says, where what it could not read begins, and what is wrong most often."""
        start = getattr(problem, "context_mark", None)
        mark = getattr(problem, "problem_mark", None) or start
        place = (mark.line + 1, mark.column + 1) if mark else ()
        what = getattr(problem, "problem", "") or str(problem).strip().partition("\n")[0]
        if start and mark and start.line < mark.line:
            what += f" {problem.context} that begins on line {start.line + 1}"
        hint = next((hint for words, hint in _REMEDIES.items() if words in what), "")
        if mark and self._text[mark.index : mark.index + 1] == "\t":
            hint = "indent with spaces: YAML takes no tabs"
        return self._error(f"not YAML: {what}", where=Where(self._file, *place), hint=hint)

    def _node(self, event: Any, depth: int) -> Node:  # Any: PyYAML's events have no stubs
        """depth: of the node, with all aliases above it expanded."""
        if isinstance(event, yaml.AliasEvent):
            return self._aliased(event, depth)
        if isinstance(event, yaml.ScalarEvent):
            cost = 1 + len(event.value) // 100
            made = Node(self._where(event), self._scalar(event), event.value, cost=cost)
        else:
            self._anchors[event.anchor] = None
            made = self._collection(event, depth)
        self._anchors[event.anchor] = made
        return made

    def _aliased(self, event: Any, depth: int) -> Node:  # Any: as above
        if event.anchor not in self._anchors:
            hint = "quote text that begins with `*`"
            raise self._fail(f"not YAML: undefined alias `{event.anchor}`", event, hint)
        made = self._anchors[event.anchor]
        if made is None:
            raise self._fail("an alias stands inside what it names", event)
        if depth - 1 + made.height > MAX_DEPTH:
            raise self._fail(_TOO_DEEP, event)
        return made

    def _collection(self, event: Any, depth: int) -> Node:  # Any: as above
        if depth > MAX_DEPTH:
            raise self._fail(_TOO_DEEP, event)
        is_map = isinstance(event, yaml.MappingStartEvent)
        self._check_tag(event, ("map",) if is_map else ("seq",))
        entries: dict[str, Entry] = {}
        items: list[Node] = []
        cost = height = 1
        while not isinstance(first := next(self._events), yaml.CollectionEndEvent):
            name = self._key(first, depth, entries) if is_map else ""
            item = next(self._events) if is_map else first
            made = self._node(item, depth + 1)
            if is_map:
                entries[name] = Entry(self._where(first), made)
            else:
                items.append(made)
            cost, height = cost + made.cost, max(height, made.height + 1)
            if cost > MAX_COST:
                raise self._fail(_TOO_MANY, item, "remove aliases (`*name`)")
        value = entries if is_map else tuple(items)
        return Node(self._where(event), value, cost=cost, height=height)

    def _key(self, event: Any, depth: int, entries: Mapping[str, Entry]) -> str:  # Any: as above
        node = self._node(event, depth)
        if isinstance(node.value, dict | tuple):
            raise self._fail("a key must be plain text", event)
        key = node.text
        if not key:
            raise self._fail("a key is missing before `:`", event)
        if len(key) > 1000:
            raise self._fail("a key is longer than 1000 characters", event)
        if key == "<<" and isinstance(event, yaml.ScalarEvent) and event.implicit[0]:
            raise self._fail("merge keys (`<<`) are not read", event, "write the keys out")
        if key in entries:
            hint = f"`{key}` stands first on line {entries[key].where.line}; keep one"
            raise self._fail(f"duplicate key `{key}`", event, hint)
        return key

    def _scalar(self, event: Any) -> Scalar:  # Any: as above
        self._check_tag(event, ("str", *_TAGGED))
        text: str = event.value
        tag = str(event.tag or "").removeprefix(_TAG)
        if tag == "str" or (not tag and not event.implicit[0]):
            return text
        value = _looks_like(text)
        if tag and type(value) not in _TAGGED[tag]:
            raise self._fail(f"`{text[:60]}` is not what its tag says", event)
        return value

    def _check_tag(self, event: Any, known: Collection[str]) -> None:  # Any: as above
        if event.tag and event.tag.removeprefix(_TAG) not in known:
            message = f"tag `{event.tag[:60]}` is not allowed"
            raise self._fail(message, event, "a recipe is plain data")

    def _where(self, event: Any) -> Where:  # Any: as above
        mark = event.start_mark
        return Where(self._file, mark.line + 1, mark.column + 1)

    def _fail(self, message: str, event: Any, hint: str = "") -> AssetBuildError:  # Any: as above
        return self._error(message, where=self._where(event), hint=hint)


def _looks_like(text: str) -> Scalar:
    if text in _WORDS:
        return _WORDS[text]
    if len(text) <= _LONGEST_NUMBER:
        if _INT.fullmatch(text):
            return int(text)
        if _FLOAT.fullmatch(text):
            return float(text)
    return text
