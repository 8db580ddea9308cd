"""YAML text to a tree in which every value knows its place; hostile text is refused early.

Values mean what they look like (YAML 1.2): only `true` and `false` are booleans, only decimal
numbers are numbers, so `no`, `0x10`, `007`, `1_000` and `12:30:45` are text. PyYAML's composer
recurses without a bound, so its events are counted before.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import yaml

from assetbuild.errors import AssetBuildError, Where

MAX_BYTES = 4 * 1024 * 1024
MAX_DEPTH = 64
MAX_COST = 50_000
"""Nodes after all aliases are expanded; a scalar counts one more for every 100 characters."""

Scalar = str | int | float | bool | None

_TAG, _PLAIN = "tag:yaml.org,2002:", "plain"
"""Before the tags of YAML; and in place of one where plain text states none."""
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
    "undefined alias": "quote text that begins with `*`",
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


class _Loader(_Safe):  # type: ignore[misc]  # Any, as above
    """PyYAML's composer without its own ideas of what plain text means."""

    def resolve(self, kind: type, value: object, implicit: tuple[bool, bool]) -> str:
        """The tag of a node that states none."""
        if kind is yaml.ScalarNode:
            return _PLAIN if implicit[0] else f"{_TAG}str"
        return f"{_TAG}map" if kind is yaml.MappingNode else f"{_TAG}seq"


class _Builder:
    """PyYAML's nodes to ours; the text is bounded before, what aliases make of it on the way."""

    def __init__(self, file: str, error: type[AssetBuildError]) -> None:
        self._file, self._error = file, error
        self._nodes: dict[yaml.Node, Node | None] = {}

    def build(self, text: str) -> Node:
        try:
            self._check_bounds(text)
            root = yaml.compose(text, Loader=_Loader)
        except yaml.YAMLError as problem:
            raise self._refused(problem, text) from None
        if root is None or (root.tag == _PLAIN and not root.value):
            raise self._error("the file is empty", where=Where(self._file, 1, 1))
        return self._node(root, 1)

    def _refused(self, problem: Any, text: str) -> AssetBuildError:  # Any: most have marks
        """What PyYAML says, where what it could not read begins, and what is wrong most often."""
        start = getattr(problem, "context_mark", None)
        mark = getattr(problem, "problem_mark", None) or start
        place = (mark.line + 1, mark.column + 1) if mark else ()
        what = getattr(problem, "problem", "") or str(problem).strip().partition("\n")[0]
        if start and mark and start.line < mark.line:
            what += f" {problem.context} that begins on line {start.line + 1}"
        hint = next((hint for words, hint in _REMEDIES.items() if words in what), "")
        if mark and text[mark.index : mark.index + 1] == "\t":
            hint = "indent with spaces: YAML takes no tabs"
        return self._error(f"not YAML: {what}", where=Where(self._file, *place), hint=hint)

    def _check_bounds(self, text: str) -> None:
        """PyYAML composes without a bound: so few nodes cost little, and its stack is ours."""
        documents = nodes = depth = 0
        for event in yaml.parse(text, Loader=_Loader):
            documents += isinstance(event, yaml.DocumentStartEvent)
            nodes += isinstance(event, yaml.NodeEvent)
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if documents > 1:
                raise self._fail("a second document begins here", event, "keep one per file")
            if depth > MAX_DEPTH:
                raise self._fail(_TOO_DEEP, event)
            if nodes > 2 * MAX_COST:  # keys are nodes, too
                raise self._fail(_TOO_MANY, event)

    def _node(self, node: yaml.Node, depth: int) -> Node:
        """depth: of the node, with all aliases above it expanded."""
        if node in self._nodes:
            made = self._nodes[node]
            if made is None:
                raise self._fail("an alias stands inside what it names", node)
            if depth - 1 + made.height > MAX_DEPTH:
                raise self._fail(_TOO_DEEP, node)
            return made
        self._nodes[node] = None
        made = self._nodes[node] = self._made(node, depth)
        return made

    def _made(self, node: yaml.Node, depth: int) -> Node:
        where = self._where(node)
        if isinstance(node, yaml.ScalarNode):
            self._check_tag(node, (_PLAIN, "str", "int", "float", "bool", "null"))
            return Node(where, self._scalar(node), node.value, cost=1 + len(node.value) // 100)
        entries: dict[str, Entry] = {}
        items: list[Node] = []
        cost = height = 1
        is_map = isinstance(node, yaml.MappingNode)
        self._check_tag(node, ("map",) if is_map else ("seq",))
        for key, item in node.value if is_map else ((None, item) for item in node.value):
            name = self._key(key, entries) if key else ""
            made = self._node(item, depth + 1)
            if key:
                entries[name] = Entry(self._where(key), made)
            items.append(made)
            cost, height = cost + made.cost, max(height, made.height + 1)
            if cost > MAX_COST:
                raise self._fail(_TOO_MANY, item, "remove aliases (`*name`)")
        value = entries if is_map else tuple(items)
        return Node(where, value, cost=cost, height=height)

    def _key(self, node: yaml.Node, entries: Mapping[str, Entry]) -> str:
        if not isinstance(node, yaml.ScalarNode):
            raise self._fail("a key must be plain text", node)
        key = str(node.value)
        if not key:
            raise self._fail("a key is missing before `:`", node)
        if len(key) > 1000:
            raise self._fail("a key is longer than 1000 characters", node)
        if key == "<<" and node.tag == _PLAIN:
            raise self._fail("merge keys (`<<`) are not read", node, "write the keys out")
        if key in entries:
            hint = f"`{key}` stands first on line {entries[key].where.line}; keep one"
            raise self._fail(f"duplicate key `{key}`", node, hint)
        return key

    def _scalar(self, node: yaml.ScalarNode) -> Scalar:
        text: str = node.value
        if node.tag == f"{_TAG}str":
            return text
        value = _looks_like(text)
        if node.tag != _PLAIN and type(value) not in _TAGGED[node.tag.removeprefix(_TAG)]:
            raise self._fail(f"`{text[:60]}` is not what its tag says", node)
        return value

    def _check_tag(self, node: yaml.Node, known: tuple[str, ...]) -> None:
        if node.tag.removeprefix(_TAG) not in known:
            message = f"tag `{node.tag[:60]}` is not allowed"
            raise self._fail(message, node, "a recipe is plain data")

    def _where(self, node: Any) -> Where:  # Any: nodes and events of a stream have marks
        mark = node.start_mark
        return Where(self._file, mark.line + 1, mark.column + 1)

    def _fail(self, message: str, node: Any, hint: str = "") -> AssetBuildError:  # Any: as above
        return self._error(message, where=self._where(node), hint=hint)


def _looks_like(text: str) -> Scalar:
    if text in _WORDS:
        return _WORDS[text]
    if len(text) <= _LONGEST_NUMBER:
        if _INT.fullmatch(text):
            return int(text)
        if _FLOAT.fullmatch(text):
            return float(text)
    return text
