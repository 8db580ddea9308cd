"""YAML and JSON: values by the path of their keys. JSON is YAML, as far as bundles go."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from assetbuild.facts.again.row import NotParsedError
from assetbuild.facts.again.tree import Node
from assetbuild.facts.plain_yaml import plain_loader

NAMED = 2
"""Tables below so many keys are about a thing: `links`, `trunk`."""


def key_tree(path: Path) -> Node:
    """Comments and layout mean nothing."""
    import yaml

    try:
        root = yaml.compose(path.read_bytes(), Loader=plain_loader())
        return _node(root, ()) if root else Node()
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 0
        raise NotParsedError(f"not readable as YAML: {error.problem}", line) from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise NotParsedError(f"not readable as YAML: {error}") from None


def _node(node: Any, path: tuple[str, ...]) -> Node:  # Any: a node of PyYAML
    import yaml

    line = node.start_mark.line + 1
    if isinstance(node, yaml.MappingNode):
        keys = [str(key.value) for key, _ in node.value]
        items = [value for _, value in node.value]
    elif isinstance(node, yaml.SequenceNode) and _is_nested(node):
        keys, items = [f"[{index}]" for index in range(len(node.value))], node.value
    else:
        value = yaml.SafeLoader("").construct_object(node, deep=True)
        leaf = Node(tuple(value) if _is_row(value) else value, {}, line)
        return leaf if len(path) > 1 else Node(None, {path[-1] if path else "value": leaf})
    parts = {key: _node(item, (*path, key)) for key, item in zip(keys, items, strict=True)}
    is_named = 0 < len(path) <= NAMED
    subject = (path[0], "".join(path[1:])) if is_named else None
    return Node(None, parts, line, subject)


def _is_nested(node: Any) -> bool:  # Any: as above
    """A list of plain values is one value."""
    import yaml

    return any(not isinstance(item, yaml.ScalarNode) for item in node.value)


def _is_row(value: object) -> bool:
    if not isinstance(value, list):
        return False
    return all(isinstance(item, int | float) and not isinstance(item, bool) for item in value)
