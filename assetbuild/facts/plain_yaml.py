"""Plain data: a YAML file of a bundle, and the leaves of JSON."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from assetbuild.errors import UsageError, Where
from assetbuild.facts.table import Value


def plain_loader() -> Any:  # Any: PyYAML, which is only imported where it is needed
    """PyYAML's safe loader without aliases, of which a short file can make an endless one."""
    import yaml

    class Plain(yaml.SafeLoader):
        def compose_node(self, parent: Any, index: Any) -> Any:
            if self.check_event(yaml.AliasEvent):
                mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
                raise yaml.MarkedYAMLError(problem="it has an alias", problem_mark=mark)
            return super().compose_node(parent, index)

    return Plain


def read_yaml(path: Path, loader: Any = None) -> dict[str, Any]:  # Any: plain YAML, here and below
    """The mapping that a file holds. UsageError where it holds none, or names a part twice.

    loader: a safe one; None = `plain_loader`.
    """
    import yaml

    try:
        content = yaml.load(path.read_bytes(), loader or plain_loader())  # noqa: S506 - a safe loader
    except OSError as error:
        raise UsageError(f"cannot read `{path}`: {error.strerror}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = Where(path.name, mark.line + 1 if mark else 0)
        problem = getattr(error, "problem", None) or "no UTF-8 text, or too deep"
        raise UsageError(f"not readable as YAML: {problem}", where=where) from None
    if not isinstance(content, dict):
        raise UsageError(f"`{path.name}` holds no mapping")
    return content


def leaves(value: object, path: str = "") -> Iterator[tuple[str, Value]]:
    """(path, value) of all leaves of plain JSON; items of a list go by their names.

    A second item of one name has its place behind it. What is empty is a leaf.
    """
    if isinstance(value, Mapping) and value:
        for key, item in value.items():
            yield from leaves(item, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list | tuple) and value:
        seen = set()
        for index, item in enumerate(value):
            named = item.get("name", item.get("joint")) if isinstance(item, Mapping) else None
            again = f"[{index}]" if not named or named in seen else ""
            seen.add(named)
            yield from leaves(item, f"{path}.{named}{again}" if named else f"{path}{again}")
    elif isinstance(value, bool | str) or value is None:
        yield path, value
    elif isinstance(value, int | float):
        yield path, float(value)
    else:
        yield path, "nothing"
