"""The leaves of a YAML file with their lines: what readers of facts compare."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from assetbuild.errors import UsageError, Where

if TYPE_CHECKING:
    from yaml import Node

Keys = tuple[str, ...]
SECTION = "section"
"""What is added to the keys of a section, for the leaf that says that it stands there."""


def yaml_leaves(
    path: Path, sections: Collection[str] = (), lists: Collection[str] = ()
) -> Iterator[tuple[str, Keys, Any]]:  # Any: YAML's scalars
    """(file:line, keys, value) of everything that is no mapping; a list of them counts from 0.

    sections: keys at the top that yield a leaf of their own and may be empty mappings. lists: those
    that may be empty lists. A key that stands twice has `(again)` behind its name, which nothing
    knows. UsageError where the file is no YAML.
    """
    import yaml

    try:
        loader = yaml.SafeLoader(path.read_text(encoding="utf-8"))
        node = loader.get_single_node()
        if node is None:
            return
        for key, _ in node.value if isinstance(node, yaml.MappingNode) else ():
            if key.value in sections:
                yield f"{path.name}:{key.start_mark.line + 1}", (key.value, SECTION), True
        empty = {(name,) for name in sections}
        for keys, leaf in list(_below(node, (), empty, {(name,) for name in lists})):
            line = leaf.start_mark.line + 1
            yield f"{path.name}:{line}", keys, loader.construct_object(leaf, deep=True)
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = Where(path.name, mark.line + 1 if mark else 0)
        problem = getattr(error, "problem", None) or "no UTF-8 text"
        raise UsageError(f"not readable as YAML: {problem}", where=where) from None
    except OSError as error:
        raise UsageError(f"cannot read `{path}`: {error.strerror}") from None


def _below(
    node: Node, keys: Keys, empty: Collection[Keys], lists: Collection[Keys]
) -> Iterator[tuple[Keys, Node]]:
    import yaml

    if isinstance(node, yaml.MappingNode):
        seen: set[str] = set()
        for key, value in node.value:
            name = str(key.value)
            while name in seen:
                name += " (again)"
            seen.add(name)
            yield from _below(value, (*keys, name), empty, lists)
        if not node.value and keys not in empty:
            yield keys, node
        return
    rows = node.value if isinstance(node, yaml.SequenceNode) else ()
    if rows and all(isinstance(row, yaml.MappingNode) for row in rows):
        for number, row in enumerate(rows):
            yield from _below(row, (*keys, str(number)), empty, lists)
    elif keys not in lists or rows:
        yield keys, node
