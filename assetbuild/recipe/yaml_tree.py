"""YAML text to a tree in which every value knows its place; hostile text is refused early.

Values mean what they look like (YAML 1.2): only `true` and `false` are booleans, only decimal
numbers are numbers, so `no`, `0x10`, `007`, `1_000` and `12:30:45` are text. The tree is built
from PyYAML's event stream and not by its composer, which recurses without a bound.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
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
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # Any: the C one may be missing


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
    return _Builder(file, error).build(_decoded(data, file, error))


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


@dataclass(slots=True)
class _Open:
    """A list or map that is still being read."""

    where: Where
    anchor: str | None
    items: list[Node]
    entries: dict[str, Entry] | None
    key: str | None = None
    key_where: Where | None = None
    cost: int = 1
    height: int = 0


class _Builder:
    """Events to nodes, on a stack of its own; every bound is checked as the events come."""

    def __init__(self, file: str, error: type[AssetBuildError]) -> None:
        self._file, self._error = file, error
        self._stack: list[_Open] = []
        self._anchors: dict[str, Node] = {}
        self._root: Node | None = None
        self._cost = 0

    def build(self, text: str) -> Node:
        documents = 0
        for event in self._events(text):
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    raise self._fail("a second document begins here", event, "keep one per file")
            elif isinstance(event, yaml.NodeEvent):
                self._node(event)
            elif isinstance(event, yaml.SequenceEndEvent | yaml.MappingEndEvent):
                self._close()
        if self._root is None or (self._root.value is None and not self._root.text):
            raise self._error("the file is empty", where=Where(self._file, 1, 1))
        return self._root

    def _events(self, text: str) -> Iterator[yaml.Event]:
        try:
            yield from yaml.parse(text, Loader=_Loader)
        except yaml.MarkedYAMLError as problem:
            mark = problem.problem_mark or problem.context_mark
            place = Where(self._file, mark.line + 1, mark.column + 1) if mark else None
            message = f"not YAML: {problem.problem or problem.context}"
            raise self._error(message, where=place or Where(self._file)) from None
        except yaml.YAMLError as problem:
            lines = str(problem).strip().splitlines()
            message = f"not YAML: {lines[0] if lines else 'unreadable'}"
            raise self._error(message, where=Where(self._file)) from None

    def _node(self, event: yaml.NodeEvent) -> None:
        parent = self._stack[-1] if self._stack else None
        if parent is not None and parent.entries is not None and parent.key is None:
            self._key(event, parent)
        elif isinstance(event, yaml.AliasEvent):
            self._add(self._alias(event), None)
        elif isinstance(event, yaml.ScalarEvent):
            self._add(self._scalar(event), event.anchor)
        else:
            self._open(event)

    def _key(self, event: yaml.NodeEvent, parent: _Open) -> None:
        if not isinstance(event, yaml.ScalarEvent):
            raise self._fail("a key must be plain text", event)
        key, where = event.value, self._where(event)
        if not key:
            raise self._fail("a key is missing before `:`", event)
        if len(key) > 1000:
            raise self._fail("a key is longer than 1000 characters", event)
        if key == "<<" and event.implicit[0]:
            raise self._fail("merge keys (`<<`) are not read", event, "write the keys out")
        assert parent.entries is not None  # noqa: S101 # only maps get here; narrows for mypy
        if key in parent.entries:
            first = parent.entries[key].where.line
            hint = f"`{key}` stands first on line {first}; keep one"
            raise self._fail(f"duplicate key `{key}`", event, hint)
        parent.key, parent.key_where = key, where

    def _open(self, event: yaml.NodeEvent) -> None:
        if len(self._stack) >= MAX_DEPTH:
            raise self._fail(f"nested deeper than {MAX_DEPTH} levels", event)
        is_map = isinstance(event, yaml.MappingStartEvent)
        self._check_tag(event, ("map",) if is_map else ("seq",))
        where = self._where(event)
        self._stack.append(_Open(where, event.anchor, [], {} if is_map else None))

    def _close(self) -> None:
        done = self._stack.pop()
        value = tuple(done.items) if done.entries is None else done.entries
        node = Node(done.where, value, cost=done.cost, height=done.height + 1)
        self._add(node, done.anchor, counted=done.cost - 1)

    def _add(self, node: Node, anchor: str | None, *, counted: int = 0) -> None:
        """Put a finished node in its place; `counted`: what the budget holds of it already."""
        self._cost += node.cost - counted
        if self._cost > MAX_COST:
            message = f"more than {MAX_COST} values once all aliases are expanded"
            raise self._error(message, where=node.where, hint="remove aliases (`*name`)")
        if anchor is not None:
            self._anchors[anchor] = node
        if not self._stack:
            self._root = node
            return
        parent = self._stack[-1]
        parent.cost += node.cost
        parent.height = max(parent.height, node.height)
        if parent.entries is None:
            parent.items.append(node)
        elif parent.key is not None and parent.key_where is not None:
            parent.entries[parent.key] = Entry(parent.key_where, node)
            parent.key = parent.key_where = None

    def _alias(self, event: yaml.AliasEvent) -> Node:
        if any(frame.anchor == event.anchor for frame in self._stack):
            raise self._fail(f"alias `*{event.anchor}` stands inside what it names", event)
        if event.anchor not in self._anchors:
            raise self._fail(f"no anchor `&{event.anchor}` above", event)
        node = self._anchors[event.anchor]
        if len(self._stack) + node.height > MAX_DEPTH:
            raise self._fail(f"nested deeper than {MAX_DEPTH} levels", event)
        return node

    def _scalar(self, event: yaml.ScalarEvent) -> Node:
        self._check_tag(event, ("str", "int", "float", "bool", "null"))
        text = event.value
        value: Scalar = _looks_like(text) if event.tag is None and event.implicit[0] else text
        if event.tag not in (None, "!", f"{_TAG}str"):
            value = _looks_like(text)
            if type(value) not in _TAGGED[event.tag.removeprefix(_TAG)]:
                raise self._fail(f"`{text[:60]}` is not what its tag says", event)
        return Node(self._where(event), value, text, cost=1 + len(text) // 100)

    def _check_tag(self, event: Any, known: tuple[str, ...]) -> None:  # Any: three event types
        tag = event.tag
        if tag is None or tag == "!" or tag in {_TAG + name for name in known}:
            return
        raise self._fail(f"tag `{tag[:60]}` is not allowed", event, "a recipe is plain data")

    def _where(self, event: Any) -> Where:  # Any: a stream's events always have marks
        mark = event.start_mark
        return Where(self._file, mark.line + 1, mark.column + 1)

    def _fail(self, message: str, event: yaml.Event, hint: str = "") -> AssetBuildError:
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
