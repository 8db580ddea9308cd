"""YAML and JSON: leaves by the path of their keys."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from assetbuild.facts.again.row import LONGEST, NotParsedError, Row, same_number
from assetbuild.facts.table import Value
from assetbuild.facts.yaml_file import plain_loader

Path = tuple[str, ...]


@dataclass(frozen=True)
class _Leaf:
    """A value without keys below it. line: from 1."""

    value: object
    line: int


def key_rows(again: bytes, there: bytes) -> list[Row]:
    """What two files say differently; comments and layout mean nothing."""
    ours, theirs = _leaves(again), _leaves(there)
    return list(_rows(ours, theirs))


def _rows(ours: Mapping[Path, _Leaf], theirs: Mapping[Path, _Leaf]) -> Iterator[Row]:
    for path in dict.fromkeys((*ours, *theirs)):
        one, other = ours.get(path), theirs.get(path)
        if one and other and _same(one.value, other.value):
            continue
        kind, name, attribute = path[0], path[1] if len(path) > 2 else "", _attribute(path)
        expected, found = (_shown(side.value) if side else None for side in (one, other))
        yield Row(kind, name, attribute, expected, found, other.line if other else 0)


def _attribute(path: Path) -> str:
    return " ".join(path[2:] if len(path) > 2 else path[-1:])


def _leaves(data: bytes) -> dict[Path, _Leaf]:
    """JSON is YAML as well, as far as files of a bundle go."""
    import yaml

    try:
        root = yaml.compose(data, Loader=plain_loader())
        return dict(_walk(root, ())) if root else {}
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 0
        raise NotParsedError(f"not readable as YAML: {error.problem}", line) from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise NotParsedError(f"not readable as YAML: {error}") from None


def _walk(node: object, path: Path) -> Iterator[tuple[Path, _Leaf]]:
    """node: a node of PyYAML."""
    import yaml

    if isinstance(node, yaml.MappingNode) and node.value:
        for key, value in node.value:
            yield from _walk(value, (*path, str(key.value)))
    elif isinstance(node, yaml.SequenceNode) and _is_nested(node):
        for index, item in enumerate(node.value):
            yield from _walk(item, (*path, f"[{index}]"))
    elif isinstance(node, yaml.Node):
        value = yaml.SafeLoader("").construct_object(node, deep=True)
        yield path or ("file",), _Leaf(value, node.start_mark.line + 1)


def _is_nested(node: object) -> bool:
    """A list of plain values is one value."""
    import yaml

    items = node.value if isinstance(node, yaml.SequenceNode) else ()
    return any(not isinstance(item, yaml.ScalarNode) for item in items)


def _same(one: object, other: object) -> bool:
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_same, one, other))
    if type(one) is type(other) and isinstance(one, float):
        return same_number(one, float(str(other)))
    return type(one) is type(other) and one == other


def _shown(value: object) -> Value:
    """A value of YAML as a finding shows it."""
    if isinstance(value, bool | str):
        return value
    if isinstance(value, int | float):
        return float(value)
    if isinstance(value, list) and all(isinstance(v, int | float) for v in value):
        return tuple(float(v) for v in value)
    return str(value)[:LONGEST]
